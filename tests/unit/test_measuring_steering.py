"""Potentiometers measured against the encoders: each turn, each question, each number, and what is refused."""

# ruff: noqa: ANN401  (keys of the step are handed on)

from __future__ import annotations

from math import degrees, radians
from pathlib import Path
from typing import Any

import pytest
from core_builders import NAMES, ROBOT, STEERING, TRACTION, shared, snapshot
from routine_rig import OVER
from steering_bench import LEFT, RIGHT, Bench, Measuring, as_known, measuring, turned

from artemis.axles import Potentiometers
from artemis.drive_states import DriveState, Goal
from artemis.mission.loading import load_model
from artemis.motion.potentiometers import memory_numbers
from artemis.motion.steering_fit import Line, Pass, SteeringFit
from artemis.states.mode import PATIENCE, Failed
from artemis.states.steering import (
    KEEP,
    RELEASE_TIME,
    START,
    TURN_IT,
    _accepts,
    _check_operator,
    _judged,
    _release,
    _told,
    _wheel,
)
from artemis.values import Fault, JobKind, Request, Severity, Wish
from artemis.vehicle import RobotFile

ROBOTS = Path(__file__).parents[2] / "missions" / "robots"
BOTH = {"left": 0.8, "right": 0.2}
ACCEPT = Request.ACCEPT


def ended(run: Measuring) -> Measuring:
    assert run.player.play() is None
    return run


def refused(run: Measuring, **how: Any) -> Fault:
    fault = run.player.play(**how)
    assert fault is not None
    return fault


def reading(run: Measuring, side: str) -> list[Wish]:
    return [wish for wish in run.player.wishes if f"reading the {side} wheel" in wish.phase]


# ---------------------------------------------------------------------------------------------- the whole of it


def test_each_wheel_is_read_straight_and_to_both_sides_and_told() -> None:
    run = ended(measuring(reference=BOTH))

    assert run.phases() == [
        "switching traction off",
        *(f"reading the left wheel at {angle:+d} degrees" for angle in (-1, 44, -45, -1)),
        *(f"reading the right wheel at {angle} degrees" for angle in ("-0", "+45", "-45", "-0")),
        "aligning",
        "left 1: zero 2.5100 -> 2.4989 V (-0.80 deg, +- 0.000), slope 72.000 -> 72.000 deg/V (+- 0.000)",
        "left 2: zero 2.4800 -> 2.4911 V (-0.80 deg, +- 0.000), slope -72.000 -> -72.000 deg/V (+- 0.000)",
        run.phases()[12],
        "right 1: zero 2.4900 -> 2.4928 V (-0.20 deg, +- 0.000), slope -72.000 -> -72.000 deg/V (+- 0.000)",
        "right 2: zero 2.5200 -> 2.5172 V (-0.20 deg, +- 0.000), slope 72.000 -> 72.000 deg/V (+- 0.000)",
        run.phases()[15],
        OVER,
    ]
    for place, side in ((12, "left"), (15, "right")):
        assert (
            run.phases()[place].replace("-0.00", "0.00")
            == f"{side}: backlash 0.00 deg, off the line by 0.000 deg at most"
        )
    found = run.shared.results.steering
    assert list(found) == ["left", "right"]
    assert found["left"].calibration.zero_v == (2.4989, 2.4911)
    assert found["left"].calibration.slope_deg_per_v == (72.0, -72.0)
    assert found["right"].calibration.zero_v == (2.4928, 2.5172)
    assert not run.player.jobs
    assert not run.shared.results.kept
    assert run.step.replaces == ()
    assert not run.step.new
    assert {wish.command.steering for wish in run.player.wishes if wish.phase == "aligning"} == {0.0}
    wishes = [wish for wish in run.player.wishes if wish.phase != OVER]
    assert {(wish.traction, wish.steering) for wish in wishes} == {(Goal.DISABLED, Goal.ENABLED)}
    assert {wish.command.speed for wish in wishes} == {0.0}


