"""The contract suites find what is wrong: plugins that break one rule each, and the tests that must see it."""

# ruff: noqa: ANN401  (bad plugins answer anything)

from __future__ import annotations

import math
import re
from collections.abc import Callable
from itertools import count
from typing import Any, ClassVar

import pytest
from msgspec.structs import replace
from pydantic import ConfigDict

from artemis.config import Config
from artemis.motion.path import Path
from artemis.plugins.contracts import Following, PluginContext
from artemis.plugins.followers.indiveri import IndiveriConfig, IndiveriFollower
from artemis.testing import contracts
from artemis.testing.contracts import FollowerContract, InputContract, PluginContract
from artemis.values import OperatorInput, Snapshot

SAMPLING = {
    "test_samples_are_whole",
    "test_samples_are_in_range",
    "test_begins_at_rest",
    "test_neutral_means_released",
    "test_age_is_time_since_the_sample",
}
DRIVING = {
    "test_follows_a_straight",
    "test_follows_a_circle",
    "test_comes_onto_its_path",
    "test_commands_are_possible",
    "test_finishes_at_the_end",
    "test_tracking_is_true",
    "test_same_snapshots_give_same_commands",
    "test_start_begins_anew",
    "test_step_does_not_wait",
}
"""Tests that cannot say anything about a plugin that does not even answer."""


class GoodConfig(Config):
    speed_m_s: float = 0.2


class GoodInput:
    """Rests for two seconds and then drives; moved, it drives at once."""

    Config: ClassVar[type[Config]] = GoodConfig

    def __init__(self, config: GoodConfig, context: PluginContext) -> None:
        self.config, self.name = config, context.name
        self.moved = False
        self.closed = 0

    def read(self, now: float) -> Any:
        drives = self.moved or now >= 2.0
        speed = self.config.speed_m_s if drives else 0.0
        return OperatorInput(
            source=self.name, speed=speed, steering=0.1, enabled=drives, neutral=not drives, axes=(0.5,), age=0.0
        )

    def close(self) -> None:
        self.closed += 1


class GoodFollower(IndiveriFollower):
    Config: ClassVar[type[Config]] = GoodConfig

    def __init__(self, config: GoodConfig, context: PluginContext) -> None:
        super().__init__(IndiveriConfig(speed_m_s=0.6), context)


class Watch:
    """Instead of the suites' stopwatch: plugins spend its time."""

    def __init__(self) -> None:
        self.time = 0.0

    def __call__(self) -> float:
        return self.time


WATCH = Watch()


@pytest.fixture(autouse=True)
def _no_real_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(contracts, "stopwatch", WATCH)


def names_of_tests(suite: type[PluginContract]) -> set[str]:
    return {name for name in dir(suite) if name.startswith("test_")}


def failures(suite: type[PluginContract], **attributes: Any) -> dict[str, str]:
    """Tests that fail for a suite with these attributes, and why."""
    tried = type("Tried", (suite,), attributes)()
    found = {}
    for name in sorted(names_of_tests(suite)):
        try:
            getattr(tried, name)()
        except Exception as error:  # noqa: BLE001  (a test fails by whatever it raises)
            found[name] = f"{type(error).__name__}: {error}"
    return found


def check(found: dict[str, str], expected: dict[str, str]) -> None:
    assert found.keys() == expected.keys(), found
    assert not [f"{name}: {found[name]}" for name, words in expected.items() if not re.search(words, found[name])]


def press(suite: InputContract, device: GoodInput) -> None:
    device.moved = True


def test_a_good_input_passes() -> None:
    assert failures(InputContract, plugin=GoodInput) == {}
    assert failures(InputContract, plugin=GoodInput, move=press) == {}


def test_a_good_follower_passes() -> None:
    assert failures(FollowerContract, plugin=GoodFollower) == {}


# ---------------------------------------------------------------------------------------------- inputs


Change = Callable[[OperatorInput, float], Any]


def bad(**members: Any) -> type[Any]:
    """A good input but for these members."""
    return type("BadInput", (GoodInput,), members)


