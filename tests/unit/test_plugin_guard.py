"""What plugins do instead of an answer, and what becomes of it."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pytest
from core_builders import PATH, StubFollower, following, snapshot
from msgspec import Struct
from msgspec.structs import replace
from robot_rig import StubInput

from artemis.config import Config
from artemis.errors import DeviceLost
from artemis.motion.path import Path
from artemis.plugins.answers import is_in_range, is_whole_input, plain_following
from artemis.plugins.contracts import Acting, Following, State
from artemis.plugins.guard import PluginGuard, Problem
from artemis.supervision import catalogue
from artemis.values import (
    Action,
    DriveCommand,
    LocatedPose,
    Mode,
    OperatorInput,
    Pose,
    Request,
    SetPoints,
    Severity,
    Snapshot,
    Tick,
    Tracking,
    Wish,
)

GOOD = OperatorInput(source="stick", speed=0.3, steering=-0.1, enabled=True, neutral=False, age=0.01, axes=(0.5, -1.0))


INITIAL = LocatedPose(pose=Pose(x=1.0), frame="map", source="stick")


class Desk:
    """A guard with one clock that plugins may spend."""

    def __init__(self, **inputs: Callable[[float], Any]) -> None:
        self.time = 0.0
        self.guard = PluginGuard({name: StubInput(answer) for name, answer in inputs.items()}, lambda: self.time)

    def read(self, now: float = 0.0) -> tuple[OperatorInput, ...]:
        return self.guard.read(now)

    def problems(self) -> list[tuple[str, str]]:
        return [(id, name) for id, name, _ in self.guard.take_problems()]

    def slow(self, *times: float, source: str = "stick") -> Callable[[float], OperatorInput]:
        """An input that takes these times, one after the other."""
        left = list(times)

        def answer(now: float) -> OperatorInput:
            self.time += left.pop(0)
            return replace(GOOD, source=source)

        return answer


def without_places(problems: list[Problem]) -> list[Problem]:
    """Without the line at which an error was raised."""
    return [(id, name, seen.partition(" at test_")[0]) for id, name, seen in problems]


# ---------------------------------------------------------------------------------------------- inputs


def test_good_samples_pass_as_they_are_in_the_order_of_the_inputs() -> None:
    b, a = replace(GOOD, source="b", age=0.1), replace(GOOD, source="a")
    desk = Desk(b=lambda now: b, a=lambda now: a)
    assert desk.read(0.1) == (b, a)
    assert desk.problems() == []


def test_input_that_raises_is_a_problem_with_its_error_and_the_others_are_read() -> None:
    def broken(now: float) -> OperatorInput:
        raise OSError("unplugged")

    other = replace(GOOD, source="other")
    desk = Desk(stick=broken, other=lambda now: other)
    assert desk.read() == (other,)
    assert without_places(desk.guard.take_problems()) == [("PLG-02", "stick", "OSError('unplugged')")]
    assert desk.problems() == [], "each is told once"


@pytest.mark.parametrize("garbage", [None, 42, "left", object(), (), {"speed": 1.0}, [GOOD]])
def test_what_is_no_sample_is_garbage_and_shown(garbage: object) -> None:
    desk = Desk(stick=lambda now: garbage)
    assert desk.read() == ()
    assert desk.guard.take_problems() == [("PLG-06", "stick", repr(garbage)[:200])]


def test_garbage_is_shown_up_to_a_length() -> None:
    desk = Desk(stick=lambda now: "x" * 1000)
    desk.read()
    assert [len(seen) for _, _, seen in desk.guard.take_problems()] == [200]


PARTS: list[dict[str, Any]] = [
    {"speed": "fast"},
    {"steering": None},
    {"age": "now"},
    {"axes": None},
    {"axes": [0.5]},
    {"axes": ("left",)},
    {"buttons": (1,)},
    {"buttons": None},
    {"enabled": "no"},
    {"enabled": None},
    {"neutral": 1},
    {"requests": ("quick stop",)},
    {"requests": None},
    {"requests": [Request.END]},
    {"answers": None},
    {"answers": ["left"]},
    {"answers": (1,)},
    {"source": None},
    {"raw": None},
    {"centred": ("left",)},
    {"shaped": [0.5]},
]


@pytest.mark.parametrize("part", PARTS, ids=str)
def test_sample_with_a_part_of_another_kind_is_garbage(part: dict[str, Any]) -> None:
    garbage = replace(GOOD, **part)
    assert not is_whole_input(garbage)
    desk = Desk(stick=lambda now: garbage)
    assert desk.read() == ()
    assert desk.problems() == [("PLG-06", "stick")]


def test_sample_in_the_name_of_another_input_is_garbage() -> None:
    desk = Desk(wheel=lambda now: replace(GOOD, speed=0.7), stick=lambda now: replace(GOOD, enabled=False))
    (sample,) = desk.read()
    assert (sample.source, sample.enabled) == ("stick", False)
    assert desk.guard.take_problems() == [("PLG-06", "wheel", "source 'stick': write context.name there")]


def test_device_that_is_gone_is_lost_and_asked_again() -> None:
    def unplugged(now: float) -> OperatorInput:
        if now < 1.0:
            raise DeviceLost("stick", "unplugged")
        return GOOD

    desk = Desk(stick=unplugged)
    assert desk.read(0.0) == ()
    assert desk.guard.take_problems() == [("INP-01", "stick", "unplugged")]
    assert desk.read(1.0) == (GOOD,)


def test_garbage_is_shown_without_what_is_as_usual() -> None:
    desk = Desk(stick=lambda now: OperatorInput(source="stick", speed="fast", age=0.0))  # type: ignore[arg-type]
    desk.read()
    assert desk.guard.take_problems() == [("PLG-06", "stick", "OperatorInput(source='stick', speed='fast', age=0.0)")]


# ---------------------------------------------------------------------------------------------- out of range

BAD: list[dict[str, Any]] = [
    {"speed": math.nan},
    {"speed": math.inf},
    {"steering": -math.inf},
    {"age": math.nan},
    {"age": -0.001},
    {"speed": 10**400},
    {"raw": (0.0, math.inf)},
    {"centred": (math.nan,)},
    {"shaped": (-math.inf,)},
    {"axes": (0.0, 1.0001)},
    {"axes": (-1.0001,)},
    {"axes": (math.nan,)},
    {"requests": (Request.ARM,) * 65},
    {"answers": ("yes",) * 65},
]


@pytest.mark.parametrize("bad", BAD, ids=str)
def test_sample_out_of_range_is_whole_all_the_same(bad: dict[str, Any]) -> None:
    sample = replace(GOOD, **bad)
    assert is_whole_input(sample)
    assert not is_in_range(sample)


@pytest.mark.parametrize(
    "good",
    [
        {},
        {"axes": (-1.0, 1.0, 0)},
        {"age": None},
        {"speed": 10**6},
        {"age": 0},
        {"raw": (0, 1023.0)},
        {"speed": np.float64(0.3)},
        {"steering": np.float32(0.25), "axes": (np.float64(0.5), np.int16(-1)), "enabled": np.True_},
        {"buttons": (True, False)},
        {"requests": (Request.END,)},
        {"requests": (Request.ARM,) * 64, "answers": ("yes",) * 64},
    ],
    ids=str,
)
def test_sample_within_range_is_good(good: dict[str, Any]) -> None:
    sample = replace(GOOD, **good)
    assert is_whole_input(sample)
    assert is_in_range(sample)


@pytest.mark.parametrize("bad", BAD, ids=str)
def test_bad_sample_is_replaced_by_the_last_good_one_which_grows_older(bad: dict[str, Any]) -> None:
    said = [GOOD, replace(GOOD, **bad), replace(GOOD, **bad), replace(GOOD, speed=0.1)]
    desk = Desk(stick=lambda now: said.pop(0))
    ages = []
    for now in (1.0, 1.02, 1.05):
        (sample,) = desk.read(now)
        assert replace(sample, age=None) == replace(GOOD, age=None)
        ages.append(sample.age)
    assert ages == pytest.approx([0.01, 0.03, 0.06])
    assert desk.read(1.07) == (replace(GOOD, speed=0.1),)
    assert desk.problems() == [], "two are forgiven"


def test_last_good_sample_whose_age_is_unknown_stays_so() -> None:
    said = [replace(GOOD, age=None), replace(GOOD, speed=math.nan)]
    desk = Desk(stick=lambda now: said.pop(0))
    desk.read(0.0)
    assert [sample.age for sample in desk.read(0.5)] == [None]


def test_requests_of_the_last_good_sample_are_not_made_again() -> None:
    said = [replace(GOOD, requests=(Request.ARM,)), replace(GOOD, speed=math.nan)]
    desk = Desk(stick=lambda now: said.pop(0))
    assert [sample.requests for now in (0.0, 0.02) for sample in desk.read(now)] == [(Request.ARM,), ()]


@pytest.mark.parametrize("first", [GOOD, None], ids=["later", "from the first"])
def test_stop_of_a_bad_sample_is_obeyed_and_nothing_else_of_it(first: OperatorInput | None) -> None:
    bad = replace(GOOD, speed=math.nan, requests=(Request.ARM, Request.QUICKSTOP))
    said = [first, bad] if first else [bad]
    desk = Desk(stick=lambda now: said.pop(0))
    samples = [sample for now in (0.0, 0.02)[: len(said)] for sample in desk.read(now)]
    assert samples[-1].requests == (Request.QUICKSTOP,)
    assert samples[-1].age == (None if first is None else pytest.approx(0.03))


def test_bad_sample_with_no_good_one_before_says_nothing() -> None:
    desk = Desk(stick=lambda now: replace(GOOD, speed=math.nan))
    assert desk.read() == (OperatorInput(source="stick"),)


@pytest.mark.parametrize(
    ("times", "faults"),
    [
        ((0.0, 0.2, 0.4, 0.6, 0.8), [5]),
        ((0.0, 0.2, 0.4, 0.6), []),
        ((0.0, 0.25, 0.5, 0.75, 1.0), []),  # four within any second
        ((0.0, 0.2, 0.4, 0.6, 0.8, 1.0), [5, 6]),
        ((0.0, 0.1, 0.2, 0.3, 5.0, 5.1, 5.2, 5.3, 5.4), [9]),
    ],
)
def test_five_bad_samples_within_a_second_are_a_problem(times: tuple[float, ...], faults: list[int]) -> None:
    desk = Desk(stick=lambda now: replace(GOOD, axes=(2.0,)))
    told = []
    for number, now in enumerate(times, 1):
        desk.read(now)
        told += [(number, problem) for problem in desk.problems()]
    assert told == [(number, ("INP-06", "stick")) for number in faults]


def test_bad_samples_are_counted_for_each_input() -> None:
    desk = Desk(**{name: lambda now, name=name: replace(GOOD, source=name, axes=(2.0,)) for name in "ab"})
    for now in (0.0, 0.1, 0.2, 0.3):
        desk.read(now)
    assert desk.problems() == []
    desk.read(0.4)
    assert desk.problems() == [("INP-06", "a"), ("INP-06", "b")]


# ---------------------------------------------------------------------------------------------- plain


def is_plain(value: object, like: object) -> bool:
    """Of the very type that it is declared to have, whatever would count as equal."""
    if isinstance(value, Struct):
        return type(value) is type(like) and all(
            is_plain(getattr(value, name), getattr(like, name)) for name in value.__struct_fields__
        )
    if isinstance(value, tuple) and isinstance(like, tuple):
        return type(value) is tuple and all(map(is_plain, value, like))
    return type(value) is type(like)


class Named(str):
    """A name that no encoder knows."""


class Sample(OperatorInput, frozen=True):
    """A sample of somebody's own kind."""


