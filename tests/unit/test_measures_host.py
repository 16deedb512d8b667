"""What is measured of bus, schedule and inputs, reading by reading. Limits and times: test_supervisor_rows.py."""

# ruff: noqa: ANN401  (changes are handed on to `dataclasses.replace` as they are)

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from core_builders import NAMES, PERIOD, ROBOT, drive, drives, sensed
from msgspec.structs import replace
from supervision_rig import DRIVING, OFF

from artemis.drive_states import DriveState
from artemis.mission.loading import load_model
from artemis.supervision.measures import DriveMeasures, HostMeasures, Reading
from artemis.values import BusHealth, OperatorInput, Wish
from artemis.vehicle import RobotFile

SICK = "steer-left"
FILES = Path(__file__).parents[2] / "missions" / "robots"

# ---------------------------------------------------------------------------------------------- bus and messages


class Host:
    """The measures of everything that is not one drive's state, tick by tick."""

    def __init__(self, robot: RobotFile = ROBOT) -> None:
        self.measures, self.time = HostMeasures(robot), 0.0

    def read(self, wish: Wish = DRIVING, after: float = PERIOD, **changes: Any) -> list[Reading]:
        self.time += after
        return list(self.measures.read(sensed(self.time, **changes), wish))

    def values(self, id: str, **changes: Any) -> list[float]:
        return [value for row, _, value, _ in self.read(**changes) if row == id]


def test_well_host_gives_no_reading() -> None:
    host = Host()
    assert [host.read() for _ in range(10)] == [[]] * 10


def test_frames_of_a_second_master_are_shown_the_first_four() -> None:
    health = BusHealth(foreign=(0x201, 0x000, 0x603, 0x080, 0x301))
    assert Host().read(bus=health) == [("COM-17", "", 1.0, "0x201, 0x000, 0x603, 0x080")]


def test_our_own_heartbeat_from_somebody_else_is_a_second_artemis() -> None:
    assert Host().read(bus=BusHealth(foreign=(0x201, 0x77F))) == [("COM-18", "", 1.0, "0x201, 0x77F")]


def test_refused_frames_are_counted_in_their_tick() -> None:
    host = Host()
    assert [host.values("COM-25", bus=BusHealth(refused=number)) for number in (3, 0, 1)] == [[3.0], [], [1.0]]


def test_every_frame_that_was_held_back_is_told() -> None:
    assert Host().read(bus=BusHealth(blocked=("one", "two"))) == [
        ("PLG-07", "", 1.0, "one"),
        ("PLG-07", "", 1.0, "two"),
    ]


def test_error_frames_are_those_of_a_tenth_of_a_second() -> None:
    host = Host()
    assert host.values("COM-20", bus=BusHealth(error_frames=2)) == [2.0]
    assert host.values("COM-20", after=0.099) == [2.0]
    assert host.values("COM-20", after=0.002) == []


def test_stray_answers_are_those_of_a_second_of_each_drive() -> None:
    host = Host()
    assert host.values("COM-19", drives=drives(drive(SICK, stray=2), drive("traction-left", stray=1))) == [1.0, 2.0]
    assert host.values("COM-19", drives=drives(drive(SICK, stray=1)), after=0.95) == [1.0, 3.0]
    assert host.values("COM-19", after=0.1) == [1.0]
    assert host.values("COM-19", after=1.0) == []


def test_damaged_frames_are_those_of_a_second_of_all_drives() -> None:
    host = Host()
    assert host.values("COM-14", drives=drives(drive(SICK, malformed=2), drive("traction-left", malformed=1))) == [3.0]
    assert host.values("COM-14", drives=drives(drive(SICK, malformed=1)), after=0.95) == [4.0]
    assert host.values("COM-14", after=0.1) == [1.0]
    assert host.values("COM-14", after=1.0) == []


def test_stray_answer_is_told_in_its_tick() -> None:
    host = Host()
    assert host.values("COM-09", drives=drives(drive(SICK, stray=3))) == [1.0]
    assert host.values("COM-09") == []


def test_emergencies_are_those_of_a_second_of_each_drive() -> None:
    host = Host()
    assert host.values("DRV-33", drives=drives(drive(SICK, emergencies=(0x2310, 0x0000)))) == [2.0]
    assert host.values("DRV-33", drives=drives(drive(SICK, emergencies=(0x8611,))), after=0.95) == [3.0]
    assert host.values("DRV-33", after=0.1) == [1.0]


UNDER_VOLTAGE = 0x3220


def test_drives_without_supply_are_counted_each_once() -> None:
    host = Host()
    lost = {name: drive(name, emergencies=(UNDER_VOLTAGE,)) for name in NAMES}
    assert host.values("EST-01", drives=drives(drive(NAMES[0], emergencies=(UNDER_VOLTAGE, UNDER_VOLTAGE)))) == [1.0]
    assert host.values("EST-01", drives=drives(lost[NAMES[0]])) == [1.0], "twice the same"
    assert host.values("EST-01", drives=drives(lost[NAMES[1]], lost[NAMES[2]])) == [3.0]
    assert host.values("EST-01", after=0.039) == [2.0]
    assert host.values("EST-01", after=0.002) == []
    assert host.values("EST-01", drives=drives(drive(SICK, emergencies=(0x2310,)))) == []


