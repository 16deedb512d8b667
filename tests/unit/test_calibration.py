import random
from dataclasses import replace
from math import degrees, pi, radians
from pathlib import Path

import numpy as np
import pytest
from calibrated_drives import COUNT, DESCRIBED, STEP, counted_by_drives, drive, hidden, moved
from odometry_calibrations import calibrated
from plain_odometry_fit import BASE as TRICYCLE
from plain_odometry_fit import CIRCLES, mean_error, real_runs

from artemis.axles import Geometry, Potentiometers
from artemis.calibration import increments
from artemis.calibration.closing import Closed, fit_closing
from artemis.calibration.fit import fit
from artemis.calibration.fitted_run import Run
from artemis.calibration.increments import motions
from artemis.calibration.kinematics import ONE_WHEEL, TWO_WHEELS, Kinematics, altered, dead_reckoned
from artemis.calibration.machine_file import Machine, log_from_table
from artemis.calibration.robot_file import changes
from artemis.calibration.score import track
from artemis.calibration.wheel_log import WheelLog
from artemis.calibration.words import held_of, rows_of
from artemis.errors import CalibrationError, ConfigError
from artemis.mission.loading import load_model
from artemis.motion.odometry import Odometer
from artemis.motion.potentiometers import wheel_angles
from artemis.motion.trajectory import Trajectory
from artemis.vehicle import RobotFile

ROBOT = Path(__file__).parents[2] / "missions" / "robots" / "artemis.yaml"
BASE = Kinematics.of(DESCRIBED)


def odometer_poses(log: WheelLog, geometry: Geometry) -> np.ndarray:
    odometer = Odometer(geometry)
    odometer.update(0.0, 0.0, float(log.steering_left[0]), float(log.steering_right[0]), 0.02)
    poses = [(0.0, 0.0, 0.0)]
    distances = np.diff(log.distance_left), np.diff(log.distance_right)
    angles = log.steering_left[1:], log.steering_right[1:]
    for left, right, steer_left, steer_right in np.column_stack([*distances, *angles]).tolist():
        pose = odometer.update(left, right, steer_left, steer_right, 0.02).pose
        poses.append((pose.x, pose.y, pose.heading))
    return np.array(poses)


def one_wheel_log(seed: int) -> WheelLog:
    log = drive({}, seed, duration=40.0).log
    return WheelLog(
        name="one wheel",
        time=log.time,
        distance_left=log.distance_left,
        distance_right=log.distance_left,
        steering_left=log.steering_left,
        steering_right=log.steering_left,
    )