class Pair(NamedTuple):
    x: Any
    y: Any


FULL = replace(
    GOOD, raw=(512.0, 3.0), centred=(0.5, -1.0), shaped=(0.25, -1.0), buttons=(True, False), requests=(Request.DONE,)
)
STRANGE = Sample(
    source=Named("stick"),
    speed=np.float64(0.3),
    steering=np.float64(-0.1),
    enabled=np.bool_(True),  # type: ignore[arg-type]
    neutral=np.bool_(False),  # type: ignore[arg-type]
    age=np.float64(0.01),
    raw=(512, np.int16(3)),  # type: ignore[arg-type]
    axes=Pair(np.float32(0.5), -1),
    centred=(np.float64(0.5), True - 2),
    shaped=Pair(np.float16(0.25), np.float64(-1.0)),
    buttons=(np.bool_(True), False),  # type: ignore[arg-type]
    requests=(Request.DONE,),
)


def test_samples_are_made_of_plain_values_whatever_a_plugin_takes_for_them() -> None:
    desk = Desk(stick=lambda now: STRANGE)
    (sample,) = desk.read()
    assert sample == FULL
    assert is_plain(sample, FULL)
    assert not is_plain(STRANGE, FULL), "this test can fail"
    assert desk.problems() == []


@pytest.mark.parametrize("number", [np.float64(0.3), np.float32(0.25), 1, True, np.int64(1)])
def test_what_a_follower_answers_is_made_of_plain_values(number: Any) -> None:  # noqa: ANN401
    value = float(number)
    plain = Following(
        command=DriveCommand(speed=value, steering=value, action=Action.QUICKSTOP),
        tracking=Tracking(
            arc_length=value,
            length=value,
            cross_track=value,
            heading_error=value,
            planned_speed=value,
            feedforward=value,
        ),
        finished=True,
    )
    strange = Following(
        command=DriveCommand(speed=number, steering=number, action=Action.QUICKSTOP),
        tracking=Tracking(
            arc_length=number,
            length=number,
            cross_track=number,
            heading_error=number,
            planned_speed=number,
            feedforward=number,
        ),
        finished=np.True_,  # type: ignore[arg-type]
    )
    made = plain_following(strange)
    assert made == plain
    assert is_plain(made, plain)


