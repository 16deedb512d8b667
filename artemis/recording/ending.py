"""Why a run ends before its last step, in words: the faults that stop the robot, and what somebody asked for. Pure."""

from __future__ import annotations

from artemis.values import Cause, Fault, Mode, Tick

_STOPPED = (Mode.FAULT, Mode.QUICKSTOP, Mode.END)


class Ending:
    """Sees the ticks of a run in which a mode begins, and those that fail it."""

    def __init__(self) -> None:
        self._told: list[list[str]] = []

    def see(self, tick: Tick) -> None:
        """The next one. What stopped the robot and was recovered from is forgotten."""
        if tick.cause is not None:
            if tick.mode not in _STOPPED:
                self._told.clear()
            else:
                self._tell(*_words(tick.cause))
        if tick.wish.failed and tick.wish.fault is not None:
            self._tell(_named(tick.wish.fault))
        elif tick.wish.failed and not self._told and not tick.position.ended:
            self._tell(tick.wish.phase)  # no operator

    @property
    def reason(self) -> str:
        """What ends it, in the order in which it came; empty: its mission does."""
        return ", then ".join(", ".join(together) for together in self._told)

    def _tell(self, *words: str) -> None:
        """What came together; each is told once."""
        before = {word for together in self._told for word in together}
        if new := [word for word in words if word not in before]:
            self._told.append(new)


def _words(cause: Cause) -> list[str]:
    if cause.request is not None:
        return [f"{cause.request.value} requested"]
    return [_named(fault) for fault in cause.faults]


def _named(fault: Fault) -> str:
    return f"{fault.id} {fault.text}"