class TestDeadReckoning:
    def test_of_one_wheel_is_the_odometer_bit_for_bit_but_rounding(self) -> None:
        log = one_wheel_log(1)
        machine = Kinematics(wheelbase=0.56, kingpin_distance=0.0, scrub_radius=0.0)
        geometry = Geometry.model_construct(wheelbase_m=0.56, track_m=1e-12, scrub_radius_m=0.0, driven_axle="front")

        difference = dead_reckoned(log, machine) - odometer_poses(log, geometry)

        assert np.abs(difference[:, :2]).max() < 1e-9
        assert np.abs(np.sin(difference[:, 2])).max() < 1e-9

    def test_of_wheels_that_are_a_pair_is_the_odometer(self) -> None:
        log = drive({}, 2, slip=0.0).log

        difference = dead_reckoned(log, BASE) - odometer_poses(log, DESCRIBED)

        assert log.rolled > 25.0
        assert np.abs(difference[:, :2]).max() < 0.002

    def test_goes_astray_by_less_than_5_mm_in_100_m_of_weaving_at_less_than_30_hz(self) -> None:
        time = np.arange(0.0, 150.0, STEP)
        steering = radians(20.0) * np.sin(time * 2 * pi / 6.0)
        counted = counted_by_drives(np.full(len(time), 0.7), steering)
        poses = moved(BASE, counted, 0.0, random.Random(1))
        ticks = np.arange(0, len(time), 7)
        distances, angles = np.round(counted[ticks, :2] / COUNT) * COUNT, counted[ticks, 2:]
        log = WheelLog(
            name="weaving",
            time=time[ticks],
            distance_left=distances[:, 0],
            distance_right=distances[:, 1],
            steering_left=angles[:, 0],
            steering_right=angles[:, 1],
        )

        error = dead_reckoned(log, BASE) - poses[ticks]

        assert log.rolled > 100.0
        assert np.hypot(error[:, 0], error[:, 1]).max() < 0.005

    def test_knows_wheels_that_are_no_pair(self) -> None:
        values = hidden(4)
        driven = drive(values, 4, slip=0.0, duration=60.0)

        error = dead_reckoned(driven.log, altered(BASE, values)) - driven.poses
        described = dead_reckoned(driven.log, BASE) - driven.poses

        assert np.hypot(error[:, 0], error[:, 1]).max() < 0.003
        assert np.hypot(described[:, 0], described[:, 1]).max() > 0.1

    def test_of_a_rear_driven_machine(self) -> None:
        time = np.linspace(0.0, 2 * pi, 500)
        machine = Kinematics(wheelbase=1.0, kingpin_distance=0.5, scrub_radius=0.0, front_driven=False)
        left, right = np.full(500, np.arctan2(1.0, 1.75)), np.full(500, np.arctan2(1.0, 2.25))
        log = WheelLog(
            name="",
            time=time,
            distance_left=1.75 * time,
            distance_right=2.25 * time,
            steering_left=left,
            steering_right=right,
        )

        poses = dead_reckoned(log, machine)

        assert np.hypot(poses[:, 0], poses[:, 1] - 2.0) == pytest.approx(2.0, abs=1e-9)
        assert poses[-1] == pytest.approx([0.0, 0.0, 2 * pi], abs=1e-9)


class TestNoise:
    def test_covariance_is_that_of_drawn_errors(self) -> None:
        dice = np.random.default_rng(1)
        steps = np.column_stack([np.full(6, 0.1), np.zeros(6), np.full(6, 0.3)])
        poses = np.zeros((7, 3))
        for number, (distance, _, turn) in enumerate(steps):
            x, y, heading = poses[number]
            poses[number + 1] = x + distance * np.cos(heading), y + distance * np.sin(heading), heading + turn
        exact = motions(poses)
        sigmas = np.array([1e-3, 2e-3])
        drawn = []
        for _ in range(20_000):
            errors = dice.normal(size=(7, 3)) * (sigmas[0], sigmas[0], sigmas[1])
            drawn.append((motions(poses + errors) - exact).ravel())
        measured = np.cov(np.array(drawn).T)

        band = np.tensordot(sigmas**2, increments.covariances(exact, np.full(6, 0.1), (0.0, 0.0))[:2], axes=1)

        for below in range(increments.BAND):
            diagonal = np.diagonal(measured, -below)
            assert band[below, : len(diagonal)] == pytest.approx(diagonal, abs=2.5e-7)

    @pytest.mark.exhaustive
    def test_whitened_errors_have_unit_variance(self) -> None:
        driven = drive({}, 5, duration=40.0, slip=0.0, on_axle=True)
        found = fit([Run(log=driven.log, truth=driven.truth)], BASE, TWO_WHEELS)

        per_moment = 0.5 * np.median(1 / np.diff(driven.truth.time))

        assert found.noise[0] == pytest.approx(0.002 / np.sqrt(per_moment), rel=0.25)
        assert found.noise[1] == pytest.approx(radians(0.2) / np.sqrt(per_moment), rel=0.25)