def test_tells_what_a_plugin_raises_and_returns_however_hard_it_is_to_show() -> None:
    class Shy:
        def __repr__(self) -> str:
            raise ValueError("not for you")

    class Loud(Exception):
        def __repr__(self) -> str:
            return "loud " * 1000

    def loud(now: float) -> OperatorInput:
        raise Loud

    desk = Desk(shy=lambda now: Shy(), loud=loud)
    assert desk.read() == ()
    (_, _, shy), (_, _, shout) = desk.guard.take_problems()
    assert shy == "a Shy that cannot be shown"
    assert shout.startswith("loud loud")
    assert len(shout.partition(" at ")[0]) == 200


class Panic(BaseException):
    """As libraries in other languages raise it."""


@pytest.mark.parametrize(
    "error",
    [SystemExit(0), SystemExit("enough"), asyncio.CancelledError(), GeneratorExit(), Panic("bounds")],
    ids=repr,
)
def test_plugin_that_wants_to_end_the_program_has_raised_an_error(error: BaseException) -> None:
    def leave(now: float) -> OperatorInput:
        raise error

    desk = Desk(stick=leave)
    assert desk.read() == ()
    assert without_places(desk.guard.take_problems()) == [("PLG-02", "stick", repr(error))]


def test_plugin_that_raises_what_ctrl_c_raises_has_raised_an_error() -> None:
    def interrupted(now: float) -> OperatorInput:
        raise KeyboardInterrupt

    desk = Desk(stick=interrupted)
    assert desk.read() == ()
    ((id, name, seen),) = desk.guard.take_problems()
    assert (id, name) == ("PLG-02", "stick")
    assert seen.startswith("KeyboardInterrupt()")