def test_each_pass_takes_fifty_readings_two_degrees_to_both_sides_after_two_of_lead() -> None:
    run = ended(measuring(reference={"left": 0.0}, sides=("left",)))
    told = turned(reading(run, "left"), "left")
    assert len(told) == 8 * 52, "the lead, the begin, and fifty readings, in eight passes"
    for number, (angle, way) in enumerate([(a, w) for a in (0.0, 45.0, -45.0, 0.0) for w in (1.0, -1.0)]):
        one = told[52 * number : 52 * (number + 1)]
        expected = [
            angle - way * 4.0,
            angle - way * 2.0,
            *(angle + way * (4.0 * step / 50 - 2.0) for step in range(1, 51)),
        ]
        assert one == pytest.approx(expected, abs=1e-6)


def test_the_right_wheel_is_turned_by_its_own_angle() -> None:
    run = ended(measuring(reference={"right": 0.0}, sides=("right",)))
    told = turned(reading(run, "right"), "right")
    assert (min(told), max(told)) == pytest.approx((-49.0, 49.0))
    assert list(run.shared.results.steering) == ["right"]


def test_what_is_true_is_found() -> None:
    bench = Bench(left=as_known("left", turned_deg=0.5, slope=1.05), right=as_known("right", slope=0.95))
    run = ended(measuring(bench, reference={"left": 0.7, "right": 0.0}))
    left, right = (run.shared.results.steering[side] for side in ("left", "right"))
    assert left.calibration.slope_deg_per_v == pytest.approx((75.6, -75.6))
    assert right.calibration.slope_deg_per_v == pytest.approx((-68.4, 68.4))
    assert left.calibration.zero_v[0] == pytest.approx(2.51 - 0.7 / 75.6, abs=1e-4), "0.7 degrees where it shows 0"


def test_play_is_told_and_moves_no_zero() -> None:
    truth = as_known("left")
    truth.lag_deg = 0.15
    run = ended(measuring(Bench(left=truth), reference={"left": 0.0}, sides=("left",)))
    assert run.shared.results.steering["left"].calibration.zero_v == pytest.approx((2.51, 2.48), abs=1e-4)
    assert run.shared.results.steering["left"].backlash_deg == pytest.approx(0.3, abs=0.02)
    assert any("left: backlash 0.30 deg" in phase for phase in run.phases())


# ---------------------------------------------------------------------------------------------- traction off


def test_driven_wheels_are_let_go_first() -> None:
    run = measuring(reference=BOTH)
    first = run.player.tick()
    assert (first.phase, first.traction, first.steering) == ("switching traction off", Goal.DISABLED, Goal.ENABLED)


@pytest.mark.parametrize("name", TRACTION)
def test_a_driven_wheel_that_stays_on_for_a_second_is_a_fault(name: str) -> None:
    run = measuring(reference=BOTH)
    run.bench.lazy = {name}
    fault = refused(run)
    assert (fault.id, fault.device) == ("COM-03", name)
    assert "stays on" in fault.text
    assert run.player.time == pytest.approx(1.04, abs=0.03)
    assert run.player.wishes[-1].steering is Goal.ENABLED


def test_it_may_switch_off_at_the_last_moment() -> None:
    routine = _release(shared(), snapshot(0.0))
    next(routine)
    assert routine.send(snapshot(RELEASE_TIME)).phase == "switching traction off"
    with pytest.raises(Failed):
        routine.send(snapshot(RELEASE_TIME + 1e-9))


def test_the_first_of_both_is_named() -> None:
    run = measuring(reference=BOTH)
    run.bench.lazy = set(TRACTION)
    assert refused(run).device == TRACTION[0]


def test_the_steering_is_enabled_again_where_it_is_off() -> None:
    run = measuring(reference=BOTH)
    run.bench.states = dict.fromkeys(NAMES, DriveState.SWITCH_ON_DISABLED)
    run.bench.lazy = {LEFT}
    for _ in range(20):
        assert run.player.tick().phase == "enabling"


def test_wheels_are_held_where_they_are_meanwhile() -> None:
    run = measuring(reference=BOTH)
    run.bench.lazy = {TRACTION[0]}
    run.player._points = run.player._points.__class__(steering=0.2, steering_left=0.2, steering_right=0.2)
    for _ in range(5):
        assert run.player.tick().command.steering == 0.2


# ---------------------------------------------------------------------------------------------- keeping


