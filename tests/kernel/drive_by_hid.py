"""Drives missions by input devices of the Linux kernel over CAN interfaces of the kernel; see scripts/kernel_hid."""

from __future__ import annotations

import argparse
import os
import queue
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from typing import IO

import can
import yaml
from uhid import UhidDevice

from artemis.devices.hid.descriptor import Descriptor, parse_descriptor
from artemis.plugins.inputs.profiles import Profile, profile_named
from artemis.recording.mcap_reader import Recording

ROOT = Path(__file__).parents[2]
DEVICES = {
    "logitech-extreme-3d-pro": ("logitech_extreme_3d_pro", "fcf18780009900"),
    "logitech-g27": ("logitech_g27", "080000e87fffffff73789c"),
    "logitech-f310": ("logitech_f310_directinput", "8080808008000000"),
}
"""Profile -> facts of the device in tests/data/hid, and its report at rest."""
MISSION = """
mission: kernel-hid
robot: {root}/missions/robots/artemis.yaml
bus: {{interface: socketcan, channel: {channel}}}
inputs:
  hand: {{plugin: gamepad, profile: {profile}, max_speed_m_s: 0.3}}
steps:
  - calibrate: {{steering: from_potentiometers}}
  - teleop: {{input: hand, until: {{button: done}}}}
"""
PATIENCE = 240.0
"""Longest time for anything to come [s], on the slowest machine."""
STANDS = 0.005
"""[m/s]."""
REPORTS, STOPS = 20, 3
"""So often each is timed."""
SETTLED, TICK = 0.7, 0.02
"""After the first time a robot drives as fast as is wished [s]."""
SET_POINTS, STOP_FRAMES, QUICK_STOP = (0x201, 0x202), range(0x301, 0x305), 0x0B
"""RxPDO 1 of the traction drives; RxPDO 2 of all drives, and its controlword (firmware specification 2010, 8.1.3)."""


class Wrong(Exception):
    """It is not as it has to be."""


class Impossible(Exception):
    """It cannot be tried here."""


@dataclass
class Hand:
    """A device, and what a hand does with it."""

    profile: Profile
    descriptor: Descriptor
    raw: bytes
    rest: bytes

    @classmethod
    def of(cls, name: str) -> Hand:
        file, rest = DEVICES[name]
        facts = yaml.safe_load((ROOT / "tests/data/hid" / f"{file}.yaml").read_text())
        raw = bytes.fromhex(facts["report_descriptor"])
        return cls(profile_named(name), parse_descriptor(raw), raw, bytes.fromhex(rest))

    def plug(self) -> UhidDevice:
        device = self.profile.parts[""]
        made = UhidDevice(self.profile.name, device.vendor, device.product, self.raw)
        places = f"0003:{device.vendor:04X}:{device.product:04X}.*/hidraw/hidraw*"
        deadline = time.monotonic() + 10.0
        while not list(Path("/sys/bus/hid/devices").glob(places)):
            if time.monotonic() > deadline:
                made.close()
                raise Impossible(
                    "the kernel made no hidraw device of it: a driver of its own wants a true USB device; try "
                    "`echo 1 > /sys/module/hid/parameters/ignore_special_drivers` before"
                )
            time.sleep(0.1)
        return made

    def report(self, *roles: str, forward: float = 0.0) -> bytes:
        """Buttons of these roles are down, and it is pushed forward (or the gas pedal down) from 0 to 1."""
        values: dict[str, int] = {self.profile.buttons[role]: 1 for role in roles}
        axis = self.profile.axes["y" if self.profile.kind == "stick" else "gas"]
        low, high = (axis.maximum, axis.minimum) if axis.inverted else (axis.minimum, axis.maximum)
        start = low if axis.centre is None else axis.centre
        values[axis.field] = round(start + forward * (high - start))
        return self._packed(values)

    def _packed(self, values: Mapping[str, int]) -> bytes:
        bits = int.from_bytes(self.rest, "little")
        for field in self.descriptor.fields:
            if field.name in values:
                first = field.bit + 8 * self.descriptor.has_report_ids
                mask = (1 << field.bits) - 1
                bits = bits & ~(mask << first) | (values[field.name] & mask) << first
        return bits.to_bytes(len(self.rest), "little")


