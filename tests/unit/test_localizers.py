"""The localizers that come with artemis, and what the guard makes of one that does not keep its contract."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from msgspec.structs import replace
from pydantic import ValidationError

from artemis.config import Config
from artemis.errors import ConfigError, DeviceLost
from artemis.plugins.contracts import PluginContext
from artemis.plugins.fixes import plain_fixes
from artemis.plugins.guard import PluginGuard
from artemis.plugins.localizers.scan_map import ScanMapConfig
from artemis.plugins.localizers.simulated_tracker import SimulatedTracker, SimulatedTrackerConfig
from artemis.plugins.localizers.tracker import TrackerConfig, TrackerLocalizer
from artemis.supervision.catalogue import ROWS
from artemis.testing.contracts import ROBOT
from artemis.testing.localizers import LocalizerContract
from artemis.values import Pose, PoseFix, Severity, Tick

FIX = PoseFix(time=1.0, pose=Pose(x=1.0, y=2.0, heading=0.5), covariance=(1e-4, 0, 0, 1e-4, 0, 1e-3), source="camera")


class World:
    """Rolls along x with 1 m/s, asked fifty times a second."""

    def __init__(self) -> None:
        self.time = -0.02

    def look(self) -> tuple[float, Pose]:
        self.time = round(self.time + 0.02, 2)
        return self.time, Pose(x=self.time, heading=7.0)


class TestTracker(LocalizerContract):
    plugin = TrackerLocalizer
    options: Mapping[str, object] = {"file": "fixes.csv", "delay_s": 0.3}
    files: Mapping[str, bytes] = {"fixes.csv": b"time_s,x_m,y_m,heading_rad,std_m\n0,0,0,0,0.01\n0.5,1,0,9,0.02\n"}


class TestSimulatedTracker(LocalizerContract):
    plugin = SimulatedTracker
    options: Mapping[str, object] = {"jumps": [{"at_s": 3, "by_m": [1, 0]}], "drop_out": [[1, 2]]}

    def given(self) -> PluginContext:
        return PluginContext(name="seen", robot=ROBOT, folder=Path(), true_pose=World().look)


@pytest.mark.parametrize(("every", "late"), [(1000, False), (50, True)])
def test_the_contract_wants_a_localizer_that_is_never_late_by_itself(
    monkeypatch: pytest.MonkeyPatch, every: int, late: bool
) -> None:
    calls, now = iter(range(10_000)), [0.0]

    class Held(SimulatedTracker):
        def fixes(self, time: float) -> tuple[PoseFix, ...]:
            now[0] += 0.2 if next(calls) % every == 0 else 0.0
            return super().fixes(time)

    contract = TestSimulatedTracker()
    contract.plugin = Held
    monkeypatch.setattr("artemis.testing.localizers.stopwatch", lambda: now[0])
    with pytest.raises(AssertionError, match="200 ms, 150 are allowed") if late else nullcontext():
        contract.test_fixes_are_of_the_past()


# ---------------------------------------------------------------------------------------------- those of artemis


def recorded(text: bytes, **options: Any) -> TrackerLocalizer:  # noqa: ANN401 (keys of the plugin)
    context = PluginContext(name="hall", robot=ROBOT, folder=Path("there"), files={"f.csv": text})
    return TrackerLocalizer(TrackerConfig(file="f.csv", **options), context)


def test_a_recorded_fix_comes_when_its_time_has_come() -> None:
    tracker = recorded(b"t,x,y,heading,std_m,std_deg\n1,2,3,4,0.1,2\n2,0,0,0,0.1,2\n", delay_s=0.5)
    assert tracker.fixes(1.49) == ()
    (fix,) = tracker.fixes(1.5)
    assert (fix.time, fix.source, fix.pose.x, fix.pose.y) == (1.0, "hall", 2.0, 3.0)
    assert fix.pose.heading == pytest.approx(4.0 - math.tau)
    assert fix.covariance == pytest.approx((0.01, 0, 0, 0.01, 0, math.radians(2) ** 2))
    assert tracker.fixes(1.6) == ()
    assert [fix.time for fix in tracker.fixes(9.0)] == [2.0]


def test_every_problem_of_a_recorded_file_is_named_with_its_line() -> None:
    with pytest.raises(ConfigError) as found:
        recorded(b"t,x,y,heading,std_m\n1,0,0,0,0.1\n0.5,0,0,0,0.1\n2,0,0,0,-1\n")
    assert [problem.split(": ")[0] for problem in found.value.problems] == ["there/f.csv:3:1", "there/f.csv:4:9"]
    with pytest.raises(ConfigError, match="heading"):
        recorded(b"t,x,y\n0,0,0\n")
    with pytest.raises(ConfigError, match="not UTF-8"):
        recorded(b"t,x,y,heading\n\xff")
    with pytest.raises(ConfigError, match="among the mission's files"):
        TrackerLocalizer(TrackerConfig(file="f.csv"), PluginContext(name="hall", robot=ROBOT, folder=Path()))


@pytest.mark.parametrize(
    ("make", "std_m", "std_deg"),
    [
        (partial(TrackerConfig, file="f.csv"), "std_m", "std_deg"),
        (SimulatedTrackerConfig, "noise_m", "noise_deg"),
        (partial(ScanMapConfig, map="hall.yaml"), "start_std_m", "start_std_deg"),
    ],
)
def test_standard_deviations_are_not_smaller_than_those_that_are_believed(
    make: Callable[..., Config], std_m: str, std_deg: str
) -> None:
    for name, least in ((std_m, 1e-6), (std_deg, 1e-4)):
        make(**{name: least})
        with pytest.raises(ValidationError, match=name):
            make(**{name: 0.9 * least})


def test_the_surest_and_the_vaguest_recorded_fixes_are_believed() -> None:
    for stds in (b"1e-6,1e-4", b"100,100"):
        fixes = recorded(b"t,x,y,heading,std_m,std_deg\n1,2,3,4," + stds + b"\n").fixes(9.0)
        assert None not in (plain_fixes(fixes) or (None,))
    with pytest.raises(ConfigError, match=r"expected 0\.0001 to 100, not 1e-05"):
        recorded(b"t,x,y,heading,std_deg\n1,2,3,4,1e-5\n")


def seen(**options: Any) -> list[tuple[float, PoseFix]]:  # noqa: ANN401 (keys of the plugin)
    """What a simulated tracker tells in ten seconds."""
    tracker = SimulatedTracker(
        SimulatedTrackerConfig(**options),
        PluginContext(name="hall", robot=ROBOT, folder=Path(), true_pose=World().look),
    )
    return [(tick * 0.02, fix) for tick in range(500) for fix in tracker.fixes(tick * 0.02)]


def test_a_simulated_tracker_sees_the_robot_at_its_rate_late_and_with_noise() -> None:
    found = seen(rate_hz=25, noise_m=0.01, noise_deg=1.0, delay_s=0.1)
    assert len(found) == pytest.approx(245, abs=3)
    assert all(now - fix.time == pytest.approx(0.1, abs=0.021) for now, fix in found)
    errors = np.array(
        [(fix.pose.x - fix.time, fix.pose.y, math.remainder(fix.pose.heading - 7, 6.283)) for _, fix in found]
    )
    assert np.std(errors, axis=0) == pytest.approx([0.01, 0.01, math.radians(1)], rel=0.2)
    assert abs(np.mean(errors, axis=0)) == pytest.approx([0, 0, 0], abs=0.004)
    assert found[0][1].covariance == pytest.approx((1e-4, 0, 0, 1e-4, 0, math.radians(1) ** 2))
    assert found == seen(rate_hz=25, noise_m=0.01, noise_deg=1.0, delay_s=0.1)
    assert found != seen(rate_hz=25, noise_m=0.01, noise_deg=1.0, delay_s=0.1, seed=1)


def test_a_simulated_tracker_sees_nothing_for_a_while_and_something_else_for_another() -> None:
    jump = {"at_s": 5.0, "for_s": 0.5, "by_m": [0.0, 2.0], "turn_deg": 90}
    found = seen(noise_m=1e-4, drop_out=[[2.0, 4.0]], jumps=[jump])
    assert not [fix for _, fix in found if 2.0 <= fix.time < 4.0]
    wrong = [fix.time for _, fix in found if fix.pose.y > 1.0]
    assert (len(wrong), wrong[0]) == (5, 5.0)
    with pytest.raises(ValueError, match="is not a time span"):
        SimulatedTrackerConfig(drop_out=((4.0, 2.0),))


# ---------------------------------------------------------------------------------------------- any other


class Strange:
    """Does what it is told to."""

    Config: ClassVar[type[Config]] = Config

    def __init__(self, answer: Callable[[float], Any]) -> None:
        self.fixes = answer

    def close(self) -> None:
        raise RuntimeError("stuck")


def asked(answer: Callable[[float], Any]) -> tuple[tuple[PoseFix, ...], list[tuple[str, str]]]:
    guard = PluginGuard({}, lambda: 0.0, Strange(answer))
    return guard.fixes(1.0), [(id, name) for id, name, _ in guard.take_problems()]


def raising(error: BaseException) -> Callable[[float], Any]:
    def answer(now: float) -> Any:  # noqa: ANN401
        raise error

    return answer


def test_fixes_pass_as_plain_values() -> None:
    assert asked(lambda now: (FIX,)) == ((FIX,), [])
    numpy = replace(FIX, time=np.float64(1.0), pose=Pose(x=np.float64(1.0), y=2, heading=np.float64(0.5)))
    ((fix,), problems) = asked(lambda now: [numpy])
    assert (fix, problems) == (FIX, [])
    assert {type(number) for number in (fix.time, fix.pose.x, fix.pose.y, *fix.covariance)} == {float}


def test_a_localizer_that_raises_or_is_late_is_a_fault_and_one_that_is_gone_is_silent() -> None:
    assert asked(raising(ValueError("no"))) == ((), [("PLG-02", "localizer")])
    assert asked(raising(SystemExit(1))) == ((), [("PLG-02", "localizer")])
    assert asked(raising(DeviceLost("camera", "unplugged"))) == ((), [])
    clock = iter(range(100))
    guard = PluginGuard({}, lambda: float(next(clock)), Strange(lambda now: ()))
    for _ in range(3):
        guard.fixes(0.0)
    assert [(id, name) for id, name, _ in guard.take_problems()] == [("PLG-03", "localizer")]
    assert [id for id, _, _ in PluginGuard({}, lambda: 0.0, Strange(lambda now: ())).close()] == ["PLG-02"]


@pytest.mark.parametrize(
    "garbage",
    [
        None,
        FIX,
        ("fix",),
        (replace(FIX, pose=None),),
        (replace(FIX, source=None),),
        (replace(FIX, time="1"),),
        (replace(FIX, covariance=None),),
        (replace(FIX, covariance=(1e-4,)),),
        (replace(FIX, common=(1e-4,)),),
        (replace(FIX, quality="good"),),
        (FIX, replace(FIX, doubt=None)),
    ],
)
def test_what_is_no_fix_is_garbage(garbage: Any) -> None:  # noqa: ANN401
    assert plain_fixes(garbage) is None
    assert asked(lambda now: garbage) == ((), [("PLG-06", "localizer")])


IMPOSSIBLE = [
    replace(FIX, time=math.nan),
    replace(FIX, time=10**400),
    replace(FIX, pose=Pose(x=math.inf)),
    replace(FIX, pose=Pose(x=1e9)),
    replace(FIX, pose=Pose(heading=math.nan)),
    replace(FIX, covariance=(0.0,) * 6),
    replace(FIX, common=(0.0,) * 6),
    replace(FIX, covariance=(1e-4, 1e-4, 0, 1e-4, 0, 1e-3)),
    replace(FIX, covariance=(1e-4, 0, 0, -1e-4, 0, 1e-3)),
    replace(FIX, covariance=(1e-4, 0, 0, 1e-4, math.nan, 1e-3)),
    replace(FIX, covariance=(1e-4, 0, 0, math.inf, 0, 1e-3)),
    replace(FIX, quality=1.1),
    replace(FIX, doubt=math.nan),
]


@pytest.mark.parametrize("impossible", IMPOSSIBLE)
def test_a_fix_that_cannot_be_true_is_dropped(impossible: PoseFix) -> None:
    assert plain_fixes((FIX, impossible)) == (FIX, None)
    assert asked(lambda now: (impossible, FIX, impossible)) == ((FIX,), [])


def test_three_fixes_in_a_row_that_cannot_be_true_are_a_fault() -> None:
    answers = [(IMPOSSIBLE[0],), (IMPOSSIBLE[1],), (FIX,), (IMPOSSIBLE[0], IMPOSSIBLE[2]), (), (IMPOSSIBLE[3],)]
    times = iter(answers)
    guard = PluginGuard({}, lambda: 0.0, Strange(lambda now: next(times)))
    seen = []
    for answer in answers:
        fixes = guard.fixes(0.0)
        assert fixes == tuple(fix for fix in answer if fix is FIX)
        seen.append([id for id, _, _ in guard.take_problems()])
    assert seen == [[], [], [], [], [], ["LOC-04"]]


def test_a_fix_may_tell_only_how_sure_the_localizer_is() -> None:
    doubting = replace(FIX, covariance=(), quality=0.2, doubt=1.5)
    assert asked(lambda now: (doubting,)) == ((doubting,), [])


class Seeing(Strange):
    """Sees ticks, and answers what it is told to."""

    def __init__(self, problem: Callable[[], Any]) -> None:
        super().__init__(lambda now: ())
        self._problem = problem

    def see(self, tick: Tick) -> str:
        problem: str = self._problem()
        return problem


def shown(problem: Callable[[], Any], times: int = 1, took: float = 0.0) -> list[tuple[str, str]]:
    clock = iter(took * number for number in range(100))
    guard = PluginGuard({}, lambda: next(clock), Seeing(problem))
    for _ in range(times):
        guard.show(LocalizerContract().tick(1.0))
    return [(id, name) for id, name, _ in guard.take_problems()]


def fails() -> str:
    raise ValueError("no")


def test_a_localizer_that_does_not_keep_up_is_a_warning() -> None:
    assert shown(lambda: "") == []
    assert shown(lambda: "3 scans were dropped") == [("LOC-06", "localizer")]
    assert ROWS["LOC-06"].severity is Severity.WARN


def test_a_localizer_that_raises_or_takes_long_where_it_sees_is_a_fault() -> None:
    assert shown(fails) == [("PLG-02", "localizer")]
    assert shown(lambda: None) == [("PLG-06", "localizer")]
    assert shown(lambda: "", 2, 0.02) == []
    assert shown(lambda: "", 3, 0.02) == [("PLG-03", "localizer")]
