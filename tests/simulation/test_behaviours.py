"""Whole runs with steps that behaviour plugins do: driven, interrupted, resumed, replayed; and plugins that fail."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any, ClassVar

import pytest
from resuming import refused
from resuming import run as run_resumable
from rig import CALIBRATE, Rig, Run, standing, write_mission
from typer.testing import CliRunner

from artemis.cli import app
from artemis.config import Config
from artemis.drive_states import DriveState
from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.mission.random_walks import never_reached
from artemis.planning import core_from
from artemis.plugins import registry
from artemis.plugins.contracts import Acting, PluginContext, State
from artemis.recording.mcap_reader import Recording
from artemis.recording.replay import replay
from artemis.testing import walk
from artemis.values import DriveCommand, Mode, Request, Severity, Snapshot, Tick

pytestmark = pytest.mark.short_alignment

SPEED = 0.4


class WeaveConfig(Config):
    distance_m: float = 1.5


class Weave:
    """Drives curves by a count of its own, which is its state; tells how far it is."""

    Config: ClassVar[type[Config]] = WeaveConfig
    outcomes: ClassVar[tuple[str, ...]] = ("lost-count",)
    resumable: ClassVar[bool] = True
    signals: ClassVar[Mapping[str, str]] = {"weaved_m": "m"}

    def __init__(self, config: WeaveConfig, context: PluginContext) -> None:
        self._far = config.distance_m

    def start(self, snapshot: Snapshot, state: State | None = None) -> None:
        self._count, self._begin = (int(state[0]), float(state[1])) if state else (0, snapshot.pose.pose.x)

    def step(self, snapshot: Snapshot) -> Acting:
        self._count += 1
        way = snapshot.pose.pose.x - self._begin
        return Acting(
            command=DriveCommand(speed=SPEED, steering=0.3 * math.sin(self._count / 20)),
            outcome="done" if way >= self._far else None,
            state=(self._count, self._begin),
            phase="weaving",
            signals={"weaved_m": way},
        )


class Forgetful(Weave):
    """Cannot go on in another run."""

    resumable: ClassVar[bool] = False


class CountingConfig(Config):
    upto: int = 100


class Counting:
    """Counts ticks beside other steps, and calls out at a number."""

    Config: ClassVar[type[Config]] = CountingConfig
    outcomes: ClassVar[tuple[str, ...]] = ("full",)
    moves: ClassVar[bool] = False
    resumable: ClassVar[bool] = True
    signals: ClassVar[Mapping[str, str]] = {"counted": ""}

    def __init__(self, config: CountingConfig, context: PluginContext) -> None:
        self._upto = config.upto

    def start(self, snapshot: Snapshot, state: State | None = None) -> None:
        self._count = int(state[0]) if state else 0

    def step(self, snapshot: Snapshot) -> Acting:
        self._count += 1
        full = "full" if self._count >= self._upto else None
        return Acting(outcome=full, state=(self._count,), signals={"counted": self._count})


class Failing(Weave):
    """After half a metre does what `fail` says."""

    fail: ClassVar[Callable[[Acting], Any]] = lambda answer: answer

    def step(self, snapshot: Snapshot) -> Acting:
        answer = super().step(snapshot)
        if snapshot.pose.pose.x < 0.5:
            return answer
        bad: Acting = type(self).fail(answer)
        return bad


@pytest.fixture(autouse=True)
def _installed(monkeypatch: pytest.MonkeyPatch) -> None:
    found, loads = registry._found, EntryPoint.load
    kinds = (Weave, Forgetful, Counting, Failing)
    added = [EntryPoint(kind.__name__.lower(), f"{__name__}:{kind.__name__}", "artemis.behaviours") for kind in kinds]

    def load(point: EntryPoint) -> object:
        return globals()[point.attr] if point.module == __name__ else loads(point)

    monkeypatch.setattr(registry, "_found", lambda group: found(group) + [p for p in added if p.group == group])
    monkeypatch.setattr(EntryPoint, "load", load)


def approach(until: str, at_most: float = 2.0, speed: float = SPEED) -> dict[str, object]:
    return {"approach": {"until": until, "at_most_m": at_most, "speed_m_s": speed}}


def assert_replays(seen: Run) -> None:
    assert seen.recompute().difference is None


def events(seen: Run) -> list[str]:
    return [f"{event.kind} {event.text}" for tick in seen.ticks for event in tick.events]


def acting(ticks: list[Tick]) -> list[Tick]:
    return [tick for tick in ticks if tick.mode is Mode.ACT and tick.wish.acted]


# ---------------------------------------------------------------------------------------------- approach


def test_approach_drives_straight_until_its_condition_holds(tmp_path: Path) -> None:
    seen = Rig(write_mission(tmp_path, [CALIBRATE, approach("driven_m > 1"), {"say": "here"}])).run()
    assert (seen.status, seen.fault_ids, events(seen)[-3:]) == (
        0,
        [],
        ["fired driven_m > 1", "ended done", "said here"],
    )
    x, y = seen.world.pose.x, seen.world.pose.y
    braking = SPEED**2 / 2  # with 1 m/s²
    assert 1.0 < x < 1.0 + braking + 0.08
    assert abs(y) < 0.02
    assert max(tick.set_points.speed for tick in seen.ticks) == pytest.approx(SPEED)
    assert standing(seen.world.truth)
    assert_replays(seen)


def test_approach_ends_at_its_limit_with_an_outcome_to_catch(tmp_path: Path) -> None:
    catch = {"try": {"steps": [approach("run_s > 1000", 0.8)], "catch": {"too-far": [{"say": "nothing there"}]}}}
    seen = Rig(write_mission(tmp_path, [CALIBRATE, catch])).run()
    assert (seen.status, events(seen)[-3:]) == (0, ["ended too-far", "caught too-far", "said nothing there"])
    assert seen.world.pose.x == pytest.approx(0.8, abs=0.03)
    assert_replays(seen)


def test_an_outcome_that_nobody_catches_fails_the_run_with_its_name(tmp_path: Path) -> None:
    seen = Rig(write_mission(tmp_path, [CALIBRATE, approach("run_s > 1000", 0.3)])).run()
    assert (seen.status, seen.ticks[-1].position.ended) == (1, "too-far")


def test_approach_goes_on_along_its_line_after_a_stop(tmp_path: Path) -> None:
    acts = [(5.0, "quickstop"), (8.0, "arm"), (60.0, "acknowledge")]
    operator = [{"at_s": time, "do": act} for time, act in acts]
    caught = {"try": {"steps": [approach("run_s > 1000", 1.2)], "catch": {"too-far": [{"say": "there"}]}}}
    seen = Rig(write_mission(tmp_path, [CALIBRATE, caught], simulation={"operator": operator})).run()
    assert (seen.status, seen.modes.count(Mode.ACT)) == (0, 2)
    assert 0.1 < seen.in_mode(Mode.QUICKSTOP)[0].pose.x < 1.0
    assert seen.world.pose.x == pytest.approx(1.2, abs=0.03)
    assert_replays(seen)


def test_a_branch_that_fires_interrupts_it_and_then_it_goes_on(tmp_path: Path) -> None:
    when = [{"if": "weaved_m > 0.5", "steps": [{"wait": {"seconds": 1.0}}]}]
    seen = Rig(write_mission(tmp_path, [CALIBRATE, {"during": {"steps": [{"weave": {}}], "when": when}}])).run()
    assert (seen.status, seen.modes.count(Mode.ACT)) == (0, 2)
    counts = [int(tick.wish.acted[0].state.strip("[").split(",")[0]) for tick in acting(seen.ticks)]
    assert counts == list(range(1, len(counts) + 1))  # it went on counting
    assert seen.world.pose.x == pytest.approx(1.5, abs=0.2)
    assert_replays(seen)


def test_the_live_view_shows_a_behaviour_within_words(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, [CALIBRATE, {"repeat": {"times": 2, "steps": [approach("approached_m > 0.2")]}}])
    done = CliRunner().invoke(app, ["run", str(mission)])
    assert done.exit_code == 0, done.output
    assert "approaching" in done.output
    assert "PLG-02" not in done.output


# ---------------------------------------------------------------------------------------------- resume


def driven(metres: float) -> Callable[[Tick], bool]:
    return lambda tick: tick.mode is Mode.ACT and tick.snapshot.pose.pose.x >= metres


def test_a_behaviour_goes_on_in_another_run_with_the_commands_that_were_next(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, [CALIBRATE, {"weave": {}}])
    whole = run_resumable(mission)
    first = run_resumable(mission, until=driven(0.7))
    second = run_resumable(mission, first.folder)
    assert (whole.outcome.exit_status, first.outcome.exit_status, second.outcome.exit_status) == (0, 1, 0)

    def commands(ticks: list[Tick]) -> dict[str, DriveCommand]:
        """By the count that the behaviour returned."""
        weaving = [tick for tick in acting(ticks) if tick.wish.phase == "weaving"]
        return {tick.wish.acted[0].state.split(",")[0]: tick.wish.command for tick in weaving}

    expected, before, after = commands(whole.ticks), commands(first.ticks), commands(second.ticks)
    assert next(int(count.strip("[")) for count in after) == len(before) + 1
    assert len(before) > 50
    assert len(after) > 50
    assert all(expected[count] == command for count, command in (before | after).items() if count in expected)
    for done in (first, second):
        recording = Recording(done.folder)
        assert replay(recording, core_from(load_mission(mission), recording.resume_point)).difference is None


def test_approach_goes_on_to_the_same_place_in_another_run(tmp_path: Path) -> None:
    caught = {"try": {"steps": [approach("run_s > 1000", 1.2)], "catch": {"fault": [{"say": "no"}]}}}
    mission = write_mission(tmp_path, [CALIBRATE, caught])
    first = run_resumable(mission, until=driven(0.6))
    second = run_resumable(mission, first.folder)
    assert second.ticks[-1].position.ended == "too-far"
    assert second.ticks[-1].snapshot.pose.pose.x == pytest.approx(1.2, abs=0.03)
    assert second.ticks[-1].snapshot.pose.pose.y == pytest.approx(0.0, abs=0.02)


def test_a_run_that_stopped_in_one_that_is_not_resumable_is_refused(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, [CALIBRATE, {"forgetful": {}}])
    first = run_resumable(mission, until=driven(0.5))
    assert refused(mission, first.folder) == (
        f"{first.folder}: cannot be resumed: the run stopped in steps[1].forgetful, and forgetful is not resumable; "
        "omit --resume to start from the beginning"
    )


def test_what_one_told_that_has_ended_counts_in_another_run(tmp_path: Path) -> None:
    choose = {"choose": [{"if": "weaved_m > 0.4", "steps": [{"say": "far"}]}, {"steps": [{"say": "near"}]}]}
    steps: list[Mapping[str, object]] = [CALIBRATE, {"weave": {"distance_m": 0.5}}, {"wait": {"seconds": 1.0}}, choose]
    mission = write_mission(tmp_path, steps)
    first = run_resumable(mission, until=lambda tick: tick.wish.phase == "waiting")
    second = run_resumable(mission, first.folder)
    assert [event.text for tick in second.ticks for event in tick.events if event.kind == "said"] == ["far"]
    recording = Recording(second.folder)
    assert replay(recording, core_from(load_mission(mission), recording.resume_point)).difference is None


def test_a_run_that_stopped_before_it_had_begun_goes_on(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, [CALIBRATE, {"wait": {"seconds": 1.0}}, {"forgetful": {"distance_m": 0.3}}])
    first = run_resumable(mission, until=lambda tick: tick.wish.phase == "waiting")
    assert run_resumable(mission, first.folder).outcome.exit_status == 0


def test_one_that_waits_for_a_branch_is_refused_too(tmp_path: Path) -> None:
    when = [{"if": "weaved_m > 0.5", "steps": [{"wait": {"seconds": 5.0}}]}]
    mission = write_mission(tmp_path, [CALIBRATE, {"during": {"steps": [{"forgetful": {}}], "when": when}}])
    first = run_resumable(mission, until=lambda tick: tick.wish.phase == "waiting")
    assert "forgetful is not resumable" in refused(mission, first.folder)


# ---------------------------------------------------------------------------------------------- beside


def together(upto: int) -> list[Mapping[str, object]]:
    word = {"together": {"steps": [{"weave": {}}], "beside": [{"counting": {"upto": upto}}]}}
    return [CALIBRATE, {"try": {"steps": [word], "catch": {"full": [{"say": "full"}]}}}]


def test_one_beside_counts_every_tick_of_the_steps_and_ends_with_them(tmp_path: Path) -> None:
    seen = Rig(write_mission(tmp_path, together(100_000))).run()
    assert (seen.status, seen.fault_ids) == (0, [])
    told = [acted.signals[0].value for tick in seen.ticks for acted in tick.wish.acted if acted.step == 2]
    assert told == [float(number) for number in range(1, len(told) + 1)]
    assert len(told) > 150
    assert_replays(seen)


def test_one_beside_that_calls_out_brings_the_robot_to_rest(tmp_path: Path) -> None:
    seen = Rig(write_mission(tmp_path, together(120))).run()
    assert (seen.status, events(seen)[-3:]) == (0, ["ended full", "caught full", "said full"])
    assert 0.3 < seen.world.pose.x < 1.4
    assert standing(seen.world.truth)
    assert_replays(seen)


def test_one_beside_that_calls_out_while_the_wheels_are_aligned_is_heard_though_that_is_finished_first(
    tmp_path: Path,
) -> None:
    word = {"together": {"steps": [CALIBRATE], "beside": [{"counting": {"upto": 20}}]}}
    caught = {"try": {"steps": [word, {"weave": {}}], "catch": {"full": [{"say": "full"}]}}}
    seen = Rig(write_mission(tmp_path, [caught])).run()
    assert (seen.status, events(seen)) == (0, ["ended full", "ended done", "caught full", "said full"])
    assert not seen.in_mode(Mode.ACT)
    assert_replays(seen)


def test_a_walk_ends_one_beside_with_its_own_outcome(tmp_path: Path) -> None:
    mission = load_mission(write_mission(tmp_path, together(120)))
    made = walk(mission, "done", "full")
    assert (made.events[-3:], made.ended) == (["ended full", "caught full", "said full"], "done")
    assert never_reached(mission, walks=200) == []
    with pytest.raises(ConfigError, match="the step 'weave' does not end so; nearest is 'full'"):
        walk(mission, "done", "ful")


def test_one_beside_goes_on_from_its_count_in_another_run(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, together(100_000))
    first = run_resumable(mission, until=driven(0.7))
    second = run_resumable(mission, first.folder)

    def counts(ticks: list[Tick]) -> list[int]:
        told = [acted.state for tick in ticks for acted in tick.wish.acted if acted.step == 2]
        return [int(state.strip("[]")) for state in told]

    assert counts(second.ticks)[0] == counts(first.ticks)[-1] + 1
    assert second.outcome.exit_status == 0
    recording = Recording(second.folder)
    assert replay(recording, core_from(load_mission(mission), recording.resume_point)).difference is None


# ---------------------------------------------------------------------------------------------- that fail


def run_failing(folder: Path, monkeypatch: pytest.MonkeyPatch, fail: Callable[[Acting], Any]) -> Run:
    monkeypatch.setattr(Failing, "fail", staticmethod(fail))
    return Rig(write_mission(folder, [CALIBRATE, {"failing": {"distance_m": 3.0}}])).run()


def raising(_: Acting) -> Acting:
    raise ZeroDivisionError("a behaviour's own mistake")


def leaving(_: Acting) -> Acting:
    sys.exit(0)


BAD: dict[str, tuple[Callable[[Acting], Any], str]] = {
    "raises": (raising, "PLG-02"),
    "ends the program": (leaving, "PLG-02"),
    "answers nothing": (lambda answer: None, "PLG-06"),
    "ends as nobody declared": (lambda answer: Acting(outcome="arrived"), "PLG-06"),
    "tells a signal of nobody": (lambda answer: Acting(signals={"x_m": 1.0}), "PLG-06"),
    "commands no number": (lambda answer: Acting(command=DriveCommand(speed=math.nan)), "RUN-11"),
    "steers to no number": (lambda answer: Acting(command=DriveCommand(speed=SPEED, steering=math.inf)), "RUN-11"),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("fail", "id"), BAD.values(), ids=BAD)
def test_one_that_breaks_is_a_controlled_stop_with_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fail: Callable[[Acting], Any], id: str
) -> None:
    seen = run_failing(tmp_path, monkeypatch, fail)
    fault = seen.faults[0]
    assert (seen.status, fault.id, fault.severity) == (1, id, Severity.CONTROLLED_STOP)
    assert fault.device == ("act" if id == "RUN-11" else "failing")
    begin = seen.first(lambda s: s.tick.wish.fault is not None)
    end = seen.stands_from()
    assert end - begin.now < SPEED + 0.25  # on the ramp of 1 m/s²
    moving = [truth for truth in seen.truth_from(begin.now) if truth.time <= end]
    assert {state for truth in moving for state in truth.states} == {DriveState.OPERATION_ENABLE}
    assert standing(seen.world.truth)


def test_a_command_beyond_every_limit_is_limited_not_obeyed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    far = Acting(command=DriveCommand(speed=1e9, steering=1e9))
    monkeypatch.setattr(Failing, "fail", staticmethod(lambda answer: far))
    rig = Rig(write_mission(tmp_path, [CALIBRATE, {"failing": {"distance_m": 3.0}}]))
    rig.when(lambda s: s.tick.snapshot.odometry.distance > 1.5, rig.request(Request.END))
    seen = rig.run()
    assert max(abs(s.tick.set_points.speed) for s in seen.seen) <= 0.7
    assert max(abs(s.tick.set_points.steering) for s in seen.seen) <= math.radians(60) + 1e-5


def test_one_that_raises_beside_the_steps_is_a_controlled_stop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def step(counting: Counting, snapshot: Snapshot) -> Acting:
        if snapshot.pose.pose.x > 0.4:
            raise KeyError("count")
        return Acting()

    monkeypatch.setattr(Counting, "step", step)
    seen = Rig(write_mission(tmp_path, together(10))).run()
    fault = seen.faults[0]
    assert (seen.status, fault.id, fault.device) == (1, "PLG-02", "counting")
    assert standing(seen.world.truth)