class Stopwatch:
    """Times from a report of a device to the frame on the wire that carries it, by the kernel's time stamps."""

    def __init__(self, channel: str, slow: float) -> None:
        self._channel, self._slow, self._dice = channel, slow, random.Random(1)
        self._reports: list[float] = []
        self._stops: list[float] = []

    def report(self, device: UhidDevice, report: bytes) -> None:
        """To the first set-point that differs; the robot was driving at one speed."""
        self._reports.append(self._took(device, report, lambda id, data, last: id in SET_POINTS and data != last))

    def stop(self, device: UhidDevice, report: bytes) -> None:
        """To the first quick stop."""
        self._stops.append(
            self._took(device, report, lambda id, data, last: id in STOP_FRAMES and data[0] == QUICK_STOP)
        )

    def told(self) -> str:
        """What was measured, for people."""
        kinds = (("report to set-point frame", self._reports), ("stop button to quick-stop frame", self._stops))
        parts = [f"{name} {_milliseconds(times)}" for name, times in kinds]
        return "; ".join(parts) + (f" (measured, divided by {self._slow:g})" if self._slow != 1.0 else "")

    def _took(self, device: UhidDevice, report: bytes, carries: Callable[[int, bytes, bytes], bool]) -> float:
        """[s], of artemis' own time.

        Raises:
            Wrong: no frame carries it.
        """
        last: dict[int, bytes] = {}
        with can.Bus(interface="socketcan", channel=self._channel) as bus:
            settled = time.monotonic() + (SETTLED + self._dice.uniform(0.0, TICK)) * self._slow
            while (left := settled - time.monotonic()) > 0:
                if (frame := bus.recv(left)) is not None:
                    last[frame.arbitration_id] = bytes(frame.data)
            sent = time.time()
            device.send(report)
            while time.time() < sent + PATIENCE:
                frame = bus.recv(PATIENCE)
                if frame is None:
                    break
                id, data = frame.arbitration_id, bytes(frame.data)
                if frame.timestamp > sent and carries(id, data, last.get(id, data)):
                    return (frame.timestamp - sent) / self._slow
                last[id] = data
        raise Wrong("no frame carries a report")


def _milliseconds(times: list[float]) -> str:
    return f"{1000 * median(times):.1f} ms, at most {1000 * max(times):.1f} ms of {len(times)}"


class Told:
    """What a program prints, line by line."""

    def __init__(self, stream: IO[str]) -> None:
        self.lines: list[str] = []
        self._queue: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        threading.Thread(target=self._read, args=(stream,), daemon=True).start()

    def wait_for(self, *texts: str) -> str:
        """The next line in which one of the texts stands."""
        deadline = time.monotonic() + PATIENCE
        while (line := self._queue.get(timeout=max(0.1, deadline - time.monotonic()))) is not None:
            self.lines.append(line)
            if any(text in line for text in texts):
                return line
        raise Wrong(f"ended without any of {texts}")

    def come(self) -> list[str]:
        """Lines that came meanwhile."""
        found = []
        while not self._queue.empty():
            if (line := self._queue.get()) is not None:
                found.append(line)
        self.lines += found
        return found

    def _read(self, stream: IO[str]) -> None:
        for line in stream:
            self._queue.put(line.rstrip())
        self._queue.put(None)


@contextmanager
def started(*command: str, environment: Mapping[str, str]) -> Iterator[tuple[subprocess.Popen[str], Told]]:
    """An `artemis` command, killed at the end if it still runs."""
    pipe = subprocess.PIPE
    artemis = [str(Path(__file__).with_name("slowed.py"))] if "FAKETIME" in environment else ["-m", "artemis"]
    with subprocess.Popen(
        [sys.executable, *artemis, *command],
        stdin=subprocess.DEVNULL,
        stdout=pipe,
        stderr=subprocess.STDOUT,
        text=True,
        bufsize=1,
        env={**os.environ, "PYTHONUNBUFFERED": "1", **environment},
    ) as process:
        assert process.stdout is not None
        try:
            yield process, Told(process.stdout)
        finally:
            process.kill()


def drive(name: str, channel: str, slow: float, environment: Mapping[str, str]) -> str:
    """Drive, unplug on the way, plug in again, go on, end. What was measured, for people.

    Raises:
        Wrong: the robot did what it must not, or did not what it must.
    """
    hand, stopwatch = Hand.of(name), Stopwatch(channel, slow)
    with tempfile.TemporaryDirectory() as folder:
        mission = Path(folder) / "mission.yaml"
        mission.write_text(MISSION.format(root=ROOT, channel=channel, profile=name))
        robot = Path(folder) / "robots"
        robot.mkdir()
        (robot / "artemis.yaml").write_bytes((ROOT / "missions/robots/artemis.yaml").read_bytes())
        mission.write_text(mission.read_text().replace(f"{ROOT}/missions/", ""))
        sim = "sim", str(robot / "artemis.yaml"), "--interface", "socketcan", "--channel", channel
        with started(*sim, environment=environment) as (_, drives):
            drives.wait_for("Ctrl-C ends")
            device = hand.plug()
            device.send(hand.rest)
            with started("run", str(mission), environment=environment) as (run, told):
                try:
                    act(hand, device, told, slow, stopwatch)
                except (Wrong, queue.Empty) as error:
                    raise Wrong(
                        "\n    ".join([str(error) or "nothing more comes", *told.lines, *told.come()])
                    ) from None
                if run.wait(PATIENCE) != 0:
                    raise Wrong("\n    ".join([f"exit status {run.returncode}", *told.lines, *told.come()]))
        (folder_of_run,) = (Path(folder) / "runs").iterdir()
        return f"{judge(folder_of_run)}; {stopwatch.told()}"


