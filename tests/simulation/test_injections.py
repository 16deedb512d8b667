"""Every injection happens: on the wire, or in the true machine. What artemis makes of it is other tests' business."""

from __future__ import annotations

import proofs_of_drives as proofs_of_drives
import proofs_of_localizers as proofs_of_localizers
import proofs_of_motion as proofs_of_motion
import proofs_of_scanners as proofs_of_scanners
import proofs_of_the_bus as proofs_of_the_bus
import proofs_of_the_host as proofs_of_the_host
import pytest
from injection_rig import FAULT_STATES, LEFT, PROOFS, RIGHT, ROBOT, Host, on_stage

from artemis.supervision.catalogue import ROWS
from artemis_lab.injections.drives import CODES
from artemis_lab.injections.table import INJECTIONS, NOT_INJECTED


def test_every_row_of_the_fault_table_can_be_injected_or_tells_why_not() -> None:
    assert set(INJECTIONS) | set(NOT_INJECTED) == set(ROWS)
    assert not set(INJECTIONS) & set(NOT_INJECTED)


def test_every_injection_is_proven() -> None:
    assert PROOFS.keys() | CODES.keys() == INJECTIONS.keys()


@pytest.mark.parametrize("id", INJECTIONS)
def test_parameters_have_defaults_and_words(id: str) -> None:
    injection = INJECTIONS[id]
    assert injection.parameters().model_dump() is not None
    assert injection.text


@pytest.mark.parametrize("heard", [True, False])
@pytest.mark.parametrize(("id", "code"), [(id, code) for id, (_, codes) in CODES.items() for code in codes])
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


@pytest.mark.parametrize("id", CODES)
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


# ---------------------------------------------------------------------------------------------- what cannot be done


@pytest.mark.parametrize("index", [0x0000, 0x5FFF])
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
