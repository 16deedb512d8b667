"""Every injection happens: on the wire, or in the true machine. What artemis makes of it is other tests' business."""

from __future__ import annotations

import itertools

import proofs_of_drives as proofs_of_drives
import proofs_of_localizers as proofs_of_localizers
import proofs_of_motion as proofs_of_motion
import proofs_of_scanners as proofs_of_scanners
import proofs_of_the_bus as proofs_of_the_bus
import proofs_of_the_host as proofs_of_the_host
import pytest
from injection_rig import FAULT_STATES, LEFT, PROOFS, RIGHT, ROBOT, ROBOT_4, ROBOT_402, STEER, Host, on_stage

from artemis.drive_states import DriveState
from artemis.families import EPOS4, FAMILIES
from artemis.families.cia402 import ERRORS as OF_THE_PROFILE
from artemis.sim.cia402 import ERRORS_402
from artemis.sim.epos4_errors import ERRORS_4
from artemis.supervision.catalogue import ROWS
from artemis_lab.injections.emergencies import CODES, TEXTS
from artemis_lab.injections.table import INJECTIONS, NOT_INJECTED


def test_every_row_of_the_fault_table_can_be_injected_or_tells_why_not() -> None:
    assert set(INJECTIONS) | set(NOT_INJECTED) == set(ROWS)
    assert not set(INJECTIONS) & set(NOT_INJECTED)


def test_every_injection_is_proven() -> None:
    assert PROOFS.keys() | TEXTS.keys() == INJECTIONS.keys()


@pytest.mark.parametrize("id", INJECTIONS)
def test_parameters_have_defaults_and_words(id: str) -> None:
    injection = INJECTIONS[id]
    assert injection.parameters().model_dump() is not None
    assert injection.text


@pytest.mark.parametrize("heard", [True, False])
@pytest.mark.parametrize(("id", "code"), [(id, code) for id, codes in CODES["epos1"].items() for code in codes])
def test_drive_reports_its_error_once_or_its_frame_is_lost(id: str, code: int, heard: bool) -> None:
    async def main(host: Host) -> None:
        host.inject(id, RIGHT, code=code, heard=heard)
        await host.tick(0.1)
        assert host.emergencies(RIGHT) == ([code] if heard else [])
        assert host.emergencies(LEFT) == []
        assert host.drive(RIGHT).read(0x1003, 1) == code
        if code != 0x8150:  # the only one without a reaction
            assert host.state(RIGHT) in FAULT_STATES

    on_stage(main)


@pytest.mark.parametrize("id", TEXTS)
def test_code_of_another_row_is_refused(id: str) -> None:
    with pytest.raises(ValueError, match=r"expected 0x[0-9A-F]{4}"):
        INJECTIONS[id].parameters.model_validate({"code": 0x9999})


def test_no_drive_watches_where_none_is_named() -> None:
    async def main(host: Host) -> None:
        host.inject("COM-30")
        host.beats = False
        await host.tick(0.5)
        assert [host.emergencies(name) for name in ROBOT.drives] == [[]] * 4

    on_stage(main)


@pytest.mark.parametrize("id", PROOFS)
def test_injection_happens(id: str) -> None:
    on_stage(PROOFS[id])


# ---------------------------------------------------------------------------------------------- on another generation

FAMILIAR = ("COM-03", "COM-04", "COM-05", "COM-06", "COM-33", "CAL-02", "SYS-10", "PWR-01", "EST-01")
"""Injections that mean something else on another generation of drives."""
OF_THE_MACHINE = [
    pytest.param(id, marks=[] if id in FAMILIAR else [pytest.mark.exhaustive])
    for id, proof in PROOFS.items()
    if proof.__module__ in ("proofs_of_drives", "proofs_of_motion", "proofs_of_the_bus")
]


@pytest.mark.parametrize("id", OF_THE_MACHINE)
def test_injection_happens_to_an_epos4(id: str) -> None:
    on_stage(PROOFS[id], ROBOT_4)


@pytest.mark.parametrize("id", [each for each in OF_THE_MACHINE if each.values != ("CAL-02",)])
def test_injection_happens_to_a_drive_of_the_profile(id: str) -> None:
    on_stage(PROOFS[id], ROBOT_402)


@pytest.mark.parametrize("id", CODES["cia402"])
def test_a_drive_of_the_profile_reports_each_error(id: str) -> None:
    async def main(host: Host) -> None:
        for name, code in zip(host.robot.drives, CODES["cia402"][id], strict=False):
            host.inject(id, name, code=code)
            await host.tick(0.5)
            assert host.emergencies(name) == [code]
            assert host.drive(name).read(0x1003, 1) == code
            assert host.state(name) is DriveState.FAULT

    on_stage(main, ROBOT_402)