def act(hand: Hand, device: UhidDevice, told: Told, slow: float, stopwatch: Stopwatch) -> None:
    """What a person does: drive, lose the device, plug it in with the stick pushed, release, arm, drive, end."""

    def drive() -> None:
        device.send(hand.report("enable"))
        device.send(hand.report("enable", forward=1.0))
        told.wait_for("teleop     driving")
        time.sleep(1.0 * slow)

    def release_and_arm() -> None:
        device.send(hand.rest)
        time.sleep(1.5 * slow)
        device.send(hand.report("arm"))
        device.send(hand.rest)
        told.wait_for("hold the enable button")

    told.wait_for("release the controls")  # nothing is known of a device before its first report
    device.send(hand.rest)
    told.wait_for("hold the enable button")
    drive()
    device.close()
    told.wait_for("INP-01")
    told.wait_for("quickstop")
    device = hand.plug()
    time.sleep(0.5)
    device.send(hand.report("enable", forward=1.0))
    time.sleep(3.0 * slow)
    if any("driving" in line for line in told.come()):
        raise Wrong("it drives by itself after the device was plugged in again")
    release_and_arm()
    drive()
    for number in range(REPORTS):
        stopwatch.report(device, hand.report("enable", forward=1.0 if number % 2 else 0.7))
    for number in range(STOPS):
        if number > 0:
            drive()
        stopwatch.stop(device, hand.report("enable", "quickstop", forward=1.0))
        told.wait_for("request    quick stop")
        release_and_arm()
    device.send(hand.report("done"))
    device.send(hand.rest)
    told.wait_for("report  ")
    device.close()


def judge(run: Path) -> str:
    """Whether the robot stopped in time, and stood until it was armed; by the recording.

    Raises:
        Wrong: it did not.
    """
    moving = [
        (tick.snapshot.time, tick.mode.value, abs(tick.snapshot.odometry.speed)) for tick in Recording(run).ticks()
    ]
    lost = next(time for time, mode, _ in moving if mode == "quickstop")
    stopped = next(time for time, mode, speed in moving if time >= lost and speed < STANDS)
    armed = next(time for time, mode, _ in moving if time > stopped and mode == "teleop")
    if pushed := [time for time, _, speed in moving if stopped + 0.3 < time < armed and speed > 2 * STANDS]:
        raise Wrong(f"it moved at {pushed[0]:.2f} s, before it was armed again at {armed:.2f} s")
    distance = max(speed for _, _, speed in moving)
    return f"up to {distance:.2f} m/s; unplugged, it stood {stopped - lost:.2f} s after that was noticed"


def main() -> int:
    """Drive by each device; 1 if something was wrong."""
    parser = argparse.ArgumentParser(description="Drive by devices that are made with /dev/uhid.")
    parser.add_argument("--slow", type=float, default=1.0, help="so many times slower, with libfaketime")
    parser.add_argument("--channel", default="vcan0")
    parser.add_argument("--device", action="append", choices=list(DEVICES))
    options = parser.parse_args()
    if not os.access("/dev/uhid", os.R_OK | os.W_OK):
        print("SKIP /dev/uhid: is missing, or not for this user")
        return 0
    if not Path(f"/sys/class/net/{options.channel}").exists():
        print(f"SKIP {options.channel}: no such CAN interface")
        return 0
    environment = prepared(options.slow)
    names = options.device or DEVICES
    return tried({name: partial(drive, name, options.channel, options.slow, environment) for name in names})


def prepared(slow: float) -> dict[str, str]:
    """What the environment of commands has to be, so that time passes so many times slower; SIGTERM ends the tries."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    if slow == 1.0:
        return {}
    found = subprocess.run(["faketime", "-f", "+0", "printenv", "LD_PRELOAD"], capture_output=True, text=True)
    return {"LD_PRELOAD": found.stdout.strip(), "FAKETIME": f"+0 x{1 / slow}"}


def tried(tries: Mapping[str, Callable[[], str]]) -> int:
    """Try each, and print what became of it, by its name; 1 if something was wrong."""
    failed = 0
    for name, attempt in tries.items():
        try:
            print(f"PASS {name}: {attempt()}", flush=True)
        except Impossible as error:
            print(f"SKIP {name}: {error}", flush=True)
        except Wrong as error:
            failed = 1
            print(f"FAIL {name}: {error}", flush=True)
    return failed


if __name__ == "__main__":
    raise SystemExit(main())