class TestFit:
    @pytest.mark.exhaustive
    @pytest.mark.sampled(2)
    @pytest.mark.parametrize("headings", [True, False])
    def test_two_minutes_tell_what_the_figures_say(self, headings: bool) -> None:
        values = hidden(6) | {"kingpin distance": 0.0, "zero difference": 0.0}
        driven = drive(values, 6, on_axle=True)
        truth = driven.truth if headings else driven.truth.places()

        found = fit([Run(log=driven.log, truth=truth)], BASE, TWO_WHEELS)
        error = {each.parameter.name: each.value - values[each.parameter.name] for each in found.estimates[:-3]}

        assert abs(degrees(error["zero"])) < 0.05
        assert abs(error["scale"]) < 1e-3
        assert abs(error["distance"]) < 1e-3
        assert abs(error["wheelbase"]) < 3e-3
        assert found.sensor == (0.0, 0.0, 0.0)

    @pytest.mark.exhaustive
    def test_mean_error_on_another_way_is_below_2_per_mille(self) -> None:
        values = hidden(7)
        driven, other = drive(values, 7), drive(values, 70)

        found = fit([Run(log=driven.log, truth=driven.truth)], BASE, TWO_WHEELS)
        error = np.hypot(*(dead_reckoned(other.log, found.machine) - other.poses)[:, :2].T)

        assert error.mean() < 0.002 * other.log.rolled

    @pytest.mark.exhaustive
    def test_names_what_it_holds(self) -> None:
        driven = drive({}, 8, duration=60.0)

        held = dict(held_of(fit([Run(log=driven.log, truth=driven.truth)], BASE, TWO_WHEELS)))

        assert "zero difference" in held
        assert held["kingpin distance"].startswith("needs")

    def test_small_angles_do_not_tell_scale_from_wheelbase(self) -> None:
        values = {"wheelbase": 0.02}
        driven = drive(values, 9, duration=60.0, largest=10.0)

        found = fit([Run(log=driven.log, truth=driven.truth)], BASE, TWO_WHEELS)
        scale = next(each for each in found.estimates if each.parameter.name == "scale")

        assert not scale.seen
        assert scale.value == 0.0
        assert "30 degrees" in scale.reason

    @pytest.mark.exhaustive
    @pytest.mark.parametrize(("headings", "laid_within"), [(True, 0.01), (False, 0.03)])
    def test_finds_the_tracker_and_its_clock(self, headings: bool, laid_within: float) -> None:
        values = hidden(10)
        driven = drive(values, 10)
        truth = driven.truth if headings else driven.truth.places()
        late = Trajectory(time=truth.time + 1000.0, poses=truth.poses)

        found = fit([Run(log=driven.log, truth=late)], BASE, TWO_WHEELS)
        error = track(found.runs[0], found.machine, found.sensor, found.clocks[0]).error

        assert found.clocks[0].offset == pytest.approx(1000.0, abs=0.21)
        assert error.mean() < laid_within

    def test_standing_shows_nothing(self) -> None:
        driven = drive({}, 11, duration=60.0)
        log = driven.log
        log = WheelLog(
            name="still",
            time=log.time,
            distance_left=np.zeros(len(log.time)),
            distance_right=np.zeros(len(log.time)),
            steering_left=np.zeros(len(log.time)),
            steering_right=np.zeros(len(log.time)),
        )
        truth = Trajectory(time=log.time, poses=np.zeros((len(log.time), 3)))

        with pytest.raises(CalibrationError, match="drive farther"):
            fit([Run(log=log, truth=truth, one_clock=True)], BASE, TWO_WHEELS)

    @pytest.mark.exhaustive
    def test_places_find_the_tracker_too(self) -> None:
        driven = drive(hidden(7), 7)
        runs = [Run(log=driven.log, truth=driven.truth), Run(log=driven.log, truth=driven.truth.places())]

        with_headings, without, both = (fit(each, BASE, TWO_WHEELS) for each in (runs[:1], runs[1:], runs))

        assert np.hypot(*with_headings.sensor[:2]) > 0.05
        assert without.sensor[:2] == pytest.approx(with_headings.sensor[:2], abs=0.01)
        assert without.sensor[2] == 0.0
        assert both.sensor == pytest.approx(with_headings.sensor, abs=0.005)

    @pytest.mark.exhaustive
    @pytest.mark.timeout(900)
    @pytest.mark.parametrize(
        ("first", "on_axle", "errors"),
        [(1000, False, {}), (3000, True, {"wander": 0.01, "filtered": 0.2})],
        ids=["as described", "correlated slip and a filtered truth"],
    )
    def test_the_truth_is_in_the_interval_as_often_as_it_says(
        self, first: int, on_axle: bool, errors: dict[str, float]
    ) -> None:
        seeds = 12
        tallies = calibrated(range(first, first + seeds), on_axle, **errors)

        inside = sum(each.inside for each in tallies.values())

        assert 0.90 <= inside / (seeds * len(tallies)) <= 0.99 + 1 / seeds
        if not errors:
            assert all(each.inside >= 0.7 * seeds for each in tallies.values())