def says(change: Change, **members: Any) -> type[Any]:
    """An input that changes its samples."""
    return bad(read=lambda self, now: change(GoodInput.read(self, now), now), **members)


def aged(age: Callable[[float], float | None]) -> type[Any]:
    return says(lambda sample, now: replace(sample, age=age(now)))


class SlackConfig(GoodConfig):
    model_config = ConfigDict(extra="ignore")


class LooseConfig(GoodConfig):
    model_config = ConfigDict(strict=False)


class OtherConfig(Config):
    other: float


def spends(sample: OperatorInput, now: float) -> OperatorInput:
    WATCH.time += 0.016
    return sample


OTHER_CLOCK = count()
TEXT: Any = "fast"


def looks_at_another_clock(sample: OperatorInput, now: float) -> OperatorInput:
    return replace(sample, steering=1e-6 * next(OTHER_CLOCK))


def close_once(device: GoodInput) -> None:
    if device.closed:
        raise OSError("bad file descriptor")
    device.closed += 1


UNREAD = type("BadInput", (), {name: value for name, value in vars(GoodInput).items() if name != "read"})
UNUSABLE = SAMPLING | {"test_read_does_not_wait", "test_same_reads_give_same_samples", "test_close_is_harmless"}

BAD_INPUTS: dict[str, tuple[type[Any], dict[str, str]]] = {
    "has no read": (UNREAD, dict.fromkeys(UNUSABLE, "") | {"test_class_meets_its_contract": r"no method read\(\)"}),
    "has another contract": (bad(contract=7), {"test_class_meets_its_contract": "contract 7"}),
    "takes any key": (bad(Config=SlackConfig), {"test_config_is_strict": "extra='ignore'"}),
    "takes loose types": (bad(Config=LooseConfig), {"test_config_is_strict": "strict=False"}),
    "wants other options": (
        bad(Config=OtherConfig),
        dict.fromkeys(UNUSABLE, "other") | {"test_config_is_strict": "other"},
    ),
    "gives nothing": (says(lambda *_: None), dict.fromkeys(SAMPLING, "PLG-06")),
    "gives text": (says(lambda sample, _: replace(sample, speed=TEXT)), dict.fromkeys(SAMPLING, "PLG-06")),
    "has its own name": (
        says(lambda sample, _: replace(sample, source="pad")),
        {"test_samples_are_whole": "'pad', not context.name"},
    ),
    "gives no number": (
        says(lambda sample, _: replace(sample, steering=math.inf)),
        {"test_samples_are_in_range": "INP-06"},
    ),
    "gives raw axes": (says(lambda sample, _: replace(sample, axes=(512,))), {"test_samples_are_in_range": "INP-06"}),
    "is too fast": (
        says(lambda sample, _: replace(sample, speed=5 * sample.speed)),
        {"test_samples_are_in_range": r"speed=1\.0.* faster than the robot"},
    ),
    "steers in degrees": (
        says(lambda sample, _: replace(sample, steering=-20.0)),
        {"test_samples_are_in_range": "steered further"},
    ),
    "begins enabled": (
        says(lambda sample, _: replace(sample, enabled=True, neutral=False)),
        {"test_begins_at_rest": "is enabled"},
    ),
    "begins deflected": (
        says(lambda sample, _: replace(sample, neutral=False)),
        {"test_begins_at_rest": "neither neutral nor"},
    ),
    "is always neutral": (
        says(lambda sample, _: replace(sample, neutral=True)),
        {"test_neutral_means_released": r"read\(2\.00\)"},
    ),
    "is from the future": (aged(lambda _: -0.01), {"test_samples_are_in_range": "a negative age"}),
    "forgets its samples": (
        aged(lambda now: 0.0 if now < 3.0 else None),
        {"test_age_is_time_since_the_sample": r"read\(3\.00\) gave age None"},
    ),
    "ages in milliseconds": (aged(lambda now: 1000 * now), {"test_age_is_time_since_the_sample": "faster than time"}),
    "takes long": (says(spends), {"test_read_does_not_wait": "takes 16 ms, 15 are allowed"}),
    "looks at another clock": (
        says(looks_at_another_clock),
        {"test_same_reads_give_same_samples": "another time than `now`"},
    ),
    "closes once": (bad(close=close_once), {"test_close_is_harmless": "OSError: bad file descriptor"}),
}
UNMOVED: dict[str, tuple[type[Any], str]] = {
    "does not arrive": (says(lambda sample, _: OperatorInput(source=sample.source, age=0.0)), "the sample is still"),
    "is of no time": (aged(lambda _: None), "no sample has ever come"),
    "is old": (aged(lambda _: 0.2), r"0\.200 s old"),
}


