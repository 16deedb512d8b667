"""Robots with other axles than those of ARTEMIS: what their files may say, and what motors have to do with wheels."""

from __future__ import annotations

import re
from math import atan2, cos, degrees, hypot, pi, radians, sin, tan
from pathlib import Path

import numpy as np
import pytest
import yaml

from artemis.axles import Geometry, LinkageRow
from artemis.calibration.kinematics import Kinematics, dead_reckoned, parameters_of
from artemis.calibration.robot_file import changes
from artemis.calibration.wheel_log import WheelLog
from artemis.commands.faults import show_faults
from artemis.errors import ConfigError
from artemis.linkage import MeasuredLinkage
from artemis.mission.loading import load_model
from artemis.motion.ackermann import Ackermann
from artemis.motion.odometry import Odometer
from artemis.motion.speed_profile import wheel_ratio
from artemis.sim.vehicle import Chassis, fit_differential
from artemis.sim.wheels import TrueLinkage
from artemis.supervision.catalogue import ROWS
from artemis.vehicle import RobotFile

ROBOTS = Path(__file__).parents[2] / "missions" / "robots"
OTHERS = ("rear_driven", "tricycle", "small_car")
ANGLES = [radians(angle) for angle in (-60.0, -31.0, -4.0, 0.0, 0.5, 17.0, 55.0)]


def robot(name: str) -> RobotFile:
    return load_model(ROBOTS / f"{name}.yaml", RobotFile)


def geometry(**changed: object) -> Geometry:
    words = {"wheelbase_m": 0.6, "track_m": 0.5, "scrub_radius_m": 0.0, "driven_axle": "rear", **changed}
    return Geometry.model_validate(words)


def pair(steering: float, wide: Geometry) -> tuple[float, float]:
    """Directions of both kingpins about the turning point, from its place: (0, L / tan)."""
    if steering == 0.0:
        return 0.0, 0.0
    turning, half = wide.wheelbase_m / tan(steering), wide.kingpin_distance_m / 2.0

    def direction(side: float) -> float:
        return atan2(wide.wheelbase_m, turning - side) if turning > 0 else -atan2(wide.wheelbase_m, side - turning)

    return direction(half), direction(-half)


def table_of(wide: Geometry, motors: list[float]) -> tuple[LinkageRow, ...]:
    """An exact linkage, as somebody would measure it [degrees]."""
    rows = [(motor, *map(degrees, pair(radians(motor), wide))) for motor in motors]
    return tuple(LinkageRow(motor_deg=motor, left_deg=left, right_deg=right) for motor, left, right in rows)


# ---------------------------------------------------------------------------------------------- one motor, two wheels


@pytest.mark.parametrize("name", OTHERS)
def test_one_steering_motor_stands_for_both_sides(name: str) -> None:
    described = robot(name)
    steering, _ = described.drive_at("steering", "left")
    assert described.drive_at("steering", "right")[0] == steering
    assert described.places[2] == described.places[3]
    assert described.drives[steering].set_point == "steering_left"


def test_a_linkage_without_a_table_turns_its_motor_as_the_virtual_wheel() -> None:
    car = Ackermann(geometry(linkage="ackermann"))
    for angle in ANGLES:
        assert car.wheel_angles(angle) == pytest.approx((angle, angle), abs=1e-15)
        assert car.steering_from_wheel_angles(angle, angle) == pytest.approx(angle, abs=1e-12)
        assert car.wheel_rates(angle, 0.3) == pytest.approx((0.3, 0.3))


def test_a_measured_table_of_an_exact_linkage_is_that_linkage() -> None:
    wide = geometry(scrub_radius_m=0.03)
    measured = MeasuredLinkage(geometry(scrub_radius_m=0.03, linkage=table_of(wide, [*range(-60, 61, 2)])))
    assert measured.reach == pytest.approx((-60.0, 60.0))
    for angle in ANGLES:
        assert measured.steering(angle) == pytest.approx(angle, abs=2e-4)
        assert measured.motor(measured.steering(angle)) == pytest.approx(angle, abs=1e-9)
        assert measured.slope(angle) == pytest.approx(1.0, abs=0.02)