class TestRealRuns:
    @pytest.mark.exhaustive
    @pytest.mark.sampled(2)
    @pytest.mark.parametrize("headings", [True, False])
    def test_circular_runs_are_within_35_mm_by_a_fit_of_others(self, headings: bool) -> None:
        known, check = real_runs(*CIRCLES[:2]), real_runs(*CIRCLES[2:])
        if not headings:
            known = [replace(run, truth=run.truth.places()) for run in known]

        found = fit(known, TRICYCLE, ONE_WHEEL)

        assert mean_error(check, TRICYCLE) > 0.25
        assert mean_error(check, found.machine, found.sensor) < 0.035
        assert degrees(found.machine.zero_left) == pytest.approx(1.15, abs=0.15)


class TestClosing:
    def closed(self, values: dict[str, float], sense: float, seed: int) -> Closed:
        count = 2000
        steering = sense * np.clip(np.sin(np.linspace(0.0, 4 * pi, count)) + 0.75, 0.0, 0.6)
        distance = np.linspace(0.0, 12.0, count)
        time = np.linspace(0.0, 40.0, count)
        log = WheelLog(
            name=str(seed),
            time=time,
            distance_left=distance,
            distance_right=distance,
            steering_left=steering,
            steering_right=steering,
        )
        one = Kinematics(wheelbase=0.56, kingpin_distance=0.0, scrub_radius=0.0)
        x, y, heading = dead_reckoned(log, altered(one, values))[-1]
        noise = np.random.default_rng(seed).normal(size=3) * (0.003, 0.003, 0.005)
        return Closed(log=log, end=(x + noise[0], y + noise[1], heading + noise[2]))

    def test_both_directions_tell_zero_and_wheelbase(self) -> None:
        values = {"zero": radians(0.8), "wheelbase": 0.02, "distance": 0.005}
        runs = [self.closed(values, sense, seed) for seed, sense in enumerate([1.0, -1.0, 1.0, -1.0])]
        one = Kinematics(wheelbase=0.56, kingpin_distance=0.0, scrub_radius=0.0)

        found = fit_closing(runs, one, ONE_WHEEL)
        values_found = {each.parameter.name: each for each in found.estimates}

        assert degrees(values_found["zero"].value) == pytest.approx(0.8, abs=0.1)
        assert not values_found["scale"].seen
        assert np.abs(found.after).max() < 0.1 * np.abs(found.before).max()
        for name, true in values.items():
            assert abs(values_found[name].value - true) <= values_found[name].half_width

    def test_one_run_is_refused(self) -> None:
        with pytest.raises(CalibrationError, match="both directions"):
            fit_closing([self.closed({}, 1.0, 1)], BASE, TWO_WHEELS)


