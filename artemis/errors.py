"""The error family: raised where the program cannot continue at that place.

    ArtemisError
     ├ ConfigError                       something in a file; collected, before any motion
     │  └ PluginError                    missing, broken (cause chained) or claimed twice
     ├ DeviceError(device)
     │  ├ DeviceTimeout                  also TimeoutError
     │  ├ DeviceLost                     also ConnectionError
     │  ├ DeviceBusy                     dropped a frame, may take the next
     │  ├ NotReady                       a laser scanner that has not started yet
     │  ├ WrongDevice                    answers, but is not the one in the robot file
     │  │  └ ScannerRefused              a laser scanner does not do what it is asked for
     │  │     └ Unknown                  or knows nothing of the kind
     │  ├ NotKept                        reads back another value than was written
     │  ├ DeviceRestarted                began anew in the middle of what was done with it
     │  └ ProtocolError                  a malformed or unexpected frame; also ValueError
     │     ├ SdoAbort(index, subindex, code)
     │     └ TelegramError               of a laser scanner
     ├ HidError                          a report descriptor or a report that cannot be read
     ├ Unteachable                       an input device that a profile cannot describe
     ├ CalibrationError
     └ RecordingError                    unreadable, or replay diverged

What the robot must react to while it runs is a value instead: `artemis.values.Fault`.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable

_MAX_SHOWN = 60
_NEAR = 0.5
"""Share of its letters that a word has in common with one that may be meant."""


class ArtemisError(Exception):
    """Every error that artemis raises on purpose."""


class ConfigError(ArtemisError):
    """A file is wrong. `problems` holds everything found, one line each, with file:line:column and key."""

    def __init__(self, problems: list[str] | str) -> None:
        self.problems = [problems] if isinstance(problems, str) else list(problems)
        super().__init__("\n".join(self.problems))


class PluginError(ConfigError):
    """A plugin is missing, broken, or two packages claim its name."""


class DeviceError(ArtemisError):
    """A device failed; `device` names it as the robot file does."""

    def __init__(self, device: str, problem: str) -> None:
        self.device = device
        self.problem = writable(problem)
        super().__init__(f"{device}: {self.problem}")


class DeviceTimeout(DeviceError, TimeoutError):
    """The device did not answer in time."""


class DeviceLost(DeviceError, ConnectionError):
    """The device, or the adapter in front of it, is gone."""


class DeviceBusy(DeviceError):
    """The adapter has no room for a frame and dropped it; it may take the next."""


class WrongDevice(DeviceError):
    """The device is another one than the robot file says."""


class NotKept(DeviceError):
    """The device did not keep what was written."""


class DeviceRestarted(DeviceError):
    """The device restarted and has lost what it was told before."""


class ProtocolError(DeviceError, ValueError):
    """A frame that cannot be what it claims to be."""

    def __init__(self, problem: str, device: str = "CAN") -> None:
        super().__init__(device, problem)


class HidError(ArtemisError):
    """A HID device's report descriptor, or a report, breaks the rules; tells the byte."""


class CalibrationError(ArtemisError):
    """A calibration cannot be trusted."""


class RecordingError(ArtemisError):
    """A recording is unreadable, or its replay differs."""


def writable(text: object) -> str:
    """Foreign text as a file in UTF-8 can hold it: bytes that are no text (`os.fsdecode`) are escaped."""
    return str(text).encode("utf-8", "backslashreplace").decode()


def similar(word: str, names: Iterable[str]) -> str:
    """The names in a message about an unknown one, after the nearest, if one is near; empty where there are none."""
    names = list(names)
    there = f"there are {', '.join(names)}" if names else ""
    return ", ".join(filter(None, (nearest_of(word, names), there)))


def nearest_of(word: str, names: Iterable[str]) -> str:
    """The nearest of the names in such a message; empty where none is near."""
    nearest = difflib.get_close_matches(word, list(names), n=1, cutoff=_NEAR)
    return f"nearest is '{nearest[0]}'" if nearest else ""


def shown(value: object) -> str:
    """A value in a message: printable, as Python writes it, and not longer than a line."""
    text = repr(value)
    return text if len(text) <= _MAX_SHOWN else text[:_MAX_SHOWN] + "..."
