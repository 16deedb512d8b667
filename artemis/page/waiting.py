"""A page that waits: who has control, what is selected, what was started. Values and times only; no socket, no process.

One browser has control. It chooses a mission and starts it; one on a real robot by a second act. One run at a time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from artemis.bridges.page.session import GiveBack, Take, decoded
from artemis.page.mission_folder import CheckedMission

SURE_AFTER, SURE_UNTIL = 0.8, 30.0
"""A second act counts from then until then after the first [s]: not two taps of one finger, nor one long ago."""
MOST_MESSAGES, MESSAGE_TIME = 20, 1.0
"""A browser that sends more in this time [s] is disconnected."""

File = Annotated[str, Meta(max_length=255)]
Hash = Annotated[str, Meta(max_length=64)]
State = Literal["waiting", "starting", "running", "ending"]


class Start(Struct, frozen=True, tag_field="t", tag="start", forbid_unknown_fields=True):
    """Starts a mission as it was checked; on a real robot it is asked once more."""

    file: File
    hash: Hash


class Confirm(Struct, frozen=True, tag_field="t", tag="confirm", forbid_unknown_fields=True):
    """The second act, for a real robot."""

    file: File
    hash: Hash


class Cancel(Struct, frozen=True, tag_field="t", tag="cancel", forbid_unknown_fields=True):
    """A request to end what was started: needs no control."""


class CheckAgain(Struct, frozen=True, tag_field="t", tag="check", forbid_unknown_fields=True):
    """A request to check all missions again."""


Wanted = Take | GiveBack | Start | Confirm | Cancel | CheckAgain
_DECODER = msgspec.json.Decoder(Wanted)


def wanted(text: str | bytes) -> Wanted:
    """A message of a browser. Raises MalformedFrame."""
    found: Wanted = decoded(_DECODER, text)
    return found


@dataclass(slots=True, eq=False)
class Watcher:
    """One browser, as long as it is connected."""

    who: str
    refused: str = ""
    """Why its last wish was not granted."""
    begun: float = 0.0
    messages: int = 0

    def may_say(self, now: float) -> bool:
        """It has not sent too much."""
        if now - self.begun > MESSAGE_TIME:
            self.begun, self.messages = now, 0
        self.messages += 1
        return self.messages <= MOST_MESSAGES


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    """How the last run ended."""

    file: str
    mission: str
    who: str
    date: str
    """In UTC (ISO 8601)."""
    status: int
    outcome: str
    lines: list[str]


@dataclass(slots=True)
class Waiting:
    """All browsers of one page."""

    missions: Callable[[str], CheckedMission | None]
    """The mission in a file."""
    begin: Callable[[CheckedMission], str]
    """Starts a mission; why it cannot be, or nothing."""
    cancel: Callable[[], None]
    """Ends what was started."""
    check: Callable[[], None]
    """Has all checked again."""
    changed: Callable[[], None]
    """Called when browsers must be informed."""
    state: State = "waiting"
    owner: Watcher | None = None
    chosen: CheckedMission | None = None
    """What was started."""
    started_by: str = ""
    last: Ended | None = None
    _asked: tuple[CheckedMission, float] | None = field(default=None)
    """What its owner is asked about once more, and since when."""

    @property
    def asked(self) -> CheckedMission | None:
        """What the operator who has control must confirm."""
        return None if self._asked is None else self._asked[0]

    def obey(self, watcher: Watcher, said: Wanted, now: float) -> None:
        """Take a message of a browser at `now` [s]."""
        watcher.refused = ""
        match said:
            case Take():
                self._take(watcher, said.who)
            case GiveBack():
                self.left(watcher)
            case Cancel():
                if self.owner is watcher:
                    self._asked = None
                if self.state in ("starting", "ending"):  # in between the run's own page stops it
                    self.cancel()
            case CheckAgain():
                self.check()
            case Start() | Confirm() if self.owner is not watcher:
                watcher.refused = "take control first"
            case Start():
                self._start(watcher, said, now)
            case Confirm():
                self._confirm(watcher, said, now)
        self.changed()

    def left(self, watcher: Watcher) -> None:
        """It gives control back, or is disconnected; what was started continues."""
        if self.owner is watcher:
            self.owner, self._asked = None, None
            self.changed()

    def over(self, ended: Ended) -> None:
        """The run has ended."""
        self.state, self.chosen, self.last = "waiting", None, ended
        self.changed()

    def _take(self, watcher: Watcher, name: str) -> None:
        if self.owner is not None and self.owner is not watcher:
            watcher.refused = f"{self.owner.who} has control"
            return
        if name and name.isprintable() and self.owner is None:
            watcher.who = f"{name} at {watcher.who.rpartition(' at ')[2]}"
        self.owner = watcher

    def _start(self, watcher: Watcher, said: Start, now: float) -> None:
        mission, watcher.refused = self._startable(said)
        if mission is not None and not mission.simulated:
            self._asked = mission, now
        elif mission is not None:
            self._begin(watcher, mission)

    def _confirm(self, watcher: Watcher, said: Confirm, now: float) -> None:
        asked, self._asked = self._asked, None
        mission, watcher.refused = self._startable(said)
        if mission is None:
            return
        if asked is None or asked[0].hash != said.hash or now - asked[1] > SURE_UNTIL:
            watcher.refused = "what was asked is no longer so: start it again"
        elif now - asked[1] < SURE_AFTER:
            self._asked = asked
            watcher.refused = "confirmed too quickly: read the question first"
        else:
            self._begin(watcher, mission)

    def _startable(self, said: Start | Confirm) -> tuple[CheckedMission | None, str]:
        """The mission as it was shown, or why it cannot be started."""
        if self.state != "waiting" or self.chosen is not None:
            return None, f"{self.started_by} has started {self.chosen.mission if self.chosen else 'a mission'}"
        mission = self.missions(said.file)
        if mission is None:
            return None, f"{said.file} no longer exists"
        if not mission.may_start:
            return None, f"{said.file} has errors, or is being checked"
        if mission.hash != said.hash:
            return None, f"{said.file} has changed: read it again"
        return mission, ""

    def _begin(self, watcher: Watcher, mission: CheckedMission) -> None:
        watcher.refused = self.begin(mission)
        if not watcher.refused:
            self.state, self.chosen, self.started_by, self._asked = "starting", mission, watcher.who, None

    def seat(self, watcher: Watcher) -> dict[str, Any]:
        """The message to this browser about who has control and what must be confirmed."""
        mine = self.owner is watcher
        asked = self.asked if mine else None
        return {
            "mine": mine,
            "who": self.owner.who if self.owner else "",
            "refused": watcher.refused,
            "asked": None if asked is None else asked.file,
        }
