from __future__ import annotations

import asyncio
import math
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import ValidationError

from artemis.clock import run
from artemis.devices.can_bus import Frame
from artemis.sim.axis import Axis, Regulation
from artemis.sim.bus import SimBus
from artemis.sim.epos_settings import SimSettings
from artemis.sim.world import PlantParameters, Supply, World
from artemis.vehicle import RobotFile

ROBOT_FILE = Path(__file__).parents[2] / "missions" / "robots" / "artemis.yaml"
LEFT, RIGHT = "left", "right"
STRAIGHT = PlantParameters(start_steering_left_deg=0.0, start_steering_right_deg=0.0)


@pytest.fixture(scope="module")
def robot() -> RobotFile:
    return RobotFile.model_validate(yaml.safe_load(ROBOT_FILE.read_text()))


def straight(**options: object) -> PlantParameters:
    return PlantParameters.model_validate({**STRAIGHT.model_dump(), **options})


def axis_at(world: World, robot: RobotFile, role: str, side: str) -> Axis:
    name, _ = robot.drive_at(role, side)
    return next(node.axis for node in world.nodes if node.name == name)


def roll(world: World, robot: RobotFile, rpm_left: float, rpm_right: float) -> None:
    """Give the driven wheels a speed in their own drives' sense."""
    for side, rpm in ((LEFT, rpm_left), (RIGHT, rpm_right)):
        axis = axis_at(world, robot, "traction", side)
        axis.output_current, axis.acceleration, axis.deceleration = 10000.0, 5000.0, 5000.0
        axis.regulate(Regulation.VELOCITY, rpm)


def steer(world: World, robot: RobotFile, counts_left: float, counts_right: float) -> None:
    for side, counts in ((LEFT, counts_left), (RIGHT, counts_right)):
        axis = axis_at(world, robot, "steering", side)
        axis.output_current, axis.profile_velocity = 2000.0, 5000.0
        axis.regulate(Regulation.PROFILE, counts)


def test_mirrored_drives_turning_oppositely_drive_straight_ahead(robot: RobotFile) -> None:
    world = World(robot, STRAIGHT)
    roll(world, robot, 1500.0, -1500.0)
    world.advance(3.0)
    counts = axis_at(world, robot, "traction", LEFT).position
    assert world.pose.x == pytest.approx(counts * robot.metres_per_count(LEFT))
    assert world.pose.x > 1.0
    assert (world.pose.y, world.pose.heading) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert world.speed == pytest.approx(1500 / 60 * 72 * robot.metres_per_count(LEFT), rel=1e-3)


def test_wheel_scale_bends_what_the_software_takes_for_straight(robot: RobotFile) -> None:
    world = World(robot, straight(wheel_scale_left=1.02, wheel_scale_right=1.0))
    roll(world, robot, 1500.0, -1500.0)
    world.advance(3.0)
    counts = axis_at(world, robot, "traction", LEFT).position
    # Wheels held straight resist: least squares of rolling and grip, here sum and difference of the two ways.
    assert world.pose.x == pytest.approx(1.01 * counts * robot.metres_per_count(LEFT), rel=1e-3)
    assert world.pose.heading < 0.0


def test_positive_counts_steer_left_unless_mirrored(robot: RobotFile) -> None:
    world = World(robot, STRAIGHT)
    steer(world, robot, 52556.0, -52556.0)  # 10 degrees at 5255.6 counts per degree
    world.advance(3.0)
    assert [math.degrees(angle) for angle in world.wheel_angles] == pytest.approx([10.0, 10.0], abs=1e-3)


def test_counts_start_at_zero_whatever_the_wheels_angle(robot: RobotFile) -> None:
    world = World(robot)
    assert [node.axis.position for node in world.nodes] == [0.0] * 4
    assert [math.degrees(angle) for angle in world.wheel_angles] == pytest.approx([7.0, -4.0])