class TestRobotFile:
    def test_a_shifted_zero_makes_the_straight_wheel_show_0(self) -> None:
        robot = load_model(ROBOT, RobotFile)
        wheel = robot.potentiometers("left")
        straight = tuple(zero + 0.7 / slope for zero, slope in zip(wheel.zero_v, wheel.slope_deg_per_v, strict=True))
        assert np.degrees(wheel_angles((straight[0], straight[1]), wheel)) == pytest.approx(0.7)

        found = changes(robot, altered(Kinematics.of(robot.geometry), {"zero": radians(0.7)}))
        written = found["calibration", "steering", "left", "zero_v"]

        assert set(found) == {("calibration", "steering", side, "zero_v") for side in ("left", "right")}
        assert isinstance(written, list)
        shifted = Potentiometers.model_validate(wheel.model_dump() | {"zero_v": tuple(written)})
        assert np.degrees(wheel_angles((straight[0], straight[1]), shifted)) == pytest.approx(0.0, abs=1e-3)

    def test_all_keys(self) -> None:
        robot = load_model(ROBOT, RobotFile)
        values = {each.name: each.band for each in TWO_WHEELS}

        found = changes(robot, altered(Kinematics.of(robot.geometry), values))

        assert found["geometry", "wheelbase_m"] == pytest.approx(0.56 * 1.04)
        assert found["geometry", "track_m"] == pytest.approx(0.311 * 1.02 + 0.125 * 1.1)
        assert found["calibration", "steering", "left", "scale"] == pytest.approx(1.015)
        assert found["calibration", "steering", "right", "scale"] == pytest.approx(1.005)
        assert found["calibration", "traction", "right_m_per_count"] == pytest.approx(2.1276596e-4 * 1.015)

    def test_nothing_fitted_changes_nothing(self) -> None:
        robot = load_model(ROBOT, RobotFile)

        assert changes(robot, Kinematics.of(robot.geometry)) == {}


class TestMachineFile:
    def machine(self, **changed: object) -> Machine:
        plain = {
            "machine": "m",
            "columns": ["time", "distance", "steering"],
            "counts": "running",
            "metres_per_count": -0.01,
            "radians_per_steering_unit": pi / 180,
            "wheelbase_m": 0.3,
        }
        return Machine.model_validate(plain | changed)

    def test_counts_units_and_senses(self) -> None:
        rows = "".join(f"{0.1 * n:g}; {-n}; {10 + n}\n" for n in range(12))

        log, truth = log_from_table("t; counts; angle\n" + rows, "run.csv", self.machine(steering_zero=10.0))

        assert truth is None
        assert log.distance_left[-1] == pytest.approx(0.11)
        assert np.degrees(log.steering_right[-1]) == pytest.approx(11.0)

    def test_problems_tell_the_place(self) -> None:
        rows = "".join(f"{0.1 * n:g},{n},0\n" for n in range(12))

        with pytest.raises(ConfigError, match=r"run.csv:3:1: time: expected later"):
            log_from_table(rows.replace("0.2,", "0.05,"), "run.csv", self.machine())

    @pytest.mark.parametrize(
        ("changed", "words"),
        [
            ({"columns": ["time", "distance", "-"]}, "steering is missing"),
            ({"columns": ["time", "distance", "steering", "distance_left"]}, "distance_left is not of"),
            ({"columns": ["time", "distance", "steering", "distance"]}, "duplicate column"),
            ({"columns": ["time", "distance", "steering", "true_x"]}, "true_x and true_y"),
            ({"metres_per_count": 0.0}, "worth 0"),
            ({"track_m": 0.4}, "left and a right"),
        ],
    )
    def test_what_cannot_be_is_refused(self, changed: dict[str, object], words: str) -> None:
        with pytest.raises(ValueError, match=words):
            self.machine(**changed)


@pytest.mark.slow
def test_rows_have_left_right_and_mean() -> None:
    driven = drive(hidden(13), 13, duration=60.0, on_axle=True)
    found = fit([Run(log=driven.log, truth=driven.truth)], BASE, TWO_WHEELS, on_axle=True)

    rows = {row.name: row for row in rows_of(found, (2e-4, 2e-4))}

    assert (
        float(rows["steering zero, mean [deg]"].half_width) < 0.1 < float(rows["steering zero left [deg]"].half_width)
    )
    assert float(rows["metres per count left"].fitted) == pytest.approx(2e-4 * found.machine.distance_left, rel=1e-4)