def test_the_linkage_of_the_rear_driven_robot_goes_both_ways() -> None:
    described = robot("rear_driven")
    car = Ackermann(described.geometry)
    for angle in (radians(number) for number in range(-45, 46, 5)):
        motor, _ = car.wheel_angles(angle)
        assert car.steering_from_left(motor) == pytest.approx(angle, abs=1e-9)
        left, right = TrueLinkage(described.geometry).wheels(motor)
        inner, outer = pair(angle, described.geometry)
        assert (left, right) == pytest.approx((inner, outer), abs=radians(1.5))  # it is no exact one


@pytest.mark.parametrize("axle", ["front", "rear"])
def test_a_differential_turns_its_motor_at_the_mean_of_both_wheels(axle: str) -> None:
    own = geometry(driven_axle=axle, linkage="ackermann")
    wheels, behind = Ackermann(own), geometry(driven_axle=axle, linkage="ackermann", differential=True)
    car = Ackermann(behind)
    for angle in ANGLES:
        mean = sum(wheels.speed_ratios(angle)) / 2.0
        assert car.speed_ratios(angle) == pytest.approx((mean, mean))
        rolled = 0.4 * mean
        assert car.twist_from_wheels(rolled, rolled, angle) == pytest.approx((0.4, 0.0))


def test_the_motor_of_a_tricycle_is_its_virtual_wheel() -> None:
    car = Ackermann(robot("tricycle").geometry)
    for angle in ANGLES:
        assert car.wheel_angles(angle) == pytest.approx((angle, angle), abs=1e-15)
        assert car.speed_ratios(angle) == pytest.approx((1.0, 1.0))
        assert car.wheel_speeds(0.5, angle, 0.4, 0.4) == pytest.approx((0.5, 0.5))


@pytest.mark.parametrize("name", OTHERS)
def test_a_path_is_driven_no_faster_than_its_fastest_motor(name: str) -> None:
    described = robot(name)
    car = Ackermann(described.geometry)
    curvature = np.tan(np.array(ANGLES)) / described.geometry.wheelbase_m
    ratio, scrub = wheel_ratio(curvature, described)
    assert scrub == 0.0
    assert ratio == pytest.approx([max(map(abs, car.speed_ratios(angle))) for angle in ANGLES])


# ---------------------------------------------------------------------------------------------- the true vehicle


@pytest.mark.parametrize("front_driven", [False, True])
def test_a_differential_moves_the_vehicle_as_fits_best(front_driven: bool) -> None:
    chassis = Chassis(wheelbase=0.6, track=0.5, scrub_radius=0.0, front_driven=front_driven, differential=True)
    left, right, rolled, half = radians(22.0), radians(15.0), 0.01, 0.25
    grip = [[-sin(d), 0.6 * cos(d) + side * half * sin(d)] for d, side in ((left, 1), (right, -1))]
    front = np.mean([[cos(d), 0.6 * sin(d) - side * half * cos(d)] for d, side in ((left, 1), (right, -1))], axis=0)
    rows = np.array([front if front_driven else [1.0, 0.0], *grip])
    best, *_ = np.linalg.lstsq(rows, np.array([rolled, 0.0, 0.0]))
    assert fit_differential(chassis, left, right, rolled) == pytest.approx(tuple(best), abs=1e-15)


@pytest.mark.parametrize("name", OTHERS)
def test_fitted_odometry_is_that_of_the_ticks(name: str) -> None:
    described = robot(name)
    car, odometer = Ackermann(described.geometry), Odometer(described.geometry)
    time = np.arange(0.0, 20.0, 0.02)
    angles = radians(35.0) * np.sin(0.5 * time)
    motors = np.array([car.wheel_angles(angle)[0] for angle in angles.tolist()])
    ratios = np.array([car.speed_ratios(angle) for angle in angles.tolist()])
    ways = np.cumsum(0.006 * ratios, axis=0)
    log = WheelLog(name="", time=time, distance_left=ways[:, 0], distance_right=ways[:, 1],
                   steering_left=motors, steering_right=motors)  # fmt: skip
    poses = dead_reckoned(log, Kinematics.of(described.geometry))
    before = ways[0]
    for way, motor in zip(ways, motors, strict=True):
        left, right = way - before
        odometer.update(left, right, motor, motor, 0.02)
        before = way
    last = odometer.odometry.pose
    assert hypot(last.x - poses[-1, 0], last.y - poses[-1, 1]) < 1e-3
    assert (last.heading - poses[-1, 2] + pi) % (2 * pi) - pi == pytest.approx(0.0, abs=1e-3)