def test_potentiometers_follow_the_true_wheel_angle_through_the_calibration(robot: RobotFile) -> None:
    world = World(robot, PlantParameters(steering_zero_left_deg=0.8))
    for side, shown in ((LEFT, 7.0 - 0.8), (RIGHT, -4.0)):
        calibration = robot.potentiometers(side)
        voltages = axis_at(world, robot, "steering", side).analog
        angles = [
            slope * (voltage - zero)
            for slope, voltage, zero in zip(calibration.slope_deg_per_v, voltages, calibration.zero_v, strict=True)
        ]
        assert angles == pytest.approx([shown, shown])
    steer(world, robot, 52556.0, 0.0)
    world.advance(3.0)
    first, _ = axis_at(world, robot, "steering", LEFT).analog
    assert first == pytest.approx(2.51 + (17.0 - 0.8) / 72.0, abs=1e-5)


def test_potentiometer_noise_repeats_with_its_seed(robot: RobotFile) -> None:
    def voltages(seed: int) -> list[float]:
        world = World(robot, PlantParameters(potentiometer_noise_v=0.01), seed=seed)
        axis = axis_at(world, robot, "steering", LEFT)
        seen = []
        for step in range(1, 200):
            world.advance(step * 0.005)
            seen.append(axis.analog[0] - (2.51 + 7.0 / 72.0))
        return seen

    noise = voltages(1)
    assert noise == voltages(1)
    assert noise != voltages(2)
    assert math.sqrt(sum(v * v for v in noise) / len(noise)) == pytest.approx(0.01, rel=0.2)


def test_start_pose_is_the_true_rear_axle(robot: RobotFile) -> None:
    world = World(robot, straight(x_m=1.0, y_m=-2.0, heading_deg=90.0))
    roll(world, robot, 1500.0, -1500.0)
    world.advance(2.0)
    assert world.pose.x == pytest.approx(1.0)
    assert world.pose.y > -1.5
    assert world.pose.heading == pytest.approx(math.pi / 2)


def test_true_measures_replace_the_robot_files(robot: RobotFile) -> None:
    world = World(robot, PlantParameters(wheelbase_m=0.57, scrub_radius_m=0.0))
    assert (world.chassis.wheelbase, world.chassis.track, world.chassis.scrub_radius) == (0.57, 0.436, 0.0)


def test_rear_driven_robot_rolls_on_its_rear_wheels(robot: RobotFile) -> None:
    described = robot.model_dump()
    described["geometry"]["driven_axle"] = "rear"
    rear = RobotFile.model_validate(described)
    world = World(rear, STRAIGHT)
    roll(world, rear, 1500.0, -1500.0)
    world.advance(2.0)
    assert world.pose.x > 0.5


def test_one_long_advance_ends_where_many_short_ones_do(robot: RobotFile) -> None:
    def final_x(step: float) -> float:
        world = World(robot, STRAIGHT)
        roll(world, robot, 1500.0, -1500.0)
        for index in range(round(2.0 / step)):
            world.advance((index + 1) * step)
        return world.pose.x

    assert final_x(2.0) == pytest.approx(final_x(0.02))
    assert final_x(2.0) == pytest.approx(final_x(0.001), abs=2e-3)


def test_time_does_not_run_backwards(robot: RobotFile) -> None:
    world = World(robot, STRAIGHT, start=10.0)
    roll(world, robot, 1500.0, -1500.0)
    world.advance(11.0)
    before = world.pose
    world.advance(10.5)
    assert world.time == 11.0
    assert world.pose == before


def test_supply_sags_when_accelerating_and_rises_when_braking(robot: RobotFile) -> None:
    world = World(robot, STRAIGHT)
    assert world.supply_voltage == 25.0
    roll(world, robot, 2500.0, -2500.0)
    world.advance(0.4)
    assert 23.0 < world.supply_voltage < 24.95
    world.advance(3.0)
    roll(world, robot, 0.0, 0.0)
    world.advance(3.1)
    braking = world.supply_voltage
    assert 25.5 < braking < 30.0  # a planned stop does not trip the drives
    assert all(node.axis.supply_voltage == braking for node in world.nodes)
    world.advance(6.0)
    assert world.supply_voltage == pytest.approx(25.0)


def test_battery_that_takes_nothing_back_lets_braking_trip_the_drives(robot: RobotFile) -> None:
    world = World(robot, straight(supply=Supply(back_feed_resistance_ohm=3.0).model_dump()))
    roll(world, robot, 2500.0, -2500.0)
    world.advance(3.0)
    roll(world, robot, 0.0, 0.0)
    world.advance(3.1)
    assert world.supply_voltage > 31.0