@pytest.mark.parametrize("what", BAD_INPUTS)
def test_a_bad_input_fails(what: str) -> None:
    plugin, expected = BAD_INPUTS[what]
    check(failures(InputContract, plugin=plugin, duration=5.0), expected)


@pytest.mark.parametrize("what", UNMOVED)
def test_an_input_whose_movement_is_lost_fails(what: str) -> None:
    plugin, words = UNMOVED[what]
    check(failures(InputContract, plugin=plugin, move=press, duration=5.0), {"test_movement_arrives": words})


def test_a_live_device_may_report_when_it_likes() -> None:
    assert failures(InputContract, plugin=says(looks_at_another_clock, live=True), duration=5.0) == {}


# ---------------------------------------------------------------------------------------------- followers


def answers(change: Callable[[Following, Snapshot], Any]) -> type[Any]:
    """A follower that changes its answers."""

    class BadFollower(GoodFollower):
        def step(self, snapshot: Snapshot) -> Any:
            return change(super().step(snapshot), snapshot)

    return BadFollower


def commands(change: Callable[[float, float], tuple[float, float]]) -> type[Any]:
    """A follower that changes speed and angle while it drives."""

    def changed(answer: Following, _: Snapshot) -> Following:
        speed, steering = change(answer.command.speed, answer.command.steering)
        return (
            answer
            if answer.finished
            else replace(answer, command=replace(answer.command, speed=speed, steering=steering))
        )

    return answers(changed)


def tells(**changes: Callable[[float], float]) -> type[Any]:
    """A follower that tells something else of its tracking."""

    def changed(answer: Following, _: Snapshot) -> Following:
        told = {name: change(getattr(answer.tracking, name)) for name, change in changes.items()}
        return replace(answer, tracking=replace(answer.tracking, **told))

    return answers(changed)


def finishes(when: Callable[[Following, Snapshot], bool]) -> type[Any]:
    return answers(lambda answer, snapshot: replace(answer, finished=when(answer, snapshot)))


class NeverReset(GoodFollower):
    """Goes on where it was when it is started again."""

    begun = False

    def start(self, path: Path, snapshot: Snapshot) -> None:
        if not self.begun:
            super().start(path, snapshot)
        self.begun = True


class Misled(GoodFollower):
    """Believes the robot 0.3 m to the right of where it is."""

    def step(self, snapshot: Snapshot) -> Following:
        pose = snapshot.pose.pose
        pose = replace(pose, x=pose.x + 0.3 * math.sin(pose.heading), y=pose.y - 0.3 * math.cos(pose.heading))
        return super().step(replace(snapshot, pose=replace(snapshot.pose, pose=pose)))


class EachAnother(GoodFollower):
    """Steers a little further to the left than the one that was made before."""

    made = count()

    def __init__(self, config: GoodConfig, context: PluginContext) -> None:
        super().__init__(config, context)
        self.own = 1e-9 * next(self.made)

    def step(self, snapshot: Snapshot) -> Following:
        answer = super().step(snapshot)
        return replace(answer, command=replace(answer.command, steering=answer.command.steering + self.own))


def spends_time(answer: Following, _: Snapshot) -> Following:
    WATCH.time += 0.016
    return answer


