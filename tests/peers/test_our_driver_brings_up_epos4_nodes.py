"""Our driver against EPOS4 nodes of the `canopen` package, alone and beside drives of the first generation."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path

import pytest
from canopen.objectdictionary import ODVariable
from local_epos import LocalEpos
from local_epos4 import LocalEpos4
from node_bench import PERIOD, ROBOT, STEERING, Bench, on_virtual_time, refusals

from artemis.axles import AbsoluteEncoder
from artemis.drive_schema import Drive, drive_problems
from artemis.drive_states import DriveState
from artemis.mission.loading import load_mission
from artemis.plugins.guard import PluginGuard
from artemis.robot import Core, Robot
from artemis.states.mode import ON
from artemis.states.plan import Plan
from artemis.values import JobKind, Mode, SetPoints, Tick
from artemis.vehicle import RobotFile

EPOS4 = load_mission(Path(__file__).parents[2] / "missions" / "figure_eight_epos4.yaml").robot
MIXED = EPOS4.model_copy(
    update={"drives": {name: (ROBOT if name.startswith("traction") else EPOS4).drives[name] for name in EPOS4.drives}}
)
KINDS: dict[str, type[LocalEpos]] = {"epos4": LocalEpos4, "cia402": LocalEpos4}


def changed(name: str, **drive: object) -> RobotFile:
    """The robot with another description of one drive."""
    return with_drive(name, Drive(**{**EPOS4.drives[name].model_dump(exclude_unset=True), **drive}))


def with_drive(name: str, drive: Drive) -> RobotFile:
    return EPOS4.model_copy(update={"drives": {**EPOS4.drives, name: drive}})


def test_four_nodes_are_configured_as_the_robot_file_says() -> None:
    async def main() -> None:
        bench = Bench(EPOS4, KINDS)
        assert refusals(await bench.perform(JobKind.SECURE, JobKind.CONFIGURE)) == []
        left, steer = bench.nodes["traction-left"], bench.nodes["steer-left"]
        assert [node.value(0x6060) for node in bench.nodes.values()] == [9, 9, 8, 8]
        for node in bench.nodes.values():
            assert node.nmt.state == "OPERATIONAL"
            assert node.value(0x60C2, 1) == 20, "the SYNC period [ms]"
            assert node.value(0x1016, 1) == 127 << 16 | 200
            assert (node.value(0x6007), node.value(0x605A), node.value(0x605E), node.value(0x1029, 1)) == (3, 6, 2, 1)
            assert [bool(node.value(0x1400 + pdo, 1) & 1 << 31) for pdo in range(4)] == [False, False, True, True]
        assert (left.value(0x6402), left.value(0x3001, 3), left.value(0x3001, 5)) == (11, 12, 70_500)
        assert (left.value(0x3000, 1), left.value(0x3000, 5)) == (0x00100000, 72), "halls alone"
        assert (steer.value(0x6402), steer.value(0x3010, 1), steer.value(0x3000, 3)) == (1, 500, 0)
        assert steer.value(0x30A1, 1) == 1_500_000, "gains that the robot file does not give are left alone"

    on_virtual_time(main())


def test_gains_in_si_become_what_the_drive_counts_in() -> None:
    gains = {"current": [1.5, 4000.0], "velocity": [0.03, 0.6], "position": [2.0, 0.8, 0.02]}

    async def main() -> None:
        bench = Bench(changed("steer-left", si_gains=gains), KINDS)
        assert refusals(await bench.perform(JobKind.SECURE, JobKind.CONFIGURE)) == []
        node = bench.nodes["steer-left"]
        assert [node.value(0x30A0, sub) for sub in (1, 2)] == [1_500_000, 4_000_000]  # uV/A, uV/(A ms)
        assert [node.value(0x30A2, sub) for sub in (1, 2)] == [30_000, 600_000]
        assert [node.value(0x30A1, sub) for sub in (1, 2, 3)] == [2_000_000, 800_000, 20_000]

    on_virtual_time(main())


@pytest.mark.parametrize("robot", [EPOS4, MIXED], ids=["four EPOS4", "two of each generation"])
def test_the_whole_bring_up_reaches_ready_and_ends_in_order(robot: RobotFile) -> None:
    async def main() -> None:
        bench = Bench(robot, KINDS)
        ticks: list[Tick] = []
        core = Core(Plan(robot=robot, steps=()), PERIOD)
        await Robot(core, bench.drives, PluginGuard({}, asyncio.get_running_loop().time), PERIOD, ticks.append).run()

        assert [fault.text for tick in ticks for fault in tick.snapshot.verdict.faults] == []
        assert list(dict.fromkeys(tick.mode for tick in ticks)) == [Mode.INIT, Mode.READY, Mode.END]
        assert not ticks[-1].failed
        lost = {drive.name for tick in ticks for drive in tick.snapshot.sensed.drives if 0x8130 in drive.emergencies}
        assert lost == set(robot.drives), "each told that it missed our heartbeat"
        for name, angle in STEERING.items():
            node = bench.nodes[name]
            turned = node.position / (2000 * 946) * math.tau * (-1 if node.drive.mirrored else 1)
            assert angle + turned == pytest.approx(0.0, abs=math.radians(0.1))
        for node in bench.nodes.values():
            assert node.status == node.states.disabled
            assert node.value(0x1016, 1) == 0
            assert node.nmt.state == "PRE-OPERATIONAL"

    on_virtual_time(main())


def test_set_points_and_feedback_of_both_generations_share_a_bus() -> None:
    async def main() -> None:
        bench = Bench(MIXED, KINDS)
        assert refusals(await bench.perform(JobKind.SECURE, JobKind.CONFIGURE)) == []
        await bench.perform(JobKind.REFERENCE, JobKind.CLEAR_TARGET, value=0.0)
        points = SetPoints(speed_left=0.4, speed_right=0.4, steering_left=0.1, steering_right=0.1)
        await bench.tick(ON, points, count=10)
        left, _, steer, _ = bench.drives.sense(asyncio.get_running_loop().time()).drives
        assert (left.state, steer.state) == (DriveState.OPERATION_ENABLE,) * 2
        assert (left.mode, steer.mode) == (3, 8)
        assert steer.position == pytest.approx(0.1, abs=1e-5)
        angle = math.degrees(STEERING["steer-left"] + 0.1)
        known = MIXED.potentiometers("left")
        expected = [zero + angle / slope for zero, slope in zip(known.zero_v, known.slope_deg_per_v, strict=True)]
        assert steer.potentiometers == pytest.approx(expected, abs=6e-4)

    on_virtual_time(main())


def test_pdos_with_the_identifiers_of_another_node_are_switched_off_before_they_move() -> None:
    async def main() -> None:
        bench = Bench(EPOS4, KINDS)
        node = bench.nodes["steer-left"]
        for cob_id in (0x80000203, 0x80000205, 0x205):  # stored by somebody when its node id was 5
            node.put(0x1400, 1, cob_id, 4)
        assert refusals(await bench.perform(JobKind.SECURE, JobKind.CONFIGURE)) == []
        assert node.value(0x1400, 1) == 0x203

    on_virtual_time(main())


@pytest.mark.parametrize(
    ("robot", "kind", "problem"),
    [
        (EPOS4, LocalEpos, "node 3 is of family epos1 (EPOS, hardware 0x6150), the robot file says epos4"),
        (ROBOT, LocalEpos4, "node 3 is of family epos4 (EPOS4, hardware 0x6150), the robot file says epos1"),
    ],
)
def test_a_drive_of_another_family_is_refused_with_both_names(
    robot: RobotFile, kind: type[LocalEpos], problem: str
) -> None:
    async def main() -> None:
        bench = Bench(robot, {**KINDS, robot.drives["steer-left"].family: kind})
        node = bench.nodes["steer-left"]
        version = 0x6010 if kind is LocalEpos else 0x6150
        node.put(0x1018, 2, version << 16, 4)
        results = await bench.perform(JobKind.SECURE)
        (refused,) = [result for result in results if result.drive == "steer-left"]
        assert (refused.ok, refused.fault) == (False, "COM-33")
        assert refused.detail == problem.replace("0x6150", f"0x{version:04X}")

    on_virtual_time(main())


PROFILE = {
    "vendor_id": 0xFB,
    "velocity_units_per_rpm": 1.0,
    "acceleration_units_per_rpm_s": 1.0,
    "current": {"index": 0x30D1, "subindex": 1, "type": "i32", "units_per_a": 1000.0},
    "option_codes": {"abort_connection": 3, "quick_stop": 6, "fault_reaction": 2},
    "reset_after_lost_heartbeat": True,
}
ANALOG = [{"index": 0x3160, "subindex": sub, "type": "i16", "units_per_v": 1000.0} for sub in (1, 2)]


def described(name: str, **words: object) -> Drive:
    """An EPOS4 of which nothing is known but what the robot file says of a CiA 402 drive."""
    drive = EPOS4.drives[name]
    of_role = {"operating_mode": 9} if drive.role == "traction" else {"operating_mode": 8, "analog_inputs": ANALOG}
    given = drive.model_dump(exclude_unset=True)
    del given["motor"]["torque_constant_mnm_per_a"], given["si_gains"]
    given["sensor"].pop("inverted", None)
    changes = {"family": "cia402", "hardware_version": 0x61500000, "cia402": {**PROFILE, **of_role, **words}}
    return Drive(**{**given, **changes})


def test_drives_that_the_robot_file_describes_are_brought_up_and_driven() -> None:
    robot = EPOS4.model_copy(update={"drives": {name: described(name) for name in EPOS4.drives}})

    async def main() -> None:
        bench = Bench(robot, KINDS)
        ticks: list[Tick] = []
        core = Core(Plan(robot=robot, steps=()), PERIOD)
        await Robot(core, bench.drives, PluginGuard({}, asyncio.get_running_loop().time), PERIOD, ticks.append).run()
        assert [fault.text for tick in ticks for fault in tick.snapshot.verdict.faults] == []
        assert not ticks[-1].failed
        assert {node.value(0x60C2, 1) for node in bench.nodes.values()} == {20}

    on_virtual_time(main())


@pytest.mark.parametrize(
    ("words", "version", "problem"),
    [
        ({"vendor_id": 0x3B9}, 0x61500000, "node 3 is of vendor 0xFB, not 0x3B9"),
        ({}, 0x61500001, "node 3 is hardware 0x61500000, expected 0x61500001"),
        ({"option_codes": {"quick_stop": 2}}, 0x61500000, "does not take the option code 0x605A:0 = 2 (quick stop): "),
        (
            {"settings": [{"index": 0x6410, "subindex": 1, "type": "u16", "value": 1000}]},
            0x61500000,
            "SDO abort 0x06020000 at 0x6410:1",
        ),
    ],
)
def test_what_a_described_drive_does_not_have_or_take_is_named(
    words: dict[str, object], version: int, problem: str
) -> None:
    drive = described("steer-left", **words).model_copy(update={"hardware_version": version})

    async def main() -> None:
        bench = Bench(with_drive("steer-left", drive), KINDS)
        bench.nodes["steer-left"].put(0x1018, 2, 0x61500000, 4)
        results = await bench.perform(JobKind.SECURE, JobKind.CONFIGURE)
        refused = [result for result in results if not result.ok]
        assert {result.drive for result in refused} == {"steer-left"}
        assert refused[0].detail.startswith(problem)

    on_virtual_time(main())


def test_a_described_drive_that_does_nothing_without_our_heartbeat_is_refused() -> None:
    drive = described("steer-left", option_codes={})

    async def main() -> None:
        bench = Bench(with_drive("steer-left", drive), KINDS)
        node = bench.nodes["steer-left"]
        node.put(0x1018, 2, 0x61500000, 4)
        codes = node.object_dictionary[0x6007]
        assert isinstance(codes, ODVariable)
        codes.min = None
        node.put(0x6007, 0, 0, 2)
        await bench.perform(JobKind.SECURE)
        (refused,) = refusals(await bench.perform(JobKind.CONFIGURE))
        assert refused.startswith("configure steer-left: 0x6007:0 is 0 ")
        node.put(0x6007, 0, 3, 2)
        assert not refusals(await bench.perform(JobKind.SECURE, JobKind.CONFIGURE))

    on_virtual_time(main())


@pytest.mark.parametrize(("index", "cut", "good"), [(0x6007, 2, 3), (0x605A, 0, 6), (0x605E, 0, 2)])
def test_a_described_drive_whose_wheel_would_coast_needs_a_brake(index: int, cut: int, good: int) -> None:
    without, with_brake = (described("steer-left", option_codes={}, brake=brake) for brake in (False, True))

    async def main() -> None:
        bench = Bench(with_drive("steer-left", without), KINDS)
        node = bench.nodes["steer-left"]
        node.put(0x1018, 2, 0x61500000, 4)
        codes = node.object_dictionary[index]
        assert isinstance(codes, ODVariable)
        codes.min = None
        node.put(index, 0, cut, 2)
        await bench.perform(JobKind.SECURE)
        (refused,) = refusals(await bench.perform(JobKind.CONFIGURE))
        told = f"configure steer-left: 0x{index:04X}:0 is {cut} (cuts the power: without a brake the wheel coasts)"
        assert refused == told
        node.put(index, 0, good, 2)
        assert not refusals(await bench.perform(JobKind.SECURE, JobKind.CONFIGURE))

    on_virtual_time(main())
    options = {"abort_connection": 2, "quick_stop": 0, "fault_reaction": 0}
    assert not list(drive_problems(described("steer-left", option_codes=options, brake=True)))
    forbidden = {setting.object.index for (setting, _) in with_brake.tables.forbidden}
    assert forbidden == {0x6007}


def test_a_described_drive_needs_no_objects_that_are_not_used() -> None:
    """PDOs that are not mapped, and the error history, which CiA 301 leaves to the maker."""
    robot = with_drive("steer-left", described("steer-left"))

    async def main() -> None:
        bench = Bench(robot, KINDS)
        node = bench.nodes["steer-left"]
        node.put(0x1018, 2, 0x61500000, 4)
        for index in (0x1003, 0x1402, 0x1403, 0x1602, 0x1603, 0x1802, 0x1803, 0x1A02, 0x1A03):
            del node.object_dictionary[index]
        assert refusals(await bench.perform(JobKind.SECURE, JobKind.CONFIGURE)) == []
        (told,) = [each for each in await bench.perform(JobKind.READ_HISTORY) if each.drive == "steer-left"]
        assert (told.ok, told.values) == (True, ())

    on_virtual_time(main())


SETTING = {"index": 0x2200, "subindex": 0, "type": "u8", "value": 1}


@pytest.mark.parametrize(
    ("words", "key", "problem"),
    [
        (
            {"settings": [{**SETTING, "index": 0x1016, "subindex": 1}]},
            ("settings", 0),
            "0x1016:1 is written by artemis",
        ),
        ({"settings": [{**SETTING, "index": 0x6007}]}, ("settings", 0), "0x6007:0 is written by artemis"),
        ({"settings": [SETTING, {**SETTING, "index": 0x6085}]}, ("settings", 1), "0x6085:0 is written by artemis"),
        (
            {"settings": [{**SETTING, "index": 0x1A01, "subindex": 1}]},
            ("settings", 0),
            "0x1A01:1 is written by artemis",
        ),
        ({"settings": [{**SETTING, "index": 0x6040}]}, ("settings", 0), "0x6040:0 is written by artemis"),
        ({"settings": [{**SETTING, "value": 256}]}, ("settings", 0, "value"), "256 is no u8"),
        ({"option_codes": {"abort_connection": 0}}, ("option_codes", "abort_connection"), "0 is no reaction"),
        (
            {"option_codes": {"abort_connection": 2}},
            ("option_codes", "abort_connection"),
            "2 cuts the power: the wheel",
        ),
        ({"option_codes": {"quick_stop": 0}}, ("option_codes", "quick_stop"), "0 cuts the power: the wheel coasts"),
        ({"option_codes": {"fault_reaction": 0}}, ("option_codes", "fault_reaction"), "0 cuts the power: the wheel"),
        (
            {"analog_inputs": [ANALOG[0], {**ANALOG[1], "units_per_v": 100.0}]},
            ("analog_inputs", 1, "units_per_v"),
            "expected 1000, as of the first one",
        ),
        (
            {"current": {"index": 0x6078, "type": "u16", "units_per_a": 1000.0}},
            ("current", "type"),
            "u16 has no sign: a motor that feeds back would look like one that takes current",
        ),
    ],
)
def test_what_a_description_must_not_say_is_named(
    words: dict[str, object], key: tuple[str | int, ...], problem: str
) -> None:
    ((place, text),) = drive_problems(described("steer-left", **words))
    assert place == ("cia402", *key)
    assert text.startswith(problem)


def test_an_option_code_that_a_drive_does_not_take_is_named() -> None:
    async def main() -> None:
        bench = Bench(EPOS4, KINDS)
        node = bench.nodes["steer-left"]
        allowed = node.object_dictionary[0x6007]
        assert isinstance(allowed, ODVariable)
        allowed.max = 2
        node.set_data(0x6007, 0, b"\x02\x00")
        await bench.perform(JobKind.SECURE)
        (refused,) = [result for result in await bench.perform(JobKind.CONFIGURE) if not result.ok]
        assert (refused.drive, refused.fault) == ("steer-left", "COM-10")
        named = "does not take the option code 0x6007:0 = 3 (reaction to a lost connection: quick-stop ramp): "
        assert refused.detail.startswith(named + "SDO abort 0x06090030 at 0x6007:0")

    on_virtual_time(main())


def test_a_sensor_with_another_resolution_is_refused() -> None:
    async def main() -> None:
        bench = Bench(EPOS4, KINDS)
        bench.nodes["steer-left"]._measured[0x3000, 5] = lambda: 4096
        await bench.perform(JobKind.SECURE)
        (refused,) = refusals(await bench.perform(JobKind.CONFIGURE))
        assert refused == (
            "configure steer-left: has 4096 increments of the main sensor per motor turn (0x3000:5), "
            "the robot file says 2000"
        )

    on_virtual_time(main())


ABSOLUTE = load_mission(Path(__file__).parents[2] / "missions" / "figure_eight_absolute.yaml").robot


class LocalEpos4WithEncoder(LocalEpos4):
    """One with an SSI encoder at the wheel that it steers."""

    def _measure_angle(self, robot: RobotFile, angle: float) -> None:
        known = robot.angle_source(self.drive.side)
        assert isinstance(known, AbsoluteEncoder)
        sign = -1 if self.drive.mirrored else 1

        def counts() -> int:
            if self.value(0x3000, 1) >> 8 & 0xFF != 3:
                return 0
            bits = self.value(0x3012, 0xB) & 0xFF
            turned = sign * self.position / (self.drive.sensor.counts_per_turn * self.drive.gear_ratio) * 360
            wheel = math.degrees(angle) + turned
            shown = known.zero_deg + (-wheel if known.mirrored else wheel)
            return round(shown / 360 * (1 << bits)) % (1 << bits)

        self._measured[0x60E4, 2] = counts


def test_absolute_encoders_are_configured_and_tell_the_angles_in_one_reading() -> None:
    async def main() -> None:
        bench = Bench(ABSOLUTE, {"epos4": LocalEpos4WithEncoder})
        ticks: list[Tick] = []
        core = Core(Plan(robot=ABSOLUTE, steps=()), PERIOD)
        await Robot(core, bench.drives, PluginGuard({}, asyncio.get_running_loop().time), PERIOD, ticks.append).run()
        assert [fault.text for tick in ticks for fault in tick.snapshot.verdict.faults] == []
        assert list(dict.fromkeys(tick.mode for tick in ticks)) == [Mode.INIT, Mode.READY, Mode.END]
        for name, angle in STEERING.items():
            node = bench.nodes[name]
            assert node.value(0x3000, 1) == 0x0301, "digital encoder and SSI"
            assert [node.value(0x3012, sub) for sub in (2, 3, 0xB)] == [17 << 8, 1, 17]
            turned = node.position / (2000 * 946) * math.tau * (-1 if node.drive.mirrored else 1)
            assert angle + turned == pytest.approx(0.0, abs=math.radians(0.01))

    on_virtual_time(main())
