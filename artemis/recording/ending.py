"""Why a run ends before its last step, in words: the faults that stop the robot, and what somebody asked for. Pure."""

from __future__ import annotations

from artemis.values import Cause, Fault, Mode, Tick

_STOPPED = (Mode.FAULT, Mode.QUICKSTOP, Mode.END)


class Ending:
    """Sees the ticks of a run in which a mode begins, and those that fail it."""

    def __init__(self) -> None:
        self._told: list[str] = []

    def see(self, tick: Tick) -> None:
        """The next one. What stopped the robot and was recovered from is forgotten."""
        if tick.cause is not None:
            if tick.mode not in _STOPPED:
                self._told.clear()
            elif words := _words(tick.cause):
                self._tell(words)
        if tick.wish.failed and tick.wish.fault is not None:
            self._tell(_named(tick.wish.fault))

    @property
    def reason(self) -> str:
        """What ends it, in the order in which it came; empty: neither a fault nor a request."""
        return ", then ".join(self._told)

    def _tell(self, words: str) -> None:
        if words not in self._told:
            self._told.append(words)


def _words(cause: Cause) -> str:
    if cause.request is not None:
        return f"{cause.request.value} requested"
    return ", ".join(map(_named, cause.faults))


def _named(fault: Fault) -> str:
    return f"{fault.id} {fault.text}"