@pytest.mark.parametrize("heard", [True, pytest.param(False, marks=pytest.mark.exhaustive)])
@pytest.mark.parametrize("id", CODES["epos4"])
def test_an_epos4_reports_each_error_of_its_own(id: str, heard: bool) -> None:
    async def main(host: Host) -> None:
        for name, code in zip(itertools.cycle(host.robot.drives), CODES["epos4"][id], strict=False):
            drive = host.drive(name)
            drive.power_on(host.loop.time())
            await host.tick(host.boot)
            host.take()
            host.inject(id, name, code=code, heard=heard)
            await host.tick(0.1)
            opens = code == 0x8A88 and heard  # the inputs open really, which disables nothing here
            assert host.emergencies(name) == ([code] if heard and not opens else [])
            assert drive.read(0x1003, 1) == (0 if opens else code)
            if not opens and code != 0xFF01:
                assert drive.state is DriveState.FAULT

    on_stage(main, ROBOT_4)


def test_codes_are_those_that_the_families_know() -> None:
    for family, rows in CODES.items():
        known = OF_THE_PROFILE if family == "cia402" else FAMILIES[family].errors
        assert {(code, id) for id, codes in rows.items() for code in codes} <= set(known.items())
    assert set(CODES["epos4"]) == set(EPOS4.errors.values())
    assert {code for codes in CODES["epos4"].values() for code in codes} <= set(ERRORS_4)
    assert OF_THE_PROFILE.keys() == ERRORS_402.keys()


def test_open_safe_torque_off_inputs_are_an_error_until_they_close() -> None:
    async def main(host: Host) -> None:
        close = host.inject("DRV-29", LEFT)
        await host.tick(0.04)
        assert host.emergencies(LEFT) == [0x8A88]
        assert host.drive(LEFT).read(0x3202, 1) == 0
        close()
        await host.tick(0.04)
        assert host.drive(LEFT).read(0x3202, 1) == 3

    on_stage(main, ROBOT_4)


def test_warm_surroundings_make_a_drive_too_hot() -> None:
    async def main(host: Host) -> None:
        host.inject("DRV-06", LEFT, ambient_c=110.0, duration_s=0.5)
        await host.tick(0.04)
        assert host.emergencies(LEFT) == [0x4210]
        assert host.drive(LEFT).read(0x3201, 1) == pytest.approx(1100, abs=20)
        await host.tick(0.6)
        assert host.drive(LEFT).read(0x3201, 1) == pytest.approx(250, abs=20)

    on_stage(main, ROBOT_4)


def test_lost_set_points_are_missed_by_a_cyclic_mode() -> None:
    async def main(host: Host) -> None:
        host.inject("COM-12", STEER)
        await host.tick(0.2)
        assert host.emergencies(STEER) == [0x8250]

    on_stage(main, ROBOT_4)


def test_an_emergency_stop_opens_what_it_is_told_to() -> None:
    async def main(host: Host) -> None:
        host.inject("EST-01", opens="supply")
        await host.tick(0.1)
        assert host.world.supply_voltage < 1.0
        assert host.drive(LEFT).read(0x3202, 1) == 3

    on_stage(main, ROBOT_4)

    async def without(host: Host) -> None:
        with pytest.raises(ValueError, match="no drive has safe torque off inputs"):
            host.inject("EST-01", opens="sto")

    on_stage(without)


# ---------------------------------------------------------------------------------------------- what cannot be done


def test_an_error_of_another_family_is_refused() -> None:
    async def main(host: Host) -> None:
        with pytest.raises(ValueError, match="DRV-34 is no error of a drive of family epos1, only of epos4"):
            host.inject("DRV-34", LEFT)
        with pytest.raises(ValueError, match="expected 0xFF02 or 0xFF03 of a drive of family epos1, found 0x7381"):
            host.inject("DRV-13", LEFT, code=0x7381)

    on_stage(main)


def test_calibration_that_no_drive_can_keep_is_refused() -> None:
    assert INJECTIONS["CAL-02"].families is not None
    assert "cia402" not in INJECTIONS["CAL-02"].families


@pytest.mark.parametrize("index", [0x0000, 0x6FFF])
@pytest.mark.parametrize("id", ["COM-07", "COM-10"])
def test_object_that_no_drive_has_is_refused(id: str, index: int) -> None:
    with pytest.raises(ValueError, match=f"no object 0x{index:04X} sub-index 0"):
        INJECTIONS[id].parameters.model_validate({"index": index, "sub": 0})


def test_drive_must_be_one_of_the_robots() -> None:
    async def main(host: Host) -> None:
        for node in (None, "steer-lft"):
            with pytest.raises(ValueError, match=r"needs one of the drives traction-left, .*, not"):
                host.inject("COM-26", node)
        with pytest.raises(ValueError, match="needs one of the inputs"):
            host.inject("INP-03", input="stick")

    on_stage(main)