def test_error_says_where_it_was_raised_and_called() -> None:
    class Stick(StubInput):
        def read(self, now: float) -> OperatorInput:
            return self.button("wheel")

        def button(self, name: str) -> OperatorInput:
            return replace(GOOD, source=str(["stick"].index(name)))

    first = Stick.read.__code__.co_firstlineno
    guard = PluginGuard({"stick": Stick(lambda now: GOOD)}, lambda: 0.0)
    guard.read(0.0)
    ((_, _, seen),) = guard.take_problems()
    place = f"test_plugin_guard.py:{first + 4}, called at test_plugin_guard.py:{first + 1}"
    assert seen == f"ValueError(\"'wheel' is not in list\") at {place}"


def test_texts_of_a_plugin_move_no_cursor_and_are_short() -> None:
    def gone(now: float) -> OperatorInput:
        raise DeviceLost("stick", "off\n\x1b[2J\ud800" + 300 * "é")

    desk = Desk(stick=gone)
    desk.read()
    assert desk.guard.take_problems() == [("INP-01", "stick", ("off\\n\\x1b[2J\\ud800" + 300 * "é")[:200])]


def test_every_device_is_given_back_whatever_the_others_do() -> None:
    class Clinging(StubInput):
        closed = 0

        def __init__(self, error: BaseException | None = None) -> None:
            super().__init__(lambda now: GOOD)
            self.error = error

        def close(self) -> None:
            self.closed += 1
            if self.error:
                raise self.error

    inputs = {"a": Clinging(OSError("held")), "b": Clinging(SystemExit(0)), "c": Clinging()}
    assert without_places(PluginGuard(inputs, lambda: 0.0).close()) == [
        ("PLG-02", "a", "OSError('held')"),
        ("PLG-02", "b", "SystemExit(0)"),
    ]
    assert [device.closed for device in inputs.values()] == [1, 1, 1]