def test_wrong_truth_is_refused() -> None:
    with pytest.raises(ValidationError):
        PlantParameters.model_validate({"steering_zero_deg": 1.0})
    with pytest.raises(ValidationError):
        PlantParameters(slip=-0.1)


def test_drives_boot_and_answer_on_the_simulated_bus(robot: RobotFile) -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        bus = SimBus(World(robot, settings=SimSettings(answer_time_s=0.0)), robot.bitrate, loop)
        woken = asyncio.Event()
        bus.listen(woken.set)
        await asyncio.wait_for(woken.wait(), 1.0)
        assert {frame.id for frame in bus.receive()} <= {0x701, 0x702, 0x703, 0x704}
        await asyncio.sleep(0.1)
        bus.receive()
        woken.clear()
        sent = loop.time()
        bus.send(Frame(0x603, bytes.fromhex("40 7C 20 01 00 00 00 00")))  # analog input 1 of the left steering drive
        await asyncio.wait_for(woken.wait(), 1.0)
        (answer,) = bus.receive()
        assert answer.id == 0x583
        assert int.from_bytes(answer.data[4:6], "little") == pytest.approx(2510 + 7000 / 72, abs=5)
        assert 0.23e-3 < answer.time - sent < 0.27e-3  # two frames and nothing else

    run(main(), simulated=True)


# ---------------------------------------------------------------------------------------------- failures


def test_robot_rolls_down_a_slope_without_power_and_not_on_flat_ground(robot: RobotFile) -> None:
    world = World(robot, STRAIGHT)
    world.slope = math.radians(0.5)  # friction holds it
    world.advance(1.0)
    assert world.pose.x == 0.0
    world.slope = math.radians(5.0)
    world.advance(2.0)
    assert world.pose.x > 0.2
    assert world.pose.y == pytest.approx(0.0, abs=1e-9)
    world.slope = 0.0
    world.advance(12.0)
    assert world.speed == 0.0
    world.slope = math.radians(-5.0)
    world.advance(13.0)
    assert world.speed < -0.2


def test_slope_accelerates_by_gravity_less_friction(robot: RobotFile) -> None:
    world = World(robot, STRAIGHT)
    world.slope = math.radians(5.0)
    world.advance(1.0)
    # 300 mA of friction are 0.12 m/s2; the rest is g sin 5 degrees = 0.855
    assert 0.6 < world.speed < 0.75


def test_emergency_stop_takes_the_supply_from_all_drives_and_gives_it_back(robot: RobotFile) -> None:
    world = World(robot, STRAIGHT)
    world.advance(0.1)
    for node in world.nodes:
        node.advance(0.1)  # it boots
    battery, world.battery_v = world.battery_v, 0.0
    for step in range(1, 11):
        world.advance(0.1 + 0.005 * step)
    assert world.supply_voltage < 1.0
    for node in world.nodes:
        node.advance(0.15)
        assert node.read(0x1003, 1) == 0x3220
    world.battery_v = battery
    world.advance(0.5)
    assert world.supply_voltage == pytest.approx(battery, abs=0.1)


def test_braking_into_an_open_switch_raises_no_more_than_its_energy(robot: RobotFile) -> None:
    world = World(robot, STRAIGHT)
    world.advance(0.1)
    roll(world, robot, 1500.0, -1500.0)
    world.advance(2.0)
    roll(world, robot, 0.0, 0.0)
    world.battery_v = 0.0
    highest = 0.0
    for step in range(100):
        world.advance(2.0 + 0.001 * step)
        highest = max(highest, world.supply_voltage)
    assert highest < 40.0
    assert world.supply_voltage < 5.0


def test_carried_robot_stands_elsewhere_and_no_wheel_has_turned(robot: RobotFile) -> None:
    world = World(robot, straight(x_m=1.0, y_m=2.0, heading_deg=90.0))
    counts = axis_at(world, robot, "traction", LEFT).position
    world.carry(0.5, 0.2, math.radians(30.0))
    assert (world.pose.x, world.pose.y) == pytest.approx((0.8, 2.5))
    assert world.pose.heading == pytest.approx(math.radians(120.0))
    world.advance(1.0)
    assert axis_at(world, robot, "traction", LEFT).position == counts