def test_the_drives_keep_the_result_and_steer_again() -> None:
    run = ended(measuring(reference=BOTH, save="drives"))
    fits = run.shared.results.steering
    wanted = {LEFT: memory_numbers(fits["left"].calibration), RIGHT: memory_numbers(fits["right"].calibration)}
    assert run.shared.results.kept == wanted
    assert [job.values for job in run.player.jobs if job.kind is JobKind.WRITE_CALIBRATION] == list(wanted.values())
    assert run.step.replaces == ("left", "right")
    assert run.phases()[-2:] == ["enabling", OVER]
    assert run.player.wishes[-2].steering is Goal.ENABLED
    assert run.player.wishes[-2].traction is Goal.DISABLED


def test_only_what_was_measured_is_kept() -> None:
    run = ended(measuring(reference=BOTH, sides=("right",), save="drives"))
    assert list(run.shared.results.kept) == [RIGHT]


def test_a_person_is_asked_before_it_is_kept() -> None:
    run = measuring(reference=BOTH, save="ask")
    wish = run.ask(KEEP)
    assert wish.phase == f"keep this in the drives and the robot file? {KEEP}"
    run.accept()
    ended(run)
    assert set(run.shared.results.kept) == set(STEERING)


def test_a_key_that_bounces_accepts_nothing() -> None:
    run = measuring(reference=BOTH, save="ask")
    run.ask(KEEP)
    for _ in range(20):
        assert KEEP in run.press(ACCEPT).phase
    run.wait(0.2)
    run.press(ACCEPT)
    ended(run)


@pytest.mark.parametrize(("after", "accepts"), [(0.49, False), (0.5, True)])
def test_what_could_be_read_for_half_a_second_is_accepted(after: float, accepts: bool) -> None:
    assert _accepts(snapshot(2.0 + after, requests=(ACCEPT,)), 2.0) is accepts


def test_an_operator_may_come_at_the_last_moment() -> None:
    _check_operator(snapshot(2.0 + PATIENCE), 2.0, "")
    with pytest.raises(Failed):
        _check_operator(snapshot(2.0 + PATIENCE + 1e-9), 2.0, "")


def test_other_keys_accept_nothing() -> None:
    run = measuring(reference=BOTH, save="ask")
    run.ask(KEEP)
    run.wait()
    assert KEEP in run.press(Request.LEFT_DEGREE, Request.ARM).phase
    assert run.step.replaces == ("left", "right")


@pytest.mark.parametrize("save", ["nothing", "drives"])
def test_nobody_is_asked_where_it_is_said(save: str) -> None:
    assert not any(KEEP in phase for phase in ended(measuring(reference=BOTH, save=save)).phases())


def test_a_question_that_nobody_answers_ends_the_run() -> None:
    run = measuring(reference=BOTH, save="ask")
    run.ask(KEEP)
    run.player.time += 599.0
    assert KEEP in run.player.tick().phase
    run.player.time += 1.0
    fault = refused(run)
    assert (fault.id, fault.device) == ("CAL-01", "")
    assert f"no answer from the operator: keep this in the drives and the robot file? {KEEP}" in fault.text
    assert run.player.wishes[-1].steering is Goal.ENABLED


def test_a_question_where_nobody_is_there_ends_the_run_at_once() -> None:
    run = measuring(reference=BOTH, save="ask")
    run.player.world["attended"] = False
    assert "no answer" in refused(run).text
    assert not run.shared.results.kept


# ---------------------------------------------------------------------------------------------- a person turns


def test_a_person_turns_each_wheel_until_it_stands_straight() -> None:
    run = measuring()
    wish = run.ask(TURN_IT)
    assert wish.phase == f"left wheel at +0.0 deg: {TURN_IT}"
    run.press(Request.RIGHT_DEGREE)
    assert turned([run.player.wishes[-1]], "left") == pytest.approx([-1.0])
    run.press(Request.LEFT_TENTH)
    run.press(Request.LEFT_TENTH)
    assert run.player.tick().phase == f"left wheel at -0.8 deg: {TURN_IT}"
    run.accept()
    assert run.player.tick().phase.startswith("right wheel at -0.8")
    run.press(Request.LEFT_DEGREE)
    run.press(Request.RIGHT_TENTH)
    run.accept()
    wish = run.ask(START)
    assert wish.phase == f"keep clear, the wheels turn to both sides now: {START}"
    run.accept()
    ended(run)
    left, right = (run.shared.results.steering[side].calibration for side in ("left", "right"))
    assert left.zero_v[0] == pytest.approx(2.51 - 0.8 / 72, abs=1e-4)
    stood = -0.8 * 0.9896 + 0.9
    assert (right.zero_v[0] - 2.49) * -72 == pytest.approx(stood, abs=0.02)