def test_drive_that_lost_its_supply_some_ticks_ago_lost_it_for_another_reason() -> None:
    host = Host()
    host.read(after=0.0, drives=drives(drive(NAMES[0], emergencies=(UNDER_VOLTAGE,))))
    assert host.values("EST-01", after=0.04, drives=drives(drive(NAMES[1], emergencies=(UNDER_VOLTAGE,)))) == [1.0]


@pytest.mark.parametrize(
    ("robot", "code", "lost"),
    [
        ("artemis", 0x3220, True),
        ("artemis", 0x8A88, False),  # of an EPOS of the first generation it means nothing
        ("artemis_epos4", 0x3220, True),
        ("artemis_epos4", 0x8A88, True),
        ("artemis_epos4", 0x8A8A, True),
        ("artemis_epos4", 0x8A8B, True),
        ("artemis_epos4", 0x8611, False),
    ],
)
def test_codes_of_lost_power_are_those_of_each_drives_family(robot: str, code: int, lost: bool) -> None:
    host = Host(load_model(FILES / f"{robot}.yaml", RobotFile))
    told = host.values("EST-01", drives=drives(emergencies=(code,)))
    assert told == ([4.0] if lost else [])


def test_what_says_it_all_needs_no_more_words() -> None:
    ill = drive(SICK, boots=1, disordered=1, jumps=1, state=DriveState.FAULT)
    seen = sensed(drives=drives(ill))
    assert [words for _, _, _, words in DriveMeasures(ROBOT, PERIOD).read(seen, OFF, set())] == [""] * 4
    told = Host().read(bus=BusHealth(refused=1), drives=drives(drive(SICK, stray=1)))
    assert {id: words for id, _, _, words in told} == {
        "COM-25": "",
        "COM-19": "1 answers too many in a second",
        "COM-09": "",
    }
    host = Host()
    host.read(inputs=(stick(-1.0),))
    assert host.read(inputs=(stick(1.0),)) == [("INP-08", "stick", 1.0, "")]


# ---------------------------------------------------------------------------------------------- schedule


def test_lateness_is_read_as_it_is() -> None:
    readings = Host().read(late=4.123)
    assert readings == [("SYS-01", "", 4.123, "4123 ms"), ("SYS-03", "", 4.123, "for 4123 ms")]


def test_gap_between_two_heartbeats_is_read_above_a_tenth_of_a_second() -> None:
    host = Host()
    host.read()
    assert host.values("COM-31", after=0.1 - 1e-9) == []
    assert host.values("COM-31", after=0.101) == [pytest.approx(0.101)]
    assert host.values("COM-31", after=0.12) == [pytest.approx(0.12)]


def test_gap_of_a_tenth_of_a_second_is_in_time() -> None:
    host = Host()
    host.read(after=0.0)
    assert host.values("COM-31", after=0.1) == []


def test_heartbeat_that_is_withheld_is_not_late() -> None:
    host = Host()
    host.read()
    withheld = replace(DRIVING, heartbeat=False)
    host.read(withheld)
    assert host.values("COM-31", after=0.5, wish=withheld) == []
    assert host.values("COM-31", after=0.5, wish=DRIVING) == []
    assert host.values("COM-31", after=0.5, wish=DRIVING) == [pytest.approx(0.5)]
    assert host.read(after=4.0)[0][3] == "4000 ms after the one before"


def test_extra_tick_is_neither_late_nor_a_heartbeat() -> None:
    host = Host()
    host.read()
    assert host.read(late=0.5, urgent=True, after=0.06) == []
    assert host.values("COM-31", after=0.06) == [pytest.approx(0.12)]


# ---------------------------------------------------------------------------------------------- inputs


def stick(*axes: float, source: str = "stick") -> OperatorInput:
    return OperatorInput(source=source, axes=axes)


def jumps(*samples: OperatorInput | None, after: float = PERIOD) -> list[float]:
    """How many jumps were read after each sample."""
    host = Host()
    told = []
    for sample in samples:
        found = host.values("INP-08", inputs=() if sample is None else (sample,), after=after)
        told.append(found[0] if found else 0.0)
    return told


def test_axis_that_jumps_further_than_a_hand_moves_it_is_read() -> None:
    assert jumps(stick(0.0), stick(1.0), stick(-0.2), stick(1.0)) == [0.0] * 4
    assert jumps(stick(-0.5, 0.0), stick(0.7001, 0.0), stick(0.7001, 0.0), stick(0.7, -1.0)) == [0.0, 1.0, 1.0, 1.0]
    assert jumps(stick(0.0, -1.0), stick(0.0, 1.0), stick(0.0, -1.0)) == [0.0, 1.0, 2.0]


def test_jumps_are_those_of_half_a_second() -> None:
    assert jumps(stick(-1.0), stick(1.0), stick(1.0), after=0.49) == [0.0, 1.0, 1.0]
    assert jumps(stick(-1.0), stick(1.0), stick(1.0), after=0.51) == [0.0, 1.0, 0.0]


def test_first_sample_and_other_axes_are_no_jump() -> None:
    assert jumps(stick(1.0), None, stick(1.0), stick(), stick(-1.0), stick(-1.0, 1.0)) == [0.0] * 6


def test_each_input_has_its_own_axes() -> None:
    host = Host()
    for _ in range(3):
        both = (stick(-1.0), stick(1.0, source="wheel"))
        assert host.values("INP-08", inputs=both) == []