def test_drive_is_found_by_its_name(robot: RobotFile) -> None:
    assert World(robot).drive("steer-left").node_id == robot.drives["steer-left"].node_id


def with_battery(**changes: Any) -> RobotFile:  # noqa: ANN401 (as a file writes them)
    data = yaml.safe_load(ROBOT_FILE.with_name("artemis_battery.yaml").read_text())
    data["battery"] |= changes
    return RobotFile.model_validate(data)


def after(world: World, seconds: float) -> World:
    """The world after so long, in steps of 10 ms."""
    begin = world.time
    for step in range(1, round(100 * seconds) + 1):
        world.advance(begin + step / 100)
    return world


def test_battery_is_discharged_along_its_curve_by_the_energy_that_is_taken() -> None:
    robot = with_battery(capacity_ah=0.1, curve_v=[[0, 20.0], [50, 24.0], [100, 25.0]], idle_w=36.0)
    battery = robot.battery
    assert battery is not None
    world = World(robot, straight(supply={"battery_v": 25.0}))
    volts = [after(world, 60.0).battery_v for _ in range(3)]
    charges = [battery.charge_at(each) for each in volts]
    taken = [before - now for before, now in zip([1.0, *charges], charges, strict=False)]
    assert taken == pytest.approx([36.0 / each * 60.0 / 360.0 for each in (24.6, 24.1, 22.9)], rel=0.02)
    assert after(World(robot, straight(supply={"battery_v": 25.0, "capacity_scale": 10.0})), 60.0).battery_v > 24.9
    assert after(World(robot, straight(supply={"battery_v": 25.0, "idle_w": 0.0})), 60.0).battery_v == 25.0
    assert after(world, 300.0).battery_v == 1.0, "flat, not switched off"


def test_charger_gives_a_constant_current_and_then_keeps_its_voltage() -> None:
    robot = with_battery(capacity_ah=0.1, curve_v=[[0, 20.0], [100, 25.0]], idle_w=50.0)
    charger = {"x_m": 1.0, "y_m": 2.0, "within_m": 0.3, "current_a": 4.0, "up_to_v": 24.8}
    supply = {"battery_v": 23.0, "charger": charger, "source_resistance_ohm": 0.2}
    there = after(World(robot, straight(supply=supply, x_m=1.2, y_m=2.1)), 10.0)
    assert there.battery_v == pytest.approx(23.0 + 5.0 * 4.0 * 10.0 / 360.0, abs=0.01)
    assert there.supply_voltage == pytest.approx(there.battery_v + 0.2 * 4.0, abs=0.01)
    full = after(there, 120.0)
    assert (full.battery_v, full.supply_voltage) == pytest.approx((24.8, 24.8), abs=0.01)
    there.battery_v = 0.0
    assert after(there, 1.0).battery_v == 0.0, "an open switch stays open"
    away = after(World(robot, straight(supply=supply, x_m=1.4)), 10.0)
    assert away.battery_v < 23.0


def test_battery_without_either_stays_as_it_is(robot: RobotFile) -> None:
    world = World(robot, STRAIGHT)
    world.advance(100.0)
    assert world.battery_v == 25.0


@pytest.mark.parametrize("number", [1, 2])
def test_a_divider_shows_the_voltage_of_the_battery_at_an_analog_input(number: int) -> None:
    data = yaml.safe_load(ROBOT_FILE.with_name("artemis_battery.yaml").read_text())
    data["battery"]["measured"]["input"] = number
    robot = RobotFile.model_validate(data)
    world = World(robot, STRAIGHT)
    shown = [int(world.drive("traction-left").read(0x207C, each)) for each in (1, 2)]
    assert shown[number - 1] == pytest.approx(25.0 / 6 * 1000, abs=3)
    assert shown[2 - number] == 0
    roll(world, robot, 1500.0, -1500.0)
    world.advance(0.2)
    shown_now = int(world.drive("traction-left").read(0x207C, number))
    assert shown_now == pytest.approx(world.supply_voltage / 6 * 1000, abs=3)