def test_other_keys_turn_nothing() -> None:
    run = measuring(sides=("left",))
    run.ask(TURN_IT)
    assert run.press(Request.ARM).command.steering == 0.0
    assert run.player.tick().command.steering == 0.0


def test_a_wheel_of_which_the_reference_is_known_is_not_asked_for() -> None:
    run = measuring(reference={"left": 0.8})
    assert run.ask(TURN_IT).phase.startswith("right wheel")
    run.accept()
    run.ask(START)
    run.accept()
    ended(run)
    assert run.shared.results.steering["left"].calibration.zero_v == (2.4989, 2.4911)
    assert run.shared.results.steering["right"].calibration.zero_v == (2.49, 2.52)


@pytest.mark.parametrize(("key", "way"), [(Request.LEFT_DEGREE, 1.0), (Request.RIGHT_DEGREE, -1.0)])
def test_no_keys_however_many_turn_a_wheel_farther_than_two_degrees_ahead(key: Request, way: float) -> None:
    run = measuring(sides=("left",))
    run.ask(TURN_IT)
    run.bench.held = {LEFT}
    for _ in range(6):
        run.press(key)
    assert turned([run.player.wishes[-1]], "left") == pytest.approx([2.0 * way])


@pytest.mark.parametrize(("key", "end"), [(Request.LEFT_DEGREE, 73.318), (Request.RIGHT_DEGREE, -49.469)])
def test_a_wheel_is_turned_as_far_as_the_gate_lets_it(key: Request, end: float) -> None:
    run = measuring(sides=("left",))
    run.ask(TURN_IT)
    for _ in range(90):
        run.press(key)
    (told,) = turned([run.player.wishes[-1]], "left")
    assert told == pytest.approx(end, abs=1e-3)
    assert abs(run.player.wishes[-1].command.steering) < radians(60.0)


@pytest.mark.parametrize(("key", "end"), [(Request.LEFT_DEGREE, 49.469), (Request.RIGHT_DEGREE, -73.318)])
def test_so_is_the_right_one(key: Request, end: float) -> None:
    run = measuring(sides=("right",))
    run.ask(TURN_IT)
    for _ in range(90):
        run.press(key)
    assert turned([run.player.wishes[-1]], "right") == pytest.approx([end], abs=1e-3)


def test_both_keys_at_once_do_what_both_say() -> None:
    run = measuring(sides=("left",))
    run.ask(TURN_IT)
    run.press(Request.LEFT_DEGREE, Request.RIGHT_TENTH)
    assert turned([run.player.wishes[-1]], "left") == pytest.approx([0.9])
    run.press(Request.LEFT_DEGREE, Request.RIGHT_DEGREE)
    assert turned([run.player.wishes[-1]], "left") == pytest.approx([0.9])


def test_the_wheel_is_where_it_was_turned_to_before_it_counts() -> None:
    run = measuring(sides=("left",))
    run.ask(TURN_IT)
    run.wait()
    run.bench.held = {LEFT}
    run.press(Request.LEFT_DEGREE)
    run.press(ACCEPT)
    assert run.player.tick().phase == "aligning"
    run.wait(0.5)
    assert run.player.wishes[-1].phase == "aligning"
    run.bench.held = set()
    run.ask(START)


@pytest.mark.parametrize("found", [None, {}])
@pytest.mark.parametrize("key", [Request.LEFT_TENTH, Request.RIGHT_TENTH, None])
def test_the_play_is_on_the_side_from_which_the_wheel_came(key: Request | None, found: dict[str, Any] | None) -> None:
    """The alignment leaves a wheel as if it came from the right; before that, nothing is known."""
    truth = as_known("left")
    truth.lag_deg = 0.2
    run = measuring(Bench(left=truth), sides=("left",), new=found is not None, plan={"found": found})
    run.ask(TURN_IT)
    if key is not None:
        run.press(key)
    run.accept()
    run.ask(START)
    run.accept()
    ended(run)
    untouched = 0.0 if found is not None else 1.0
    at, way = {Request.LEFT_TENTH: (0.1, 1.0), Request.RIGHT_TENTH: (-0.1, -1.0), None: (0.0, untouched)}[key]
    zero = run.shared.results.steering["left"].calibration.zero_v[0]
    assert (zero - 2.51) * 72 == pytest.approx(at - way * 0.2, abs=0.02)