def test_a_fit_knows_what_the_robot_has() -> None:
    names = {name: {each.name for each in parameters_of(robot(name).geometry)} for name in (*OTHERS, "artemis")}
    assert names["tricycle"] == names["small_car"] == {"distance", "zero", "wheelbase", "scale"}
    assert names["rear_driven"] == names["tricycle"] | {"distance difference"}
    assert names["artemis"] > {"scrub radius", "zero difference", "kingpin distance"}
    assert changes(robot("tricycle"), Kinematics.of(robot("tricycle").geometry)) == {}


# ---------------------------------------------------------------------------------------------- what a file may say


REFUSED = {
    ("tricycle", "side: middle", "side: left"): [
        "drives: expected one traction and one steering drive in the middle, found no traction drive in the middle, "
        "found no steering drive in the middle, found 1 traction drive on the left, found 1 steering drive on the left",
    ],
    ("tricycle", "scrub_radius_m: 0", "scrub_radius_m: 0.01"): [
        "geometry.scrub_radius_m: expected 0 with one front wheel, found 0.01"
    ],
    ("tricycle", "front_wheels: 1", "front_wheels: 1\n  linkage: ackermann"): [
        "geometry.linkage: one front wheel needs no linkage: leave it out"
    ],
    ("tricycle", "front_wheels: 1", "front_wheels: 1\n  differential: true"): [
        "geometry.differential: one driven wheel needs no differential: leave it out"
    ],
    ("tricycle", "middle_m_per_count: 2.1276596e-4", "left_m_per_count: 2.1276596e-4"): [
        "calibration.traction.middle_m_per_count: this key is missing",
        "calibration.traction.left_m_per_count: there is no traction drive on the left: leave it out",
    ],
    ("small_car", "driven_axle: rear", "driven_axle: front"): [
        "geometry.scrub_radius_m: expected 0 for driven front wheels with a linkage or a differential (what they roll "
        "when they are steered is known only of wheels with their own motors)",
    ],
    ("small_car", "linkage: ackermann", "linkage: akermann"): [
        "geometry.linkage: expected 'ackermann', found 'akermann'; did you mean ackermann?"
    ],
    ("small_car", "stop_deg: 47.0", "stop_deg: 39.5"): [
        "calibration.steering.middle.stop_deg: expected beyond the 40 degrees to which limits.steering_deg lets the "
        "motor turn, found 39.5",
    ],
    ("small_car", "travel_deg: 94.0", "travel_deg: 87.0"): [
        "calibration.steering.middle.travel_deg: expected that it ends beyond the 40 degrees to which "
        "limits.steering_deg lets the motor turn, too, found 87",
    ],
    ("rear_driven", "motor_deg: 10, left_deg: 10.3", "motor_deg: 10, left_deg: -10.3"): [
        "geometry.linkage[6].left_deg: expected more than 0, the one before: each angle rises from row to row, "
        "found -10.3",
    ],
    ("rear_driven", "steering_deg: 45", "steering_deg: 55"): [
        "limits.steering_deg: 55 degrees are beyond the linkage's table: its ends turn the virtual wheel to -48.5 and "
        "48.5 degrees",
    ],
}  # fmt: skip


@pytest.mark.parametrize("edit", REFUSED, ids=lambda edit: f"{edit[0]}-{edit[2].strip()}")
def test_axles_that_do_not_fit_together_are_refused(edit: tuple[str, str, str], tmp_path: Path) -> None:
    name, old, new = edit
    text = (ROBOTS / f"{name}.yaml").read_text()
    assert old in text
    file = tmp_path / "robot.yaml"
    file.write_text(text.replace(old, new))
    with pytest.raises(ConfigError) as caught:
        load_model(file, RobotFile)
    told = [problem.removeprefix(f"{file}:").split(": ", 1)[1] for problem in caught.value.problems]
    assert told == REFUSED[edit]


def test_rows_that_a_robot_can_never_notice_say_so(capsys: pytest.CaptureFixture[str]) -> None:
    show_faults(["RUN-05", "STE-06", "STE-01"], False, ROBOTS / "rear_driven.yaml")
    told = capsys.readouterr().out
    assert "never noticed on rear-driven: it needs a steering motor at each front wheel" in told
    assert told.count("never noticed") == 1
    show_faults([], False, ROBOTS / "small_car.yaml")
    assert capsys.readouterr().out.count("never noticed on small-car: it needs") == 19


