"""Whole runs on drives of other families, alone and mixed: bring-up, driving, stops, faults, the ordered end."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import pytest
import yaml
from rig import CALIBRATE, EPOS2, MISSIONS, Rig, WatchedWorld, follow, write_mission

from artemis.drive_states import DriveState, Nmt
from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.sim.epos_settings import SimSettings
from artemis.values import Mode, Request

EPOS4, CIA402 = "artemis_epos4.yaml", "artemis_cia402.yaml"
AGAIN = {"operator": [{"at_s": 12.0, "do": "acknowledge"}, {"at_s": 22.0, "do": "arm"}]}


def mixed(mission: Path, traction: str = "artemis.yaml") -> Path:
    """The mission with traction drives of another robot beside its own steering drives."""
    robot = mission.with_name("artemis.yaml")
    drives = yaml.safe_load((MISSIONS / "robots" / traction).read_text())["drives"]
    described = yaml.safe_load(robot.read_text())
    described["drives"].update({name: drive for name, drive in drives.items() if drive["role"] == "traction"})
    robot.write_text(yaml.safe_dump(described, sort_keys=False))
    return mission


def ended_in_order(rig: Rig) -> bool:
    """Every drive is off, without a fault, Pre-Operational, and watches nobody."""
    assert rig.world is not None
    return all(
        (node.state, node.nmt, node.read(0x1016, 1)) == (DriveState.SWITCH_ON_DISABLED, Nmt.PRE_OPERATIONAL, 0)
        for node in rig.world.nodes
    )


@pytest.mark.parametrize("start", [7.0, -13.37])
def test_the_wheels_of_an_epos4_are_aligned_to_a_hundredth_of_a_step_of_its_analog_inputs(
    tmp_path: Path, start: float
) -> None:
    """A step is 0.35 degrees; each hundredth of a degree is 11 mm of the figure eight."""
    true = {"start_steering_left_deg": start, "start_steering_right_deg": start / 3}
    rig = Rig(write_mission(tmp_path, [{"wait": {"seconds": 0.1}}], robot=EPOS4, simulation={"true_robot": true}))
    seen = rig.run()
    assert (seen.status, seen.fault_ids) == (0, [])
    assert rig.world is not None
    told = {drive.name: drive.position for drive in seen.ticks[-1].snapshot.sensed.drives}
    errors = [math.degrees(told[name] - wheel.angle) for name, wheel in rig.world.steered.items()]
    assert errors == pytest.approx([0.0, 0.0], abs=0.0035)
    assert abs(errors[0] + errors[1]) / 2 < 0.002


@pytest.mark.exhaustive
def test_two_generations_drive_one_robot(tmp_path: Path) -> None:
    rig = Rig(mixed(write_mission(tmp_path, [CALIBRATE, follow(0.4)], robot=EPOS4)))
    seen = rig.run()
    assert (seen.status, seen.fault_ids, seen.is_done) == (0, [], True)
    assert {drive.name: drive.mode for drive in seen.ticks[-1].snapshot.sensed.drives} == {
        "traction-left": 3,
        "traction-right": 3,
        "steer-left": 8,
        "steer-right": 8,
    }
    assert seen.cross_track() < 0.005
    assert ended_in_order(rig)
    assert seen.recompute().difference is None


@pytest.mark.exhaustive
def test_a_quick_stop_is_the_drives_own_and_they_go_on_when_armed(tmp_path: Path) -> None:
    simulation = {"operator": [{"at_s": 21.0, "do": "arm"}]}
    rig = Rig(write_mission(tmp_path, [CALIBRATE, follow(0.4)], robot=EPOS4, simulation=simulation))
    rig.while_following(rig.request(Request.QUICKSTOP), name="stop")
    seen = rig.run()
    assert Mode.QUICKSTOP in seen.modes
    assert (seen.status, seen.fault_ids, seen.is_done) == (0, [], True)
    stopped = [tick for tick in seen.in_mode(Mode.QUICKSTOP) if tick.standing]
    assert stopped[0].now - seen.acts["stop"] < 0.4 / 1.5 + 0.15
    assert ended_in_order(rig)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("code", "row", "reset"),
    [(0x8130, "DRV-20", 0x82), (0x8611, "DRV-25", None), (0xFF02, "DRV-39", 0x81), (0x8250, "DRV-38", None)],
)
def test_an_error_of_an_epos4_means_its_own_row_and_goes_on_once_acknowledged(
    tmp_path: Path, code: int, row: str, reset: int | None
) -> None:
    rig = Rig(write_mission(tmp_path, [{"wait": {"seconds": 20.0}}], robot=EPOS4, simulation=AGAIN), longest=80.0)
    seen = rig.at(8.0, rig.emergency("steer-left", code)).run()
    assert seen.faults[0].id == row
    assert f"EMCY 0x{code:04X}" in seen.faults[0].text
    assert (seen.status, seen.is_done) == (0, True)
    resets = [
        frame.data[0]
        for tick in seen.seen
        if tick.time > 8.0
        for frame in tick.sent
        if frame.id == 0 and frame.data[1] == 3 and frame.data[0] in (0x81, 0x82)
    ]
    assert resets[:1] == ([0x82] if reset is None else [reset]), "0x82 comes with each proof of the watchdog"
    assert ended_in_order(rig)


@pytest.mark.parametrize(("described", "present"), [(EPOS4, "artemis.yaml"), ("artemis.yaml", EPOS4)])
def test_drives_of_another_family_are_refused_before_they_are_configured(
    tmp_path: Path, described: str, present: str
) -> None:
    other = load_mission(write_mission(tmp_path / "present", [{"wait": {"seconds": 1.0}}], robot=present))
    rig = Rig(
        write_mission(tmp_path / "described", [{"wait": {"seconds": 1.0}}], robot=described),
        world=WatchedWorld(other.robot),
    )
    seen = rig.run()
    assert seen.status == 1
    assert seen.faults[0].id == "COM-33"
    family, told = other.robot.drives["traction-left"].family, seen.faults[0].text
    assert f"is of family {family} (" in told
    assert told.endswith(f"the robot file says {'epos4' if described == EPOS4 else 'epos1'})")
    assert rig.drive("traction-left").read(0x1017) == 0, "nothing was written"


def test_the_second_generation_drives_the_robot(tmp_path: Path) -> None:
    rig = Rig(write_mission(tmp_path, [CALIBRATE, follow(0.4)], robot=EPOS2))
    seen = rig.run()
    assert (seen.status, seen.fault_ids, seen.is_done) == (0, [], True)
    assert rig.world is not None
    assert {type(node).__name__ for node in rig.world.nodes} == {"SimEpos2"}
    assert {node.read(0x605E, 0) for node in rig.world.nodes} == {2}
    assert ended_in_order(rig)


def test_a_fault_of_the_second_generation_stops_the_robot(tmp_path: Path) -> None:
    fault = {"at_s": 5.0, "inject": "DRV-11", "node": "traction-left"}
    steps = [CALIBRATE, follow(0.4)]
    rig = Rig(write_mission(tmp_path, steps, robot=EPOS2, simulation={"faults": [fault]}))
    seen = rig.run()
    assert seen.status == 1
    assert seen.fault_ids[0] == "DRV-11"
    assert ended_in_order(rig)


# ---------------------------------------------------------------------------------------------- described by the file


def described(mission: Path, traction: dict[str, object], steering: dict[str, object]) -> Path:
    """The mission with drives that the robot file describes so; None: it says nothing of it."""
    robot = mission.with_name("artemis.yaml")
    read = yaml.safe_load(robot.read_text())
    for drive in read["drives"].values():
        words = {**drive["cia402"], **(traction if drive["role"] == "traction" else steering)}
        drive["cia402"] = {key: value for key, value in words.items() if value is not None}
    robot.write_text(yaml.safe_dump(read, sort_keys=False))
    return mission


def test_traction_of_the_profile_and_steering_of_the_fourth_generation_share_a_robot(tmp_path: Path) -> None:
    rig = Rig(mixed(write_mission(tmp_path, [CALIBRATE, follow(0.4)], robot=EPOS4), CIA402))
    seen = rig.run()
    assert (seen.status, seen.fault_ids, seen.is_done) == (0, [], True)
    assert rig.world is not None
    assert [type(node).__name__ for node in rig.world.nodes] == ["SimCia402"] * 2 + ["SimEpos4"] * 2
    assert seen.cross_track() < 0.005
    assert ended_in_order(rig)
    assert seen.recompute().difference is None


FORGETFUL = {"settings": None, "reset_after_lost_heartbeat": True}


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("traction", "steering"),
    [
        (
            {"option_codes": {"abort_connection": 3, "quick_stop": 2}, "settings": None, "operating_mode": 9},
            {"option_codes": {"abort_connection": 2, "quick_stop": 1}, "brake": True, **FORGETFUL},
        ),
        (
            {"option_codes": None, "settings": None},
            {"option_codes": None, "settings": None, "interpolation_period": False, "current": None},
        ),
        (
            {"option_codes": {"abort_connection": 1, "quick_stop": 7}, "operating_mode": 9, **FORGETFUL},
            {"option_codes": {"abort_connection": 1, "quick_stop": 0, "fault_reaction": 0}, "brake": True},
        ),
    ],
    ids=["commands instead of faults", "no option codes", "brakes"],
)
def test_drives_with_other_option_codes_stop_and_go_on_when_armed(
    tmp_path: Path, traction: dict[str, object], steering: dict[str, object]
) -> None:
    simulation = {"operator": [{"at_s": 16.0, "do": "arm"}]}
    steps = [CALIBRATE, follow(0.4)]
    rig = Rig(described(write_mission(tmp_path, steps, robot=CIA402, simulation=simulation), traction, steering))
    rig.while_following(rig.request(Request.QUICKSTOP), name="stop")
    seen = rig.run()
    assert (seen.status, seen.fault_ids, seen.is_done) == (0, [], True)
    stopped = [tick for tick in seen.in_mode(Mode.QUICKSTOP) if tick.standing]
    assert stopped[0].now - seen.acts["stop"] < 0.4 / 1.5 + 0.15
    assert ended_in_order(rig)


@pytest.mark.parametrize(
    ("traction", "told"),
    [
        ({"option_codes": {"quick_stop": -2}}, "does not take the option code 0x605A:0 = -2 (quick stop): SDO abort"),
        ({"vendor_id": 0x11}, "node 1 is of vendor 0x12345678, not 0x11"),
        (
            {"option_codes": {"abort_connection": 3}, "settings": None},
            "does not watch the computer's heartbeat (no fault without our heartbeat; state switch on disabled)",
        ),
    ],
    ids=["option code", "identity", "a command that nothing shows"],
)
def test_what_a_described_drive_does_not_do_is_refused_with_its_reason(
    tmp_path: Path, traction: dict[str, object], told: str
) -> None:
    """Whom a lost heartbeat is a command, and who goes on exchanging (0x1029 = 1), shows nothing of it while off.

    A robot file that says so is refused; a drive may be so all the same.
    """
    steps = [{"wait": {"seconds": 1.0}}]
    present = load_mission(write_mission(tmp_path / "present", steps, robot=CIA402)).robot
    mission = described(write_mission(tmp_path / "described", steps, robot=CIA402), traction, {})
    world = WatchedWorld(present) if "vendor_id" in traction else None
    rig = Rig(mission, world=world)

    def stay() -> None:
        assert rig.world is not None
        for node in rig.world.nodes:
            node.poke(0x1029, 1, 1)

    seen = rig.at(0.0, stay).run()
    assert seen.status == 1
    assert told in seen.faults[0].text


SLOW = SimSettings(measure_s=2.0)
"""Drives that look for their commutation, or open a brake, before they are enabled."""


@pytest.mark.parametrize("allowed", [{"state_time_s": 5.0}, {}])
def test_a_drive_that_enables_slowly_is_waited_for_as_long_as_the_robot_file_says(
    tmp_path: Path, allowed: dict[str, object]
) -> None:
    """At the start, and again after a stop; nothing is to move before all drives are enabled."""
    simulation = {"operator": [{"at_s": 24.0, "do": "arm"}]}
    mission = write_mission(tmp_path, [CALIBRATE, follow(0.4)], robot=CIA402, simulation=simulation)
    rig = Rig(described(mission, allowed, allowed), settings=SLOW)
    rig.while_following(rig.request(Request.QUICKSTOP), name="stop")
    seen = rig.run()
    early = [
        tick.time
        for tick in seen.seen
        if not all(drive.state is DriveState.OPERATION_ENABLE for drive in tick.tick.snapshot.sensed.drives)
        and (tick.tick.set_points.speed_left or tick.tick.set_points.speed_right)
        and tick.mode in (Mode.FOLLOW, Mode.READY)
    ]
    assert early == []
    if allowed:
        assert (seen.status, seen.fault_ids, seen.is_done) == (0, [], True)
        assert ended_in_order(rig)
    else:
        assert seen.status == 1
        assert {fault.id for fault in seen.faults} == {"COM-03"}


ABSENT: dict[str, object] = {"absent": [0x6065, 0x607D, 0x607F, 0x6083, 0x6084, 0x6085]}


def test_drives_without_objects_that_are_usually_written_are_driven(tmp_path: Path) -> None:
    """They are not asked for either: the drives would refuse to tell."""
    mission = described(write_mission(tmp_path, [CALIBRATE, follow(0.4)], robot=CIA402), ABSENT, ABSENT)
    rig = Rig(mission)
    seen = rig.run()
    assert (seen.status, seen.fault_ids, seen.is_done) == (0, [], True)
    assert ended_in_order(rig)


def test_a_drive_that_lacks_more_than_the_robot_file_says_is_refused(tmp_path: Path) -> None:
    steps = [{"wait": {"seconds": 1.0}}]
    present = load_mission(described(write_mission(tmp_path / "p", steps, robot=CIA402), ABSENT, ABSENT)).robot
    seen = Rig(write_mission(tmp_path / "d", steps, robot=CIA402), world=WatchedWorld(present)).run()
    assert seen.faults[0].id == "COM-07"
    assert "0x6065:0" in seen.faults[0].text


def test_one_driven_wheel_without_power_stops_a_robot_at_once_however_slowly_its_drives_enable(tmp_path: Path) -> None:
    fault = {"at_s": 8.0, "inject": "RUN-06", "node": "traction-left"}
    mission = write_mission(tmp_path, [CALIBRATE, follow(0.4)], robot=CIA402, simulation={"faults": [fault]})
    seen = Rig(described(mission, {"state_time_s": 5.0}, {"state_time_s": 5.0})).run()
    assert seen.fault_ids[0] in ("RUN-06", "COM-02")
    stopped = next(tick for tick in seen.seen if tick.mode is Mode.FAULT)
    assert stopped.time == pytest.approx(8.0, abs=0.1)


@pytest.mark.parametrize(("present", "told"), [(2, None), (2, 2), (8, 8), (8, None)])
def test_drives_with_any_number_of_process_data_objects_are_driven(
    tmp_path: Path, present: int, told: int | None
) -> None:
    """What artemis does not map and the drive does not have is off; what else it has is off where the file says so."""
    mission = write_mission(tmp_path / "present", [{"wait": {"seconds": 0.1}}], robot=CIA402)
    world = WatchedWorld(load_mission(described(mission, {"pdos": present}, {"pdos": present})).robot)
    mission = write_mission(tmp_path / "told", [{"wait": {"seconds": 0.1}}], robot=CIA402)

    def use() -> None:
        """Somebody uses them, with identifiers of their own."""
        for node, number in itertools.product(world.nodes, range(4, present)):
            node.poke(0x1400 + number, 1, 0x190 + 0x10 * number + node.node_id)
            node.poke(0x1800 + number, 1, 0x40000198 + 0x10 * number + node.node_id)

    seen = Rig(described(mission, {"pdos": told}, {"pdos": told}), world=world).at(0.1, use).run()
    assert (seen.status, seen.fault_ids) == (0, [])
    for node in world.nodes:
        for parameters in (0x1400, 0x1800):
            valid = []
            for number in range(present):
                cob_id = node.read(parameters + number, 1)
                assert isinstance(cob_id, int)
                valid.append(not cob_id & 1 << 31)
            assert valid == [number < 2 or number >= (told or 4) for number in range(present)]


def test_a_drive_that_keeps_no_error_history_tells_the_state_in_which_it_stays(tmp_path: Path) -> None:
    """Object 0x1003 is optional (CiA 301): without it the history is empty."""
    mission = write_mission(tmp_path, [{"wait": {"seconds": 0.1}}], robot=CIA402)
    world = WatchedWorld(load_mission(mission).robot)
    drive = world.drive("traction-left")
    drive.failures.refuse_object(0x1003, 0, 0x06020000)
    drive.failures.refuse_states(DriveState.SWITCH_ON_DISABLED)
    rig = Rig(mission, world=world)
    seen = rig.at(0.1, lambda: drive.emergency(0x7320, rig.bus.loop.time(), heard=False)).run()
    assert seen.status == 1
    assert seen.faults[0].id == "COM-03"
    assert "stays in fault, not switch on disabled after fault reset; error history: empty" in seen.faults[0].text


def test_an_error_code_of_the_maker_s_own_means_the_row_that_the_robot_file_says(tmp_path: Path) -> None:
    words: dict[str, object] = {"errors": [{"code": 0x7305, "row": "DRV-11"}]}
    rig = Rig(described(write_mission(tmp_path, [CALIBRATE, follow(0.4)], robot=CIA402), words, {}))
    rig.while_following(rig.emergency("traction-left", 0x7305))
    seen = rig.run()
    assert seen.status == 1
    assert seen.faults[0].id == "DRV-11"
    assert "EMCY 0x7305" in seen.faults[0].text


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ({"absent": [0x6040]}, r"absent\[0\]: expected one of 0x6065, .*, found 0x6040"),
        (
            {"absent": [0x6065], "settings": [{"index": 0x6065, "type": "u32", "value": 1000}]},
            r"cia402\.settings\[0\]: 0x6065.* is one that the drive lacks \(`absent`\)",
        ),
        ({"errors": [{"code": 0x8611, "row": "DRV-11"}]}, "0x8611 means DRV-25 already"),
        ({"errors": [{"code": 0x7305, "row": "DRV-11"}] * 2}, "0x7305 is given twice"),
        ({"errors": [{"code": 0x7305, "row": "DRV-99"}]}, "DRV-99 is no error that a drive reports: see"),
        ({"errors": [{"code": 0x7305, "row": "COM-11"}]}, "COM-11 is no error that a drive reports"),
        ({"errors": [{"code": 0, "row": "DRV-11"}]}, "errors.*code"),
    ],
)
def test_what_a_described_drive_cannot_lack_or_tell_is_refused(
    tmp_path: Path, words: dict[str, object], told: str
) -> None:
    mission = described(write_mission(tmp_path, [CALIBRATE], robot=CIA402), words, {})
    with pytest.raises(ConfigError, match=told):
        load_mission(mission)
