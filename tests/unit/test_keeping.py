"""What steering drives keep of their potentiometers: how it is written, and what contradicts the robot file."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
from core_builders import NAMES, ROBOT, STEERING, ObedientDrives, has_fault, shared
from msgspec.structs import replace
from routine_rig import OVER, RoutinePlayer

from artemis.drive_states import DriveState, Goal
from artemis.motion.potentiometers import memory_numbers
from artemis.states.keeping import contradiction, keep
from artemis.states.plan import CalibrateStep
from artemis.states.steering import SteeringStep
from artemis.values import JobKind, JobResult

LEFT, RIGHT = STEERING
NEW = {LEFT: (2_500_000, 2_490_000, 72_100_000, -71_900_000), RIGHT: (1, 2, 3, 4)}
READ, WRITE, STORE, HALT = JobKind.READ_CALIBRATION, JobKind.WRITE_CALIBRATION, JobKind.STORE, JobKind.HALT


def keeping(
    wanted: Mapping[str, tuple[int, ...]] = NEW, state: DriveState = DriveState.OPERATION_ENABLE
) -> RoutinePlayer:
    return RoutinePlayer(shared(), lambda shared, snapshot: keep(shared, wanted, snapshot), ObedientDrives(state))


def test_drives_are_switched_off_and_each_is_written_read_back_and_stored() -> None:
    player = keeping()

    assert player.play() is None

    assert player.kinds == [(READ, LEFT), (READ, RIGHT), (WRITE, LEFT), (STORE, LEFT), (WRITE, RIGHT), (STORE, RIGHT)]
    assert [job.values for job in player.jobs if job.kind is WRITE] == list(NEW.values())
    assert [job.values for job in player.jobs if job.kind is STORE] == [(), ()]
    assert player.mode.shared.results.kept == NEW
    assert player.phases == [
        "switching off",
        "reading what the drives keep",
        "write calibration steer-left",
        "store steer-left",
        "write calibration steer-right",
        "store steer-right",
        OVER,
    ]
    assert all((wish.traction, wish.steering) == (Goal.DISABLED, Goal.DISABLED) for wish in player.wishes)


def test_only_the_drives_that_are_named_are_asked() -> None:
    player = keeping({RIGHT: NEW[RIGHT]})
    assert player.play() is None
    assert {drive for _, drive in player.kinds} == {RIGHT}
    assert player.mode.shared.results.kept == {RIGHT: NEW[RIGHT]}


def test_nothing_is_written_while_a_drive_is_on() -> None:
    player = keeping()
    player.drives.lazy = {NAMES[1], NAMES[3]}
    fault = player.play()
    assert fault is not None
    assert (fault.id, fault.device) == ("COM-03", NAMES[1])
    assert "stays on" in fault.text
    assert {kind for kind, _ in player.kinds} == {HALT}


def test_what_cannot_be_read_before_is_a_fault_and_nothing_is_written() -> None:
    player = keeping()
    player.refused = {(READ, RIGHT)}
    fault = player.play()
    assert fault is not None
    assert (fault.id, fault.device) == ("COM-08", RIGHT)
    assert {kind for kind, _ in player.kinds} == {READ}


@pytest.mark.parametrize(
    ("number", "refused"), [(2**31 - 1, False), (1 - 2**31, False), (2**31, True), (-(2**31), True)]
)
def test_numbers_fit_into_the_memory(number: int, refused: bool) -> None:
    player = keeping({LEFT: (0, 0, number, 0)})
    fault = player.play()
    assert (fault is not None) is refused
    if fault is not None:
        assert (fault.id, fault.device) == ("CAL-01", LEFT)
        assert "too large for the drive's memory: zero 0.0000 and 0.0000 V, slope" in fault.text
        assert WRITE not in {kind for kind, _ in player.kinds}
        assert not player.mode.shared.results.kept


@pytest.mark.parametrize("kind", [WRITE, STORE])
def test_a_drive_that_refuses_is_named_with_what_is_where(kind: JobKind) -> None:
    player = keeping()
    player.told = {(READ, LEFT): (1_000_000, 2_000_000, 3_000_000, 4_000_000)}
    player.refused = {(kind, RIGHT)}
    fault = player.play()
    assert fault is not None
    assert (fault.id, fault.device) == ("CAL-01", RIGHT)
    assert fault.text.endswith(
        f"({kind.value}: broken in the test; before it kept nothing; steer-left keeps the new values already, before "
        "zero 1.0000 and 2.0000 V, slope 3.000 and 4.000 deg/V; the robot file is as it was, `artemis calibrate "
        "steering --store` brings it back)"
    )
    assert player.mode.shared.results.kept == {LEFT: NEW[LEFT]}
    assert player.kinds[-1] == (kind, RIGHT)


def test_drives_stay_off_after_a_fault() -> None:
    player = keeping()
    player.refused = {(WRITE, LEFT)}
    player.play()
    assert all(not has_fault(wish) and wish.steering is Goal.DISABLED for wish in (player.tick(), player.tick()))


# ---------------------------------------------------------------------------------------------- at the start


FILE = {name: memory_numbers(ROBOT.potentiometers(ROBOT.drives[name].side)) for name in STEERING}


def read(drive: str, *values: int, kind: JobKind = READ) -> JobResult:
    return JobResult(id=1, kind=kind, drive=drive, ok=True, values=values)


def test_what_the_drives_keep_is_what_the_robot_file_says() -> None:
    assert contradiction(shared(), [read(name, *numbers) for name, numbers in FILE.items()]) is None
    assert contradiction(shared(), [read(LEFT, 0, 0, 0, 0), read(RIGHT, *FILE[RIGHT])]) is None
    assert contradiction(shared(), [read(LEFT, 1, 2, 3, 4, kind=JobKind.READ_GAINS)]) is None
    assert contradiction(shared(), [read(LEFT, 0, 0, 3, 4)]) is not None


def test_another_calibration_is_a_fault_with_both() -> None:
    fault = contradiction(shared(), [read(LEFT, *FILE[LEFT]), read(RIGHT, *FILE[LEFT])])
    assert fault is not None
    assert (fault.id, fault.device) == ("CAL-02", RIGHT)
    assert (
        "keeps zero 2.5100 and 2.4800 V, slope 72.000 and -72.000 deg/V; the robot file says zero 2.4900" in fault.text
    )


def test_what_this_run_has_given_a_drive_counts_for_it() -> None:
    given = shared()
    given.results.kept[LEFT] = (1, 2, 3, 4)
    assert contradiction(given, [read(LEFT, 1, 2, 3, 4)]) is None
    assert contradiction(given, [read(LEFT, *FILE[LEFT])]) is not None
    assert contradiction(given, [read(RIGHT, 1, 2, 3, 4)]) is not None


def test_what_is_to_be_replaced_is_no_matter_but_of_its_side_alone() -> None:
    other = [read(LEFT, 1, 2, 3, 4), read(RIGHT, 1, 2, 3, 4)]
    assert contradiction(shared(SteeringStep(save="drives")), other) is None
    fault = contradiction(shared(SteeringStep(save="drives", sides=("left",))), other)
    assert fault is not None
    assert fault.device == RIGHT
    for step in (SteeringStep(save="nothing"), CalibrateStep()):
        fault = contradiction(shared(step), other)
        assert fault is not None
        assert fault.device == LEFT
    done = shared(SteeringStep(save="drives"))
    done.position = replace(done.position, step=1)
    assert contradiction(done, other) is not None