def test_rows_that_none_of_a_robot_s_drives_reports_say_so(capsys: pytest.CaptureFixture[str]) -> None:
    never = "never noticed on ARTEMIS with CiA 402 drives: none of its drives reports it"
    show_faults(["DRV-06", "DRV-31", "DRV-32"], False, ROBOTS / "artemis_cia402.yaml")
    assert "never" not in capsys.readouterr().out
    show_faults(["DRV-22", "DRV-29", "DRV-34", "DRV-38"], False, ROBOTS / "artemis_cia402.yaml")
    assert capsys.readouterr().out.count(never) == 4


def test_a_drive_that_is_asked_for_its_sto_inputs_shows_that_they_are_open(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sto = {"index": 0x2600, "type": "u8", "closed": 3}
    show_faults(["DRV-29"], False, steered_by_cia402(tmp_path, SWITCH, sto=sto))
    assert "never" not in capsys.readouterr().out


@pytest.mark.parametrize("off", [(), ("traction", "steering"), ("traction",)])
def test_drives_that_take_each_set_point_at_once_never_say_that_one_is_late(
    off: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = yaml.safe_load((ROBOTS / "artemis_epos4.yaml").read_text())
    for drive in words["drives"].values():
        drive["interpolation"] = drive["role"] not in off
    file = tmp_path / "robot.yaml"
    file.write_text(yaml.safe_dump(words))
    show_faults(["DRV-38"], False, file)
    assert ("never noticed on ARTEMIS with EPOS4: " in capsys.readouterr().out) is (len(off) == 2)


@pytest.mark.parametrize(
    ("type", "closed", "fits"),
    [
        ("u8", 0xFF, True), ("u8", 0x100, False), ("u8", 0x300, False), ("u8", 0x101, False),
        ("i8", 0x80, True), ("i8", 0x180, False), ("u16", 0x300, True), ("u16", 0x10000, False),
        ("u32", 0xFFFFFFFF, True),
    ],
)  # fmt: skip
def test_inputs_for_safe_torque_off_are_closed_by_bits_that_their_object_has(
    type: str, closed: int, fits: bool, tmp_path: Path
) -> None:
    sto = {"index": 0x2600, "type": type, "closed": closed}
    file = steered_by_cia402(tmp_path, SWITCH, sto=sto)
    if fits:
        load_model(file, RobotFile)
        return
    with pytest.raises(ConfigError) as refused:
        load_model(file, RobotFile)
    (problem,) = refused.value.problems
    assert f"drives.steering.cia402.sto.closed: 0x{closed:X} has bits that no {type} has" in problem


# --------------------------------------------------------------------------------------------- what shows the angle

CIA402 = {
    "vendor_id": 0x3B9,
    "operating_mode": 8,
    "velocity_units_per_rpm": 1.0,
    "acceleration_units_per_rpm_s": 1.0,
    "option_codes": {"abort_connection": 3},
}
ENCODER = {"index": 0x60E4, "subindex": 2, "type": "i32"}


def steered_by_cia402(tmp_path: Path, source: dict[str, object], **more: object) -> Path:
    """The small car whose steering drive is described by the robot file alone."""
    words = yaml.safe_load((ROBOTS / "small_car.yaml").read_text())
    words["calibration"]["steering"]["middle"] = source
    del words["drives"]["steering"]["gains"]
    words["drives"]["steering"] |= {"family": "cia402", "hardware_version": 0x1234, "cia402": {**CIA402, **more}}
    file = tmp_path / "robot.yaml"
    file.write_text(yaml.safe_dump(words))
    return file


@pytest.mark.parametrize("code", [1, 3])
@pytest.mark.parametrize("value", [0, 1, 2])
def test_a_lost_heartbeat_is_a_fault_or_ends_the_exchange_of_process_data(
    code: int, value: int, tmp_path: Path
) -> None:
    """Else every start would end in COM-30."""
    settings = [{"index": 0x1029, "subindex": 1, "type": "u8", "value": value}]
    more = {"settings": settings, "option_codes": {"abort_connection": code}}
    file = steered_by_cia402(tmp_path, {"angle": "by_hand"}, **more)
    if code == 1 or value == 0:
        load_model(file, RobotFile)
        return
    with pytest.raises(ConfigError) as refused:
        load_model(file, RobotFile)
    (problem,) = refused.value.problems
    assert "drives.steering.cia402.settings[0].value: " in problem
    what = (
        "would be Stopped when our heartbeat is lost, where nobody can ask it"
        if value == 2
        else "does not leave Operat"
    )
    assert f"with {value} the drive {what}" in problem
    assert problem.endswith("write 0 here, or `abort_connection: 1`")


ABSOLUTE = {"angle": "absolute_encoder", "bits": 14, "mirrored": False, "zero_deg": 3.0}
POTENTIOMETERS = {"zero_v": [2.5, 2.5], "slope_deg_per_v": [72.0, -72.0]}
SWITCH = {"angle": "home_switch", "switch_deg": 5.0, "on_side": "right"}
SCANNER = {f"LAS-0{number}" for number in (1, 2, 3, 5, 6, 7, 8, 9)}
SUPPLY = {"PWR-01", "PWR-02", "PWR-03"}
SINGLE = {"RUN-05", "RUN-06"}
"""Rows that need two traction motors."""


@pytest.mark.parametrize(
    ("source", "problem"),
    [
        (ABSOLUTE, "drives.steering.cia402.absolute_encoder: this key is missing: its angle is read there"),
        (POTENTIOMETERS, "drives.steering.cia402.analog_inputs: this key is missing: a steered wheel has two"),
        (
            {**SWITCH, "switch_deg": -39.5},
            "expected 1 degree or more within the 40 degrees to which limits.steering_deg",
        ),
    ],
)
def test_what_a_drive_does_not_show_is_named(source: dict[str, object], problem: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=re.escape(problem)):
        load_model(steered_by_cia402(tmp_path, source), RobotFile)


@pytest.mark.parametrize(
    ("source", "shown"),
    [
        (ABSOLUTE, "0x60E4:2"),
        (SWITCH, "0x60FD:0"),
        ({"angle": "by_hand"}, None),
        ({"angle": "hard_stop", "stop_deg": 50.0}, None),
    ],
)
def test_a_drive_that_the_file_describes_shows_what_finds_the_angle(
    source: dict[str, object], shown: str | None, tmp_path: Path
) -> None:
    described = load_model(steered_by_cia402(tmp_path, source, absolute_encoder=ENCODER), RobotFile)
    drive = described.drives["steering"]
    status, details = described.sent(drive)
    assert status == drive.tables.sent["steering"][0]
    assert [str(object) for object in details] == [*([shown] if shown else []), "0x606C:0"], "there is no current"
    assert sum(object.type.size for object in details) <= 8
    assert described.sent(described.drives["traction"]) == described.drives["traction"].tables.sent["traction"]


@pytest.mark.parametrize(
    ("name", "missed"),
    [
        ("artemis", {"CAL-03", *SCANNER, *SUPPLY}),
        ("artemis_battery", {"CAL-03", *SCANNER}),
        ("artemis_lms100", {"CAL-03", *SUPPLY}),
        ("artemis_cia402", {"CAL-02", "CAL-03", *SCANNER, *SUPPLY}),
        ("artemis_absolute", {"STE-03", "STE-04", "STE-07", "CAL-02", *SCANNER, *SUPPLY}),
        ("small_car_switch", {"STE-03", "STE-04", "STE-05", "STE-06", "STE-07", "CAL-02", *SCANNER, *SUPPLY, *SINGLE}),
    ],
)
def test_rows_that_need_what_is_not_there_are_missed(name: str, missed: set[str]) -> None:
    described = robot(name)
    assert {id for id, row in ROWS.items() if row.is_missed_by(described)} == missed


def test_a_stall_is_missed_where_no_drive_measures_the_current_of_the_steering(tmp_path: Path) -> None:
    described = load_model(steered_by_cia402(tmp_path, SWITCH), RobotFile)
    assert ROWS["STE-02"].is_missed_by(described)
    current = {"index": 0x6078, "type": "i16", "units_per_a": 1000.0}
    described = load_model(steered_by_cia402(tmp_path, SWITCH, current=current), RobotFile)
    assert not ROWS["STE-02"].is_missed_by(described)