def creeps_on(answer: Following, snapshot: Snapshot) -> Following:
    goes_on = answer.finished and snapshot.odometry.speed > 0.05
    return replace(answer, command=replace(answer.command, speed=0.01)) if goes_on else answer


def jumps_back(answer: Following, snapshot: Snapshot) -> bool:
    return answer.finished and snapshot.sensed.index % 2 == 0


WAYS = {"test_follows_a_straight", "test_follows_a_circle", "test_comes_onto_its_path"}
LOST = {name: "PTH-08" for name in DRIVING if "straight" not in name and "finishes" not in name and "wait" not in name}

BAD_FOLLOWERS: dict[str, tuple[type[Any], dict[str, str]]] = {
    "gives nothing": (answers(lambda *_: None), dict.fromkeys(DRIVING, "PLG-06")),
    "tracks no number": (tells(cross_track=lambda _: math.nan), dict.fromkeys(DRIVING, "PLG-06")),
    "commands no number": (commands(lambda speed, _: (speed, math.nan)), dict.fromkeys(DRIVING, "RUN-11")),
    "never finishes": (finishes(lambda *_: False), dict.fromkeys(DRIVING, "PTH-08")),
    "steers the wrong way": (commands(lambda speed, steering: (speed, -steering)), LOST),
    "sees itself elsewhere": (
        Misled,
        {
            "test_follows_a_straight": "m from the path",
            "test_follows_a_circle": "m from the path",
            "test_comes_onto_its_path": r"\+0\.3\d m from the path after 5",
            "test_tracking_is_true": "cross_track",
        },
    ),
    "drives in km/h": (
        commands(lambda speed, steering: (3.6 * speed, steering)),
        {"test_commands_are_possible": "faster than the robot", "test_finishes_at_the_end": "came to rest at 3.2"},
    ),
    "steers too far": (
        commands(lambda speed, steering: (speed, steering if abs(steering) < 0.8 else math.copysign(1.1, steering))),
        {"test_commands_are_possible": "steered further"},
    ),
    "finishes early": (
        finishes(lambda answer, _: answer.tracking.arc_length > 1.0),
        {"test_finishes_at_the_end": "asks for 0.6 m/s"},
    ),
    "creeps on": (answers(creeps_on), {"test_finishes_at_the_end": "asks for 0.01 m/s"}),
    "jumps back": (finishes(jumps_back), {"test_finishes_at_the_end": "and then no longer"}),
    "counts right positive": (tells(cross_track=lambda left: -left), {"test_tracking_is_true": "cross_track"}),
    "counts degrees": (tells(heading_error=math.degrees), {"test_tracking_is_true": "heading_error"}),
    "does not count its distance": (tells(arc_length=lambda _: 0.0), {"test_tracking_is_true": "arc_length"}),
    "tells another length": (tells(length=lambda length: length - 1.0), {"test_tracking_is_true": "length"}),
    "is each another": (EachAnother, {"test_same_snapshots_give_same_commands": "a second follower"}),
    "is not reset": (NeverReset, {"test_start_begins_anew": "started again"}),
    "takes long": (answers(spends_time), {"test_step_does_not_wait": "takes 16 ms, 15 are allowed"}),
}


@pytest.mark.parametrize("what", BAD_FOLLOWERS)
def test_a_bad_follower_fails(what: str) -> None:
    plugin, expected = BAD_FOLLOWERS[what]
    check(failures(FollowerContract, plugin=plugin, patience=16.0), expected)


def test_every_test_of_the_suites_is_seen_to_fail() -> None:
    """Each alone, by some plugin; but for those of the distances, which fail together."""
    alone = {
        name
        for _, expected in (*BAD_INPUTS.values(), *BAD_FOLLOWERS.values())
        if len(expected) == 1
        for name in expected
    }
    assert alone | WAYS | {"test_movement_arrives"} == names_of_tests(InputContract) | names_of_tests(FollowerContract)
    assert WAYS < BAD_FOLLOWERS["sees itself elsewhere"][1].keys()