# ---------------------------------------------------------------------------------------------- late

JUST, TOO = 0.0149, 0.0151
"""What is still in time, and what is not [s]."""


@pytest.mark.parametrize(
    ("took", "problems"),
    [
        ((TOO, TOO), 0),
        ((TOO, TOO, TOO), 1),
        ((TOO, TOO, JUST, TOO, TOO), 0),
        ((JUST,) * 5, 0),
        ((TOO,) * 5, 3),
    ],
)
def test_input_that_is_late_three_times_in_a_row_is_a_problem(took: tuple[float, ...], problems: int) -> None:
    desk = Desk()
    desk.guard = PluginGuard({"stick": StubInput(desk.slow(*took))}, lambda: desk.time)
    for _ in took:
        assert desk.read() == (GOOD,), "a late answer is one"
    assert desk.problems() == [("PLG-03", "stick")] * problems


def test_late_input_says_how_long_it_took() -> None:
    desk = Desk()
    desk.guard = PluginGuard({"stick": StubInput(desk.slow(0.1, 0.2, 0.3))}, lambda: desk.time)
    for _ in range(3):
        desk.read()
    assert desk.guard.take_problems() == [("PLG-03", "stick", "300 ms, 3 times in a row")]


class SlowFollower(StubFollower):
    """Takes its time."""

    def __init__(self, desk: Desk, took: float) -> None:
        super().__init__()
        self.desk, self.took = desk, took

    def start(self, path: Path, snapshot: Snapshot) -> None:
        super().start(path, snapshot)
        self.desk.time += 1.0

    def step(self, snapshot: Snapshot) -> Any:  # noqa: ANN401
        self.desk.time += self.took
        return super().step(snapshot)


def test_follower_is_watched_like_an_input() -> None:
    desk = Desk()
    slow = SlowFollower(desk, TOO)
    watched = desk.guard.watched(slow)
    watched.start(PATH, snapshot())
    answers = [watched.step(snapshot()) for _ in range(3)]
    assert answers == [following()] * 3
    assert (slow.starts, slow.steps) == (1, 3)
    assert desk.guard.take_problems() == [("PTH-09", "follower", "15 ms, 3 times in a row")]
    slow.took = JUST
    watched.step(snapshot())
    slow.took = TOO
    watched.step(snapshot())
    assert desk.problems() == []


def test_follower_that_raises_late_is_late_and_its_error_goes_on() -> None:
    desk = Desk()

    def fail() -> None:
        desk.time += TOO
        raise ZeroDivisionError("in the follower")

    watched = desk.guard.watched(StubFollower(fail))
    for _ in range(3):
        with pytest.raises(ZeroDivisionError, match="in the follower"):
            watched.step(snapshot())
    assert desk.problems() == [("PTH-09", "follower")]


def test_input_called_follower_and_the_follower_are_two() -> None:
    desk = Desk()
    desk.guard = PluginGuard({"follower": StubInput(desk.slow(TOO, TOO, source="follower"))}, lambda: desk.time)
    watched = desk.guard.watched(SlowFollower(desk, TOO))
    for _ in range(2):
        desk.read()
        watched.step(snapshot())
    assert desk.problems() == []