def test_a_wheel_that_nobody_turns_ends_the_run() -> None:
    run = measuring(sides=("right",))
    run.ask(TURN_IT)
    run.player.world["attended"] = False
    fault = refused(run)
    assert f"no answer from the operator: right wheel at +0.0 deg: {TURN_IT}" in fault.text


# ---------------------------------------------------------------------------------------------- new potentiometers


FOUND: dict[str, Any] = {"plan": {"found": {}}}


def test_new_potentiometers_count_from_where_a_person_set_the_wheels() -> None:
    bench = Bench(left=as_known("left", turned_deg=200.0, slope=1.5), right=as_known("right", turned_deg=-90.0))
    run = measuring(bench, new=True, **FOUND)
    run.ask(TURN_IT)
    for _ in range(3):
        run.press(Request.LEFT_DEGREE)
    run.accept()
    run.accept()
    run.ask(START)
    wish = run.accept()
    assert [(job.kind, job.drive) for job in wish.jobs] == [(JobKind.REFERENCE, LEFT), (JobKind.REFERENCE, RIGHT)]
    assert [round(degrees(job.value), 3) for job in wish.jobs] == [0.0, 0.0]
    assert (wish.traction, wish.steering) == (Goal.DISABLED, Goal.DISABLED)
    ended(run)
    left = run.shared.results.steering["left"].calibration
    assert left.slope_deg_per_v == pytest.approx((108.0, -108.0))
    assert left.zero_v[0] == pytest.approx(2.51 + 200.0 / 108.0 + 3.0 / 108.0, abs=2e-3)


def test_new_potentiometers_of_wheels_whose_angles_are_known_are_only_read() -> None:
    run = ended(
        measuring(
            Bench(left=as_known("left", turned_deg=30.0)), reference={"left": 0.7}, sides=("left",), new=True, **FOUND
        )
    )
    assert run.shared.results.steering["left"].calibration.zero_v[0] == pytest.approx(2.51 + 30.0 / 72.0, abs=1e-3)
    assert not run.player.jobs


def test_only_the_wheels_that_a_person_set_count_anew() -> None:
    run = measuring(reference={"right": 3.0}, new=True, **FOUND)
    run.ask(TURN_IT)
    run.press(Request.LEFT_DEGREE)
    run.accept()
    run.ask(START)
    wish = run.accept()
    assert [job.drive for job in wish.jobs] == [LEFT]
    ended(run)


# ---------------------------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("side", "reference", "turn"),
    [
        ("right", -34.0, 11.5),
        ("right", -31.0, 14.5),
        ("right", -30.0, 15.468),
        ("right", -25.0, 20.468),
        ("left", 34.0, 11.5),
        ("left", 25.0, 20.468),
        ("left", -50.0, 19.318),
        ("left", -20.0, 45.0),
    ],
)
def test_a_wheel_is_turned_less_where_its_limit_is_near(side: str, reference: float, turn: float) -> None:
    run = measuring(reference={side: reference}, sides=(side,))
    fault = run.player.play()
    if turn < 15.0:
        assert fault is not None
        assert (fault.id, fault.device) == ("CAL-01", f"steer-{side}")
        assert f"at its limit: {turn:.1f} degrees are left to turn it by, 15 are needed" in fault.text
        assert run.player.wishes[-1].steering is Goal.ENABLED
        return
    assert fault is None
    told = turned(reading(run, side), side)
    assert (min(told), max(told)) == pytest.approx((-reference - turn - 4.0, -reference + turn + 4.0), abs=0.01)


def line(slope: float = 72.0, *, misfit_deg: float = 0.0, flat: float | None = None) -> Line:
    per_radian = degrees(1.0) / slope if flat is None else flat
    return Line(2.5, per_radian, 0.0, ((0.0,) * 3,) * 3, radians(misfit_deg))


