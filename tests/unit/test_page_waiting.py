"""A page that waits, in words: who has control, what may be started, what is asked once more."""

from __future__ import annotations

import json
from dataclasses import dataclass, field

import msgspec
import pytest

from artemis.bridges.operator.frames import MalformedFrame
from artemis.page.mission_folder import CheckedMission
from artemis.page.started_run import ending
from artemis.page.waiting import MOST_MESSAGES, SURE_AFTER, SURE_UNTIL, Ended, Waiting, Watcher, wanted

SIMULATED = CheckedMission(file="lap.yaml", mission="lap", robot="A", bus="simulation", simulated=True, hash="aa")
REAL = CheckedMission(file="real.yaml", mission="real", robot="A", bus="socketcan can0", hash="bb")
BROKEN = CheckedMission(file="broken.yaml", hash="cc", problems=("broken.yaml:1:1: no",))
UNCHECKED = CheckedMission(file="new.yaml", checked=False)


@dataclass
class Page:
    """What a page does with what browsers say."""

    known: dict[str, CheckedMission] = field(
        default_factory=lambda: {facts.file: facts for facts in (SIMULATED, REAL, BROKEN, UNCHECKED)}
    )
    done: list[str] = field(default_factory=list)
    problem: str = ""

    def __post_init__(self) -> None:
        self.waiting = Waiting(
            missions=lambda file: self.known.get(file),
            begin=self._begin,
            cancel=lambda: self.done.append("cancel"),
            check=lambda: self.done.append("check"),
            changed=lambda: None,
        )
        self.one, self.other = Watcher("1.1.1.1"), Watcher("2.2.2.2")

    def _begin(self, mission: CheckedMission) -> str:
        self.done.append(mission.file)
        return self.problem

    def say(self, watcher: Watcher, now: float = 0.0, **words: object) -> str:
        """Why it is refused, or nothing."""
        self.waiting.obey(watcher, wanted(json.dumps(words)), now)
        return watcher.refused

    def start(self, watcher: Watcher, mission: CheckedMission, now: float = 0.0, **changed: str) -> str:
        words: dict[str, object] = {"t": "start", "file": mission.file, "hash": mission.hash, **changed}
        return self.say(watcher, now, **words)


@pytest.fixture
def page() -> Page:
    """Somebody has control."""
    made = Page()
    assert made.say(made.one, t="take", who="Firefox") == ""
    return made


def test_who_has_control_starts_and_one_run_goes_on_at_a_time(page: Page) -> None:
    assert page.say(page.other, t="take", who="x") == "Firefox at 1.1.1.1 has control"
    assert page.start(page.other, SIMULATED) == "take control first"
    assert page.start(page.one, SIMULATED) == ""
    assert (page.done, page.waiting.state, page.waiting.chosen) == (["lap.yaml"], "starting", SIMULATED)
    page.waiting.left(page.one)
    page.say(page.other, t="take", who="Safari")
    assert page.start(page.other, SIMULATED) == "Firefox at 1.1.1.1 has started lap"
    page.waiting.state = "ending"
    assert page.start(page.other, REAL) == "Firefox at 1.1.1.1 has started lap"
    page.waiting.over(Ended(file="", mission="", who="", date="", status=0, outcome="done", lines=[]))
    assert page.start(page.other, SIMULATED) == ""
    assert page.done == ["lap.yaml", "lap.yaml"]


@pytest.mark.parametrize(
    ("mission", "changed", "words"),
    [
        (BROKEN, {}, "broken.yaml has errors, or is being checked"),
        (UNCHECKED, {}, "new.yaml has errors, or is being checked"),
        (SIMULATED, {"hash": "ab"}, "lap.yaml has changed: read it again"),
        (SIMULATED, {"file": "../lap.yaml"}, "../lap.yaml no longer exists"),
    ],
)
def test_only_what_was_checked_is_started(
    page: Page, mission: CheckedMission, changed: dict[str, str], words: str
) -> None:
    assert page.start(page.one, mission, 0.0, **changed) == words
    assert page.done == []


def test_a_real_robot_is_asked_about_once_more(page: Page) -> None:
    confirm = {"t": "confirm", "file": REAL.file, "hash": REAL.hash}
    assert page.say(page.one, 5.0, **confirm) == "what was asked is no longer so: start it again"
    page.start(page.one, REAL, 10.0)
    assert (page.done, page.waiting.seat(page.one)["asked"], page.waiting.seat(page.other)["asked"]) == (
        [],
        "real.yaml",
        None,
    )
    assert "too quick" in page.say(page.one, 10.0 + SURE_AFTER / 2, **confirm)
    assert page.say(page.other, 10.0 + SURE_AFTER, **confirm) == "take control first"
    page.say(page.other, 10.0, t="cancel")
    assert page.say(page.one, 10.0 + SURE_AFTER, **confirm) == ""
    assert (page.done, page.waiting.asked) == (["real.yaml"], None)


@pytest.mark.parametrize("event", ["later", "changed", "another", "given back", "cancelled"])
def test_what_is_no_longer_as_it_was_asked_is_not_started(page: Page, event: str) -> None:
    page.start(page.one, REAL, 10.0)
    now, confirm = 12.0, {"t": "confirm", "file": REAL.file, "hash": REAL.hash}
    match event:
        case "later":
            now = 10.1 + SURE_UNTIL
        case "changed":
            page.known[REAL.file] = msgspec.structs.replace(REAL, hash="dd")
        case "another":
            confirm = {"t": "confirm", "file": SIMULATED.file, "hash": SIMULATED.hash}
        case "given back":
            page.say(page.one, 11.0, t="release")
            page.say(page.one, 11.0, t="take")
        case "cancelled":
            page.say(page.one, 11.0, t="cancel")
    assert page.say(page.one, now, **confirm)
    assert page.done == []


def test_a_run_that_cannot_be_started_is_said(page: Page) -> None:
    page.problem = "no room for another process"
    assert page.start(page.one, SIMULATED) == page.problem
    assert (page.waiting.state, page.waiting.chosen) == ("waiting", None)


def test_what_begins_is_cancelled_by_anybody_and_all_checked_again(page: Page) -> None:
    page.say(page.other, t="cancel")
    page.start(page.one, SIMULATED)
    page.say(page.other, t="cancel")
    page.say(page.other, t="check")
    assert page.done == ["lap.yaml", "cancel", "check"]


def test_a_run_is_cancelled_while_it_begins_or_ends_and_not_while_its_own_page_is_there(page: Page) -> None:
    page.start(page.one, SIMULATED)
    page.waiting.state = "running"
    page.say(page.other, t="cancel")
    assert page.done == ["lap.yaml"]
    page.waiting.state = "ending"
    page.say(page.other, t="cancel")
    assert page.done == ["lap.yaml", "cancel"]


def test_who_says_too_much_or_nonsense_is_let_go() -> None:
    watcher = Watcher("1.1.1.1")
    assert [watcher.may_say(100.0) for _ in range(MOST_MESSAGES + 1)].count(False) == 1
    assert watcher.may_say(102.0)
    for text in ("", "{}", '{"t":"start"}', '{"t":"take","x":1}', '{"t":"start","file":"' + "x" * 300 + '","hash":""}'):
        with pytest.raises(MalformedFrame):
            wanted(text)


@pytest.mark.parametrize(
    ("status", "words"),
    [(0, "done"), (1, "failed"), (2, "nothing has moved"), (143, "SIGTERM"), (-9, "SIGKILL"), (99, "status 99")],
)
def test_exit_statuses_are_explained(status: int, words: str) -> None:
    assert words in ending(status)