class SlowBehaviour:
    """A behaviour that takes its time."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self, desk: Desk, took: float) -> None:
        self.desk, self.took = desk, took

    def start(self, snapshot: Snapshot, state: State | None = None) -> None:
        self.desk.time += 1.0

    def step(self, snapshot: Snapshot) -> Acting:
        self.desk.time += self.took
        return Acting(state=(1,))


def test_behaviour_is_watched_like_an_input_each_step_by_itself() -> None:
    desk = Desk()
    slow, quick = SlowBehaviour(desk, TOO), SlowBehaviour(desk, JUST)
    one, other = (desk.guard.watched_behaviour("dock", behaviour) for behaviour in (slow, quick))
    one.start(snapshot())
    for _ in range(3):
        assert one.step(snapshot()) == other.step(snapshot()) == Acting(state=(1,))
    assert desk.guard.take_problems() == [("PLG-03", "dock", "15 ms, 3 times in a row")]


# ---------------------------------------------------------------------------------------------- a follower's answer


@pytest.mark.parametrize("garbage", [None, 3, "go", following().command])
def test_what_is_no_answer_is_not_whole(garbage: object) -> None:
    assert plain_following(garbage) is None


@pytest.mark.parametrize("field", ["arc_length", "length", "cross_track", "heading_error"])
@pytest.mark.parametrize("value", [math.nan, math.inf, None, "far", 10**400])
def test_answer_with_tracking_that_is_no_number_is_not_whole(field: str, value: Any) -> None:  # noqa: ANN401
    answer = following()
    assert plain_following(replace(answer, tracking=replace(answer.tracking, **{field: value}))) is None


@pytest.mark.parametrize("field", ["speed", "steering"])
@pytest.mark.parametrize(("value", "whole"), [(math.nan, True), (math.inf, True), (None, False), ("left", False)])
def test_numbers_of_a_command_are_judged_by_the_gate_and_what_is_none_here(field: str, value: Any, whole: bool) -> None:  # noqa: ANN401
    answer = replace(following(), command=DriveCommand(**{field: value}))
    assert (plain_following(answer) is not None) is whole


@pytest.mark.parametrize("number", [True, 1, np.float64(1.0), np.int8(1)], ids=lambda number: type(number).__name__)
@pytest.mark.parametrize("part", ["command", "tracking"])
def test_one_number_that_is_no_float_becomes_one(part: str, number: Any) -> None:  # noqa: ANN401
    values = getattr(following(), part)
    for field in ("speed", "steering") if part == "command" else (*values.__struct_fields__,):
        made = plain_following(replace(following(), **{part: replace(values, **{field: number})}))
        assert type(getattr(getattr(made, part), field)) is float


def test_values_with_more_in_them_are_not_passed_on() -> None:
    class More(DriveCommand, frozen=True, kw_only=True):
        why: str = "because"

    made = plain_following(replace(following(), command=More(speed=0.5, steering=0.1)))
    assert made is not None
    assert type(made.command) is DriveCommand


@pytest.mark.parametrize("part", ["command", "tracking", "finished"])
@pytest.mark.parametrize("instead", [None, "yes", np.array([True, False])], ids=str)
def test_answer_of_which_a_part_is_something_else_is_not_whole(part: str, instead: Any) -> None:  # noqa: ANN401
    assert plain_following(replace(following(), **{part: instead})) is None


@pytest.mark.parametrize("action", ["run", None, [], {}, 0, Action])
def test_command_whose_action_is_none_is_not_whole(action: Any) -> None:  # noqa: ANN401
    assert plain_following(replace(following(), command=DriveCommand(action=action))) is None


# ---------------------------------------------------------------------------------------------- what inputs show


class Showing(StubInput):
    """An input that shows what a test says."""

    def __init__(self, answer: Callable[[Tick], Any]) -> None:
        super().__init__(lambda now: GOOD)
        self.show = answer


def shown(desk: Desk, answer: Callable[[Tick], Any], times: int) -> list[tuple[str, str, str]]:
    """Problems of an input that is asked so often to show a tick."""
    desk.guard = PluginGuard({"plain": StubInput(lambda now: GOOD), "stick": Showing(answer)}, lambda: desk.time)
    for _ in range(times):
        desk.guard.show(Tick(snapshot=snapshot(), mode=Mode.TELEOP, wish=Wish(), set_points=SetPoints()))
    return desk.guard.take_problems()


def test_an_input_shows_every_tick_and_tells_what_went_wrong() -> None:
    seen: list[Tick] = []
    words = iter(["", "no motor", "", ""])

    def show(tick: Tick) -> str:
        seen.append(tick)
        return next(words)

    assert shown(Desk(), show, 4) == [("INP-16", "stick", "no motor")]
    assert [tick.mode for tick in seen] == [Mode.TELEOP] * 4


def test_an_input_that_fails_to_show_is_a_warning_once() -> None:
    def raising(tick: Tick) -> str:
        raise RuntimeError("motor")

    def ending(tick: Tick) -> str:
        raise SystemExit

    for answer, words in ((raising, "RuntimeError('motor')"), (ending, "SystemExit()"), (lambda tick: 7, "7")):
        assert without_places(shown(Desk(), answer, 3)) == [("INP-16", "stick", words)]
    assert shown(Desk(), lambda tick: None, 3) == [("INP-16", "stick", "None")]
    assert catalogue.fault("INP-16", "stick", "motor").severity is Severity.WARN


def test_an_input_that_is_late_to_show_three_times_in_a_row_is_a_warning_once() -> None:
    desk, asked = Desk(), list[Tick]()

    def slow(tick: Tick) -> str:
        asked.append(tick)
        desk.time += 0.02 if len(asked) != 3 else 0.01
        return ""

    assert shown(desk, slow, 8) == [("INP-16", "stick", "showing takes it 20 ms")]
    assert len(asked) == 6


@pytest.mark.parametrize(
    ("changes", "whole", "in_range"),
    [
        ({"goal": Pose(x=1.0, heading=4.0), "initial_pose": INITIAL}, True, True),
        ({"goal": (1.0, 2.0)}, False, True),
        ({"goal": Pose(x="1")}, False, True),  # type: ignore[arg-type]
        ({"initial_pose": Pose()}, False, True),
        ({"initial_pose": replace(INITIAL, covariance=("a",) * 6)}, False, True),
        ({"goal": Pose(x=math.nan)}, True, False),
        ({"goal": Pose(y=1e9)}, True, False),
        ({"goal": Pose(heading=math.inf)}, True, False),
        ({"initial_pose": replace(INITIAL, pose=Pose(x=math.inf))}, True, False),
        ({"initial_pose": replace(INITIAL, covariance=(1.0, 0.0))}, True, False),
        ({"initial_pose": replace(INITIAL, covariance=(1.0, 2.0, 0.0, 1.0, 0.0, 1.0))}, True, False),
    ],
)
def test_poses_of_an_input_are_whole_and_can_be(changes: dict[str, Any], whole: bool, in_range: bool) -> None:
    desk = Desk(stick=lambda now: replace(GOOD, **changes))
    (sample, *_) = desk.read() or (None,)
    assert is_whole_input(replace(GOOD, **changes)) is whole
    if not whole:
        assert desk.problems() == [("PLG-06", "stick")]
    elif in_range:
        assert sample is not None
        assert (sample.goal, sample.initial_pose) == (Pose(x=1.0, heading=4.0 - 2 * math.pi), INITIAL)
    else:
        assert sample is not None
        assert (sample.goal, sample.initial_pose) == (None, None)


class Found:
    """A localizer that may be told where the robot is."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self, *problems: tuple[str, str]) -> None:
        self.told: list[LocatedPose] = []
        self._problems = list(problems)

    def fixes(self, now: float) -> tuple[()]:
        return ()

    def begin_at(self, initial: LocatedPose) -> None:
        self.told.append(initial)
        if initial.pose.x < 0:
            raise ValueError("not there")

    def take_problems(self) -> list[tuple[str, str]]:
        problems, self._problems = self._problems, []
        return problems

    def close(self) -> None:
        """Nothing is open."""


def test_an_initial_pose_is_handed_to_the_localizer_and_what_that_says_is_a_fault() -> None:
    localizer = Found(("LOC-07", "a scan fits 12% at best there"), ("NET-01", "no"))
    given = [INITIAL, replace(INITIAL, pose=Pose(x=-1.0)), None]
    stick = StubInput(lambda now: replace(GOOD, initial_pose=given.pop(0)))
    guard = PluginGuard({"stick": stick}, lambda: 0.0, localizer)
    for number in range(3):
        guard.read(0.02 * number)
    assert localizer.told == [INITIAL, replace(INITIAL, pose=Pose(x=-1.0))]
    guard.fixes(0.06)
    assert without_places(guard.take_problems()) == [
        ("PLG-02", "localizer", "ValueError('not there')"),
        ("LOC-07", "localizer", "a scan fits 12% at best there"),
        ("PLG-06", "localizer", "'NET-01'"),
    ]
    assert {catalogue.fault("LOC-07").severity, catalogue.fault("NET-14").severity} == {Severity.WARN}