def judged(
    first: Line, second: Line | None = None, volts: tuple[float, float] = (2.51, 2.48), **plan: Any
) -> list[Fault]:
    made = shared().plan
    passes = [Pass(1.0, [(0.0, *volts)] * 3), Pass(-1.0, [(0.0, 0.0, 0.0)] * 3)]
    robot = plan.get("robot", ROBOT)
    changed_plan = made.__class__(robot=robot, steps=(), found=plan.get("found"))
    return list(_judged(changed_plan, "left", (first, second or line(-72.0)), passes))


@pytest.mark.parametrize(
    ("first", "words"),
    [
        (line(flat=0.0), "potentiometer 1 does not follow the wheel: 0.000 V per radian"),
        (line(flat=-0.099), "potentiometer 1 does not follow the wheel: 0.099 V per radian"),
        (line(79.5), "potentiometer 1: 79.5 degrees per volt, the robot file says 72.0; at most 10 % off)"),
        (line(64.5), "potentiometer 1: 64.5 degrees per volt, the robot file says 72.0; at most 10 % off)"),
        (
            line(-60.0),
            "potentiometer 1: -60.0 degrees per volt, the robot file says 72.0; at most 10 % off; are two plugs",
        ),
        (line(misfit_deg=0.51), "potentiometer 1 is 0.51 degrees off its line: it drifts, or a coupling slips"),
    ],
)
def test_what_no_calibration_comes_of_is_refused(first: Line, words: str) -> None:
    (fault,) = judged(first)
    assert (fault.id, fault.device) == ("CAL-01", LEFT)
    assert words in fault.text
    assert ("are two plugs swapped?" in fault.text) is (first.per_radian < -0.5)
    assert fault.severity >= Severity.CONTROLLED_STOP


@pytest.mark.parametrize("misfit", [0.21, 0.49, 0.5])
def test_what_is_a_little_off_its_line_is_a_warning(misfit: float) -> None:
    (fault,) = judged(line(), line(-72.0, misfit_deg=misfit))
    assert (fault.id, fault.device, fault.severity) == ("CAL-01", LEFT, Severity.WARN)
    assert fault.text.endswith(f"(potentiometer 2 is {misfit:.2f} degrees off its line)")


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (line(79.0), line(-79.0)),
        (line(65.0), line(-65.5)),
        (line(misfit_deg=0.19), line(-72.0)),
        (line(), line(-72.0, misfit_deg=0.2)),
        (line(72.0), line(-72.0)),
    ],
)
def test_what_is_as_good_as_known_is_taken(first: Line, second: Line) -> None:
    assert judged(first, second) == []


def test_of_new_potentiometers_nothing_is_known() -> None:
    assert judged(line(-150.0), line(150.0), (0.5, 0.5), found={}) == []
    assert judged(line(flat=0.1), line(flat=-0.105), found={}) == []
    (fault,) = judged(line(flat=0.05), found={})
    assert "does not follow" in fault.text


@pytest.mark.parametrize(("apart", "warns"), [(1.4, False), (-1.4, False), (1.6, True), (-1.6, True)])
def test_potentiometers_that_disagree_are_a_warning(apart: float, warns: bool) -> None:
    found = judged(line(), volts=(2.51 + apart / 72.0, 2.48))
    assert bool(found) is warns
    if warns:
        assert found[0].severity is Severity.WARN
        assert found[0].text.endswith(f"(by the robot file its potentiometers are {abs(apart):.1f} degrees apart)")


def test_a_warning_is_told_and_the_measurement_goes_on() -> None:
    truth = as_known("left")
    truth.volts = truth.volts[0] + 1.8 / 72.0, truth.volts[1]
    run = measuring(Bench(left=truth), reference={"left": 0.0}, sides=("left",))
    told = []
    while (wish := run.player.tick()).phase != OVER:
        told += [wish] if wish.fault else []
    (wish,) = told
    assert wish.fault is not None
    assert (wish.fault.severity, wish.phase) == (Severity.WARN, wish.fault.text)
    assert wish.traction is Goal.DISABLED
    assert "left" in run.shared.results.steering


