"""Mode calibrate measures the potentiometers of the steered wheels: it finds what is true."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from rig import CALIBRATE, TRACTION, Rig, follow, write_mission
from steering_rig import (
    HIDDEN,
    LEFT,
    LEFT_ALONE,
    PLAIN,
    RIGHT,
    SIDES,
    assert_recovered,
    assert_safe,
    calibrate,
    jogs,
    memory,
)

from artemis.drive_states import DriveState, Nmt
from artemis.motion.potentiometers import memory_numbers
from artemis.sim.world import PlantParameters
from artemis.values import Mode

pytestmark = pytest.mark.short_alignment


# ---------------------------------------------------------------------------------------------- what is true is found


def test_hidden_zeros_and_slopes_are_found_and_kept(tmp_path: Path) -> None:
    run = calibrate(tmp_path).run()

    assert (run.status, run.faults) == (0, [])
    assert_recovered(run, HIDDEN)
    assert_safe(run)
    for side, name in zip(SIDES, (LEFT, RIGHT), strict=True):
        fit = run.results.steering[side]
        drive = run.world.drive(name)
        assert memory(drive) == memory_numbers(fit.calibration)
        drive.power_off()
        drive.power_on(run.world.time)
        assert memory(drive) == memory_numbers(fit.calibration), "stored, not only written"
        assert fit.backlash_deg == pytest.approx(HIDDEN.backlash_deg, abs=0.03)
        assert fit.misfit_deg < 0.1
    assert run.recompute().difference is None


def test_one_wheel_alone(tmp_path: Path) -> None:
    run = calibrate(tmp_path, wheels="left", reference_deg={"left": 0.8}).run()

    assert (run.status, list(run.results.steering), list(run.results.kept)) == (0, ["left"], [LEFT])
    assert memory(run.world.drive(RIGHT)) == (0, 0, 0, 0)


def test_result_lies_in_the_folder_of_the_run_and_in_its_journal(tmp_path: Path) -> None:
    run = calibrate(tmp_path, save="nothing", **LEFT_ALONE).run()

    assert run.outcome is not None
    found = json.loads(run.outcome.run.calibration.read_text())["steering"]
    assert tuple(found["left"]["zero_v"]) == run.results.steering["left"].calibration.zero_v
    phases = [json.loads(line) for line in run.outcome.run.journal.read_text().splitlines()]
    assert any(entry["text"].startswith("left 1: zero 2.5100 -> 2.499") for entry in phases if entry["kind"] == "phase")
    assert memory(run.world.drive(LEFT)) == (0, 0, 0, 0)


@pytest.mark.slow
def test_alignment_uses_the_result(tmp_path: Path) -> None:
    """The same machine, now with the new values in the robot file: its wheels stand straight, and the drives agree."""
    first = calibrate(tmp_path / "first").run()
    mission = write_mission(tmp_path / "second", [CALIBRATE, follow()])
    robot = tmp_path / "second" / "artemis.yaml"
    text = robot.read_text()
    for side, old in (
        ("left", "{zero_v: [2.51, 2.48], slope_deg_per_v: [72.0, -72.0]}"),
        ("right", "{zero_v: [2.49, 2.52], slope_deg_per_v: [-72.0, 72.0]}"),
    ):
        new = first.results.steering[side].calibration
        assert old in text
        text = text.replace(old, f"{{zero_v: {list(new.zero_v)}, slope_deg_per_v: {list(new.slope_deg_per_v)}}}")
    robot.write_text(text)

    second = Rig(mission, world=first.world, start=first.world.time, longest=60.0).run()

    assert (second.status, second.faults) == (0, [])
    aligned = second.first(lambda seen: seen.mode is Mode.READY)
    for angle in second.truth_at(aligned.now).wheel_angles:
        assert abs(math.degrees(angle)) < 0.4  # before: 0.8 and 1.3


# ---------------------------------------------------------------------------------------------- a person


ONE_BY_ONE = jogs(
    *((4.8 + 0.1 * number, "right_degree") for number in range(2)),
    *((5.2 + 0.1 * number, "left_tenth") for number in range(12)),
    (7.5, "accept"),
    (8.5, "left_degree"),
    (8.6, "left_degree"),
    (8.7, "left_tenth"),
    (8.8, "left_tenth"),
    (9.4, "right_tenth"),
    (11.0, "accept"),
    (12.0, "accept"),
    (57.0, "accept"),
)
"""The left wheel to -0.8 degrees, the right one, which was taken along, to 1.3: there they truly stand straight."""


@pytest.mark.slow
def test_a_person_turns_the_wheels_straight_in_whole_and_tenth_degrees(tmp_path: Path) -> None:
    true = HIDDEN.model_copy(update={"backlash_deg": 0.0})
    run = calibrate(tmp_path, true, ONE_BY_ONE, reference_deg={}, save="ask").run()

    assert (run.status, run.faults) == (0, [])
    assert_recovered(run, true, error_deg=0.15)  # the right wheel is turned on from where the left one took it
    assert run.results.kept.keys() == {LEFT, RIGHT}
    assert run.recompute().difference is None


def test_nothing_is_changed_where_a_person_says_no(tmp_path: Path) -> None:
    run = calibrate(tmp_path, simulation=jogs((25.0, "end")), save="ask", **LEFT_ALONE).run()

    assert run.status == 1
    assert run.results.kept == {}
    assert [memory(run.world.drive(name)) for name in (LEFT, RIGHT)] == [(0, 0, 0, 0)] * 2
    assert_safe(run)


@pytest.mark.parametrize("act", ["end", "quickstop"])
def test_nothing_is_changed_by_who_stops_in_the_middle(tmp_path: Path, act: str) -> None:
    run = calibrate(tmp_path, simulation=jogs((12.0, act)), **LEFT_ALONE).run()

    assert run.status == 1
    assert run.results.steering == {}
    assert memory(run.world.drive(LEFT)) == (0, 0, 0, 0)
    assert_safe(run)


def test_a_question_that_nobody_can_answer_is_a_fault(tmp_path: Path) -> None:
    run = calibrate(tmp_path, reference_deg={}).run()

    assert [fault.id for fault in run.faults] == ["CAL-01"]
    assert "no answer from the operator: left wheel" in run.faults[0].text
    assert_safe(run)


def test_keys_that_come_all_at_once_do_not_send_the_wheel_far(tmp_path: Path) -> None:
    acts = jogs(*((5.0 + 0.01 * number, "left_degree") for number in range(30)), (8.0, "end"))
    run = calibrate(tmp_path, PLAIN, acts, reference_deg={}, save="nothing").run()

    angles = {s.time: math.degrees(s.tick.set_points.steering_left) for s in run.in_mode(Mode.CALIBRATE)}
    last = max(angle for time, angle in angles.items() if time < 5.35)
    assert 5.0 < last, "it turns as fast as it may while they come"
    assert max(angles.values()) < last + 2.5, "and stops when they stop"


def test_nobody_is_asked_whose_hands_are_at_a_wheel_before_they_are_off(tmp_path: Path) -> None:
    acts = jogs((5.5, "accept"), (6.5, "accept"), (9.0, "end"))
    run = calibrate(tmp_path, PLAIN, acts, reference_deg={}, save="nothing").run()

    assert any(s.phase.startswith("keep clear, the wheels turn") for s in run.in_mode(Mode.CALIBRATE))
    assert max(abs(math.degrees(s.tick.set_points.steering)) for s in run.in_mode(Mode.CALIBRATE)) < 0.5


def test_a_key_that_bounces_accepts_once(tmp_path: Path) -> None:
    run = calibrate(tmp_path, simulation=jogs((5.0, "accept"), (5.1, "accept")), reference_deg={}).run()

    assert "no answer from the operator: right wheel" in run.faults[0].text


# ---------------------------------------------------------------------------------------------- new potentiometers


@pytest.mark.slow
def test_new_potentiometers_are_calibrated_though_the_robot_file_knows_nothing_of_them(tmp_path: Path) -> None:
    true = PlantParameters(
        steering_zero_left_deg=25.0,
        steering_zero_right_deg=-30.0,
        potentiometer_slopes_left=(0.7, -1.2),
        potentiometer_noise_v=0.001,
        backlash_deg=0.2,
    )
    run = calibrate(tmp_path, true, potentiometers="new", reference_deg={"left": 7.0, "right": -4.0}).run()

    assert (run.status, run.faults) == (0, [])
    assert_recovered(run, true, error_deg=0.15)  # half of the play: nobody knows on which side of it a wheel is found
    traction = [run.world.drive(name) for name in TRACTION]
    assert all(drive.nmt is Nmt.PRE_OPERATIONAL for drive in traction)
    assert {truth.states[:2] for truth in run.world.history if DriveState.OPERATION_ENABLE in truth.states[:2]} == set()


@pytest.mark.exhaustive
def test_new_potentiometers_by_hand(tmp_path: Path) -> None:
    true = PlantParameters(steering_zero_left_deg=25.0, steering_zero_right_deg=-30.0)
    acts = jogs(
        *((3.6 + 0.1 * number, "right_degree") for number in range(7)),
        (6.0, "accept"),
        *((7.0 + 0.1 * number, "left_degree") for number in range(11)),
        *((8.3 + 0.1 * number, "left_tenth") for number in range(5)),
        (10.5, "accept"),
        (11.5, "accept"),
        (62.0, "accept"),
    )
    run = calibrate(tmp_path, true, acts, potentiometers="new", reference_deg={}, save="ask").run()

    assert (run.status, run.faults) == (0, [])
    untouched = [s.tick.set_points.steering for s in run.in_mode(Mode.CALIBRATE) if 6.1 < s.time < 6.9]
    assert max(untouched) - min(untouched) < math.radians(0.01), "the left wheel was accepted: nothing moves by that"
    left = run.results.steering["left"].calibration
    assert left.zero_v[0] == pytest.approx(2.51 - 25.0 / 72.0, abs=0.002)
    assert run.recompute().difference is None
