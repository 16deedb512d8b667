"""What drives say of themselves between their feedback, as entries: emergencies, of a storm the first, and boot-ups."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from math import inf

from artemis.families.objects import LOST_HEARTBEAT
from artemis.recording.journal import Entry, Level
from artemis.states.init import PROOF
from artemis.values import DriveFeedback

STORM, STORM_TIME = 20, 1.0
"""More emergencies of a drive in this time [s] are only counted (DRV-33)."""
_PROVEN = ", as it has to: the proof that the drive notices a lost heartbeat"


class Emergencies:
    """Of all drives of a run."""

    def __init__(self) -> None:
        self.counting: dict[str, _Storm] = {}
        """By the drive, those of the last second."""

    def entries(self, time: float, drive: DriveFeedback, phase: str) -> Iterator[Entry]:
        """Emergencies and boot-ups of a drive, in a phase of its mode; of a storm of emergencies only the first."""
        if drive.emergencies:
            storm = self.counting.setdefault(drive.name, _Storm(time))
            for code in drive.emergencies:
                if storm.tells(code):
                    yield _emergency(time, drive.name, code, proof=phase == PROOF and code == LOST_HEARTBEAT)
        if drive.boots:
            yield Entry(time=time, kind="boot-up", text=drive.name, data={"drive": drive.name})

    def passed(self, time: float = inf) -> list[Entry]:
        """Of storms that are over at a run time [s] the emergencies that were only counted."""
        over = {drive: storm for drive, storm in self.counting.items() if time >= storm.begun + STORM_TIME}
        for drive in over:
            del self.counting[drive]
        return [storm.entry(drive) for drive, storm in over.items() if storm.untold]


class _Storm:
    """The emergencies of one drive in a second."""

    def __init__(self, begun: float) -> None:
        self.begun = begun
        self.untold: Counter[int] = Counter()
        self._told = 0

    def tells(self, code: int) -> bool:
        """Whether it gets an entry of its own; else it is counted."""
        if self._told < STORM:
            self._told += 1
            return True
        self.untold[code] += 1
        return False

    def entry(self, drive: str) -> Entry:
        """The one for all that had none."""
        codes = {code_name(code): count for code, count in sorted(self.untold.items())}
        text = f"{drive}: {self.untold.total()} more: " + ", ".join(f"{code} x {n}" for code, n in codes.items())
        data = {"drive": drive, "count": self.untold.total(), "codes": codes}
        return Entry(time=self.begun + STORM_TIME, kind="emergencies", text=text, level=Level.WARNING, data=data)


def code_name(code: int) -> str:
    """An EMCY error code for people; a negative one: the message was damaged."""
    return f"EMCY 0x{code:04X}" if code >= 0 else "damaged EMCY"


def _emergency(time: float, drive: str, code: int, *, proof: bool) -> Entry:
    level = Level.WARNING if code and not proof else Level.INFO  # code 0 says that the error is gone
    text = f"{drive}: {code_name(code)}{_PROVEN if proof else ''}"
    return Entry(time=time, kind="emergency", text=text, level=level, data={"drive": drive, "code": code})