def test_a_potentiometer_that_does_not_follow_is_refused_and_nothing_is_found() -> None:
    truth = as_known("left")
    truth.slopes = 5000.0, truth.slopes[1]
    run = measuring(Bench(left=truth), reference={"left": 0.0}, sides=("left",))
    fault = refused(run)
    assert "potentiometer 1 does not follow the wheel" in fault.text
    assert run.shared.results.steering == {}
    assert run.player.wishes[-1].steering is Goal.ENABLED
    asked = run.player.wishes[-1].command
    run.wait()
    assert run.player.wishes[-1].command == asked.__class__(), "it stands by"
    assert run.player.wishes[-1].phase == ""


def test_a_potentiometer_that_drifts_is_refused() -> None:
    truth = as_known("right")
    truth.drift = 1e-4
    fault = refused(measuring(Bench(right=truth), reference={"right": 0.0}, sides=("right",)))
    assert (fault.id, fault.device) == ("CAL-01", RIGHT)
    assert "off its line: it drifts, or a coupling slips" in fault.text


# ---------------------------------------------------------------------------------------------- without potentiometers


ABSOLUTE: dict[str, Any] = {"plan": {"robot": load_model(ROBOTS / "artemis_absolute.yaml", RobotFile)}}


def test_without_potentiometers_the_zeros_are_told_and_nothing_more_is_turned() -> None:
    run = ended(measuring(reference=BOTH, **ABSOLUTE))
    robot = run.shared.plan.robot
    before = {side: robot.angle_source(side).zero_deg for side in ("left", "right")}  # type: ignore[union-attr]
    mirrored = {side: robot.angle_source(side).mirrored for side in ("left", "right")}  # type: ignore[union-attr]
    after = {side: (before[side] + (BOTH[side] if mirrored[side] else -BOTH[side])) % 360.0 for side in BOTH}
    assert run.phases() == [
        "switching traction off",
        "aligning",
        *(f"{side}: zero_deg {before[side]:.4f} -> {after[side]:.4f} ({BOTH[side]:+.2f} deg)" for side in BOTH),
        OVER,
    ]
    assert {side: found.after for side, found in run.shared.results.zeros.items()} == pytest.approx(after)
    assert {wish.command.steering for wish in run.player.wishes} == {0.0}
    assert not run.shared.results.steering
    assert not run.player.jobs
    assert {wish.steering for wish in run.player.wishes[:-1]} == {Goal.ENABLED}


def test_a_person_sets_such_wheels_straight_and_is_asked_once_more() -> None:
    run = measuring(save="ask", sides=("left",), **ABSOLUTE)
    run.ask(TURN_IT)
    run.press(Request.RIGHT_DEGREE)
    run.accept()
    wish = run.ask(KEEP)
    assert wish.phase == f"keep this in the robot file? {KEEP}"
    assert not any(START in phase for phase in run.phases())
    assert wish.command.steering == 0.0
    run.accept()
    ended(run)
    assert "(+1.00 deg)" in next(phase for phase in run.phases() if phase.startswith("left: zero_deg"))
    assert list(run.shared.results.zeros) == ["left"]


@pytest.mark.parametrize("save", ["nothing", "drives"])
def test_they_keep_nothing_and_ask_nothing_else(save: str) -> None:
    run = ended(measuring(save=save, reference=BOTH, **ABSOLUTE))
    assert not any(KEEP in phase for phase in run.phases())
    assert not run.shared.results.kept


@pytest.mark.parametrize(("side", "name"), [("middle", "steering"), ("left", "left wheel"), ("right", "right wheel")])
def test_what_a_motor_turns(side: str, name: str) -> None:
    assert _wheel(side) == name


def test_uncertainties_are_told_with_what_is_found() -> None:
    fit = SteeringFit(
        calibration=Potentiometers(zero_v=(2.5, 2.5), slope_deg_per_v=(-72.0, 72.0)),
        zero_std_v=(0.001, 0.002),
        slope_std_deg_per_v=(0.25, 0.5),
        backlash_deg=0.25,
        misfit_deg=0.125,
    )
    assert list(_told(shared().plan, {"right": fit})) == [
        "right 1: zero 2.4900 -> 2.5000 V (-0.72 deg, +- 0.072), slope -72.000 -> -72.000 deg/V (+- 0.250)",
        "right 2: zero 2.5200 -> 2.5000 V (-1.44 deg, +- 0.144), slope 72.000 -> 72.000 deg/V (+- 0.500)",
        "right: backlash 0.25 deg, off the line by 0.125 deg at most",
    ]
