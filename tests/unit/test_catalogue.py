"""The fault table: complete for the first-generation EPOS, well formed, and known to everything that raises a fault."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from artemis.supervision import catalogue
from artemis.values import Severity

CODES = [
    0x1000, 0x2310, 0x3210, 0x3220, 0x4210, 0x5113, 0x6100, 0x6320, 0x7320,
    0x8110, 0x8111, 0x8120, 0x8130, 0x8150, 0x81FD, 0x81FE, 0x81FF, 0x8210, 0x8611,
    0xFF01, 0xFF02, 0xFF03, 0xFF04, 0xFF06, 0xFF07, 0xFF08, 0xFF09, 0xFF0A, 0xFF0B,
]  # fmt: skip
"""Device errors, EPOS firmware specification 2010, 12.2."""

SOURCES = Path(catalogue.__file__).parents[1]
ID = re.compile(r"[A-Z]{3}-\d{2}")


def written_rows() -> list[str]:
    """Keys of the table as they stand in the source, where a dict would hide one that is there twice."""
    tree = ast.parse(Path(catalogue.__file__).read_text(encoding="utf-8"))
    for node in tree.body:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.target.id == "ROWS":
            assert isinstance(node.value, ast.Dict)
            return [str(ast.literal_eval(key)) for key in node.value.keys if key is not None]
    raise AssertionError("no table")


def raised_ids() -> set[str]:
    """Every fault id that stands as a string in the program."""
    found: set[str] = set()
    for path in SOURCES.rglob("*.py"):
        if path.name != "catalogue.py":
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Constant) and isinstance(node.value, str) and ID.fullmatch(node.value):
                    found.add(node.value)
    return found


def test_every_error_code_of_the_first_generation_has_its_row() -> None:
    assert sorted(catalogue.EMERGENCIES) == CODES
    for id in catalogue.EMERGENCIES.values():
        assert id.startswith("DRV-")
        assert id != "DRV-99"
        assert id in catalogue.ROWS


def test_no_row_is_there_twice() -> None:
    assert sorted(written_rows()) == sorted(catalogue.ROWS)


@pytest.mark.parametrize(("id", "row"), catalogue.ROWS.items())
def test_every_row_has_an_id_a_reaction_and_words(id: str, row: catalogue.Row) -> None:
    assert ID.fullmatch(id)
    assert row.severity > Severity.NONE
    assert row.text == row.text.strip() != ""
    if row.to_fault:
        assert row.severity >= Severity.CONTROLLED_STOP, "a fault that does not even stop the robot"


def test_texts_are_different() -> None:
    texts = [row.text for row in catalogue.ROWS.values()]
    assert len(set(texts)) == len(texts)


def test_drive_faults_stop_at_once_and_need_the_operator() -> None:
    for id, row in catalogue.ROWS.items():
        if id.startswith("DRV"):
            assert (row.severity, row.to_fault) == (Severity.QUICK_STOP, True)


def test_program_raises_only_faults_of_the_table() -> None:
    assert raised_ids() <= set(catalogue.ROWS)


def test_every_row_is_raised_somewhere() -> None:
    unused = set(catalogue.ROWS) - raised_ids() - set(catalogue.EMERGENCIES.values()) - {"DRV-99"}
    assert unused == set()


def test_fault_names_its_device_and_what_was_seen() -> None:
    fault = catalogue.fault("COM-11", "steer-left", "90 ms old")
    assert (fault.id, fault.device, fault.severity, fault.to_fault) == (
        "COM-11",
        "steer-left",
        Severity.QUICK_STOP,
        True,
    )
    assert fault.text == "steer-left: feedback lost (90 ms old)"
    assert catalogue.fault("COM-22").text == "CAN adapter lost"


def test_unknown_id_is_a_bug_of_ours() -> None:
    with pytest.raises(KeyError, match="COM-99"):
        catalogue.fault("COM-99")


@pytest.mark.parametrize("code", CODES)
def test_known_code_is_its_row_and_the_code_is_shown(code: int) -> None:
    fault = catalogue.emergency("traction-left", code)
    assert fault.id == catalogue.EMERGENCIES[code]
    assert fault.device == "traction-left"
    assert f"0x{code:04X}" in fault.text


@pytest.mark.parametrize("code", [0x0001, 0x2320, 0x8250, 0xF001, 0xFFFF])
def test_unknown_code_is_a_fault_as_well(code: int) -> None:
    fault = catalogue.emergency("traction-left", code)
    assert (fault.id, fault.severity, fault.to_fault) == ("DRV-99", Severity.QUICK_STOP, True)
    assert f"0x{code:04X}" in fault.text
