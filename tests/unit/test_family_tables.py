"""The tables of drive families: complete, within what CAN carries, and clear about whose drive is found."""

from __future__ import annotations

from pathlib import Path

import pytest
from core_builders import ROBOT

import artemis
from artemis.devices.epos_objects import PERIOD, quantities
from artemis.drive_states import DriveState
from artemis.families import EPOS1, EPOS4, FAMILIES, GENERATIONS, Family
from artemis.families.family import ENCODERS, MOTORS, SENSORS
from artemis.families.objects import CONTROLWORD, POSITION, STATUSWORD

every_family = pytest.mark.parametrize("family", FAMILIES.values(), ids=lambda family: family.name)
OF_AN_ENCODER = {"SSI frame", "SSI position", "SSI coding"}
GIVEN_IN_SOME_FILES = {"torque constant", "pulses", *OF_AN_ENCODER, *(f"gain {number}" for number in range(7))}


@every_family
def test_every_quantity_that_is_configured_is_known(family: Family) -> None:
    known = set(quantities(ROBOT, ROBOT.drives["steer-left"], PERIOD)) | GIVEN_IN_SOME_FILES
    known |= {*family.choices, *family.inverted}
    asked = {quantity for _, quantity in family.configuration if isinstance(quantity, str)}
    assert asked - known == set()
    assert {quantity for _, quantity, _ in family.checks} <= known
    assert set(family.choices) <= asked


@every_family
def test_no_object_is_configured_twice(family: Family) -> None:
    objects = [object for object, _ in family.configuration] + [code.setting.object for code in family.option_codes]
    assert len(objects) == len(set(objects))


@every_family
def test_what_measures_the_angle_instead_of_potentiometers_fits_their_pdo(family: Family) -> None:
    rest = sum(object.type.size for object in family.sent["steering"][1] if object not in family.analog)
    for object in (family.absolute, family.inputs):
        assert object is None or object.type.size + rest <= 8
    assert family.with_absolute.keys() <= set(family.choices)


@every_family
@pytest.mark.parametrize("role", ["traction", "steering"])
def test_process_data_fit_their_pdos(family: Family, role: str) -> None:
    set_point, stop = family.received[role]
    assert set_point == (CONTROLWORD, family.set_points[role])
    assert stop == (CONTROLWORD,)
    assert family.sent[role][0][:2] == (STATUSWORD, POSITION)
    for pdo in (set_point, stop, *family.sent[role]):
        assert sum(object.type.size for object in pdo) <= 8


@every_family
def test_every_motor_has_a_sensor_and_every_pair_all_its_numbers(family: Family) -> None:
    for motor in MOTORS:
        assert all(family.drives(motor, encoder) for encoder in ENCODERS)
    pairs = {(motor, sensor) for motor in MOTORS for sensor in SENSORS if family.drives(motor, sensor)}
    assert all(pairs <= set(table) for table in family.choices.values())
    assert EPOS1.drives("dc", "hall")
    assert not EPOS4.drives("dc", "hall")


@every_family
def test_patterns_lie_within_the_mask(family: Family) -> None:
    assert all(pattern & family.mask == pattern for pattern in family.states)
    assert family.state(0xFFFF) is DriveState.UNKNOWN


def test_statuswords_of_one_generation_are_not_states_of_the_other() -> None:
    assert EPOS4.state(0x0237) is DriveState.OPERATION_ENABLE
    assert EPOS1.state(0x0237) is DriveState.UNKNOWN, "without bit 8"
    assert EPOS1.state(0x0337) is DriveState.OPERATION_ENABLE
    assert EPOS4.state(0x4333) is DriveState.SWITCHED_ON, "Refresh of the first generation"
    assert {EPOS4.state(word) for word in (0x0008, 0x0028, 0x0208)} == {DriveState.FAULT}, "bit 5 tells nothing in it"


@pytest.mark.parametrize(
    ("version", "name"), [(0x6010, "epos1"), (0x6210, "epos1"), (0x6220, "epos2"), (0x6150, "epos4"), (0x6552, "epos4")]
)
def test_hardware_version_tells_the_generation(version: int, name: str) -> None:
    assert GENERATIONS[version >> 4 & 0xF].name == name


def test_an_object_is_named_as_data_sheets_do_and_mapped_with_its_size() -> None:
    assert str(POSITION) == "0x6064:0"
    assert (POSITION.mapping, STATUSWORD.mapping) == (0x60640020, 0x60410010)


CORE = "states", "supervision", "motion", "devices", "robot.py", "values.py", "plugins", "recording", "report"


def test_no_file_of_the_core_names_a_family() -> None:
    """But the two protocols of serial lines, which have names of families that speak them."""
    package = Path(artemis.__file__).parent
    names = {f'"{name}"' for name in (*FAMILIES, "cia402")}
    files = [
        file for part in CORE for file in sorted(package.glob(part if part.endswith(".py") else f"{part}/**/*.py"))
    ]
    assert len(files) > 100
    found = {file.name for file in files if any(name in file.read_text() for name in names)}
    assert found == {"serial_frames.py"}
