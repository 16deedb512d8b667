"""The fault table: complete for the first-generation EPOS, well formed, and known to everything that raises a fault."""

from __future__ import annotations

import ast
import re
from functools import cache
from math import inf
from pathlib import Path

import pytest

from artemis.families import EPOS1, EPOS4, FAMILIES, Family
from artemis.supervision import catalogue
from artemis.supervision.catalogue.row import ITSELF, SHORT, Found, K, Kind, Row, X, automatic
from artemis.supervision.policy import WATCHED
from artemis.values import RESETS, Severity

CODES = [
    0x1000, 0x2310, 0x3210, 0x3220, 0x4210, 0x5113, 0x6100, 0x6320, 0x7320,
    0x8110, 0x8111, 0x8120, 0x8130, 0x8150, 0x81FD, 0x81FE, 0x81FF, 0x8210, 0x8611,
    0xFF01, 0xFF02, 0xFF03, 0xFF04, 0xFF06, 0xFF07, 0xFF08, 0xFF09, 0xFF0A, 0xFF0B,
]  # fmt: skip
"""Device errors, EPOS firmware specification 2010, 12.2."""

SUPERVISION = Path(__file__).parents[2] / "artemis" / "supervision"
TABLES = sorted((SUPERVISION / "catalogue").glob("*.py"))
MEASURES = [
    SUPERVISION / name for name in ("measures.py", "wheels.py", "steered.py", "scanners.py", "poses.py", "supply.py")
]
PROGRAM = [path for path in SUPERVISION.parent.rglob("*.py") if path not in TABLES]
ID = re.compile(r"[A-Z]{3}-\d{2}")
STOPS = Severity.CONTROLLED_STOP


def rows(*kinds: Found) -> pytest.MarkDecorator:
    """Every row that is found so, or every row at all."""
    chosen = {id: row for id, row in catalogue.ROWS.items() if row.found in (kinds or tuple(Found))}
    return pytest.mark.parametrize(("id", "row"), chosen.items(), ids=list(chosen))


def written_rows() -> list[str]:
    """Keys of the tables as they stand in the source, where a dict would hide one that is there twice."""
    keys = [
        key.value
        for path in TABLES
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Dict)
        for key in node.keys
        if isinstance(key, ast.Constant) and isinstance(key.value, str)
    ]
    return [key for key in keys if ID.fullmatch(key)]


def ids_in(paths: list[Path]) -> set[str]:
    """Every fault id that stands as a string in these files."""
    texts = (path.read_text(encoding="utf-8") for path in paths)
    return {
        node.value
        for text in texts
        if ID.search(text)  # only they are parsed
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and ID.fullmatch(node.value)
    }


@cache
def raised() -> set[str]:
    """Every fault id that the program can raise."""
    return ids_in(PROGRAM)


# ---------------------------------------------------------------------------------------------- ids and codes


def test_no_row_is_there_twice() -> None:
    assert sorted(written_rows()) == sorted(catalogue.ROWS)


def test_rows_of_a_group_are_numbered_without_gaps() -> None:
    groups: dict[str, list[int]] = {}
    for id in catalogue.ROWS:
        assert ID.fullmatch(id)
        groups.setdefault(id[:3], []).append(int(id[4:]))
    for numbers in groups.values():
        assert sorted(numbers) == list(range(1, len(numbers) + 1))


def test_every_error_code_of_the_first_generation_has_a_row() -> None:
    assert sorted(EPOS1.errors) == CODES


@pytest.mark.parametrize("family", FAMILIES.values(), ids=lambda family: family.name)
def test_codes_of_a_family_mean_rows_that_drives_report(family: Family) -> None:
    assert {catalogue.ROWS[id].found for id in family.errors.values()} == {Found.EMERGENCY}


@pytest.mark.parametrize(
    ("code", "first", "fourth"),
    [
        (0xFF01, "DRV-14", "DRV-28"),
        (0xFF02, "DRV-13", "DRV-39"),
        (0xFF0A, "DRV-12", "DRV-31"),
        (0x8611, "DRV-25", "DRV-25"),
    ],
)
def test_the_same_code_means_another_fault_in_another_generation(code: int, first: str, fourth: str) -> None:
    assert catalogue.emergency("left", code, EPOS1.errors).id == first
    assert catalogue.emergency("left", code, EPOS4.errors).id == fourth


def test_program_raises_only_faults_of_the_table() -> None:
    assert set(catalogue.ROWS) >= raised()


@rows(Found.MODE, Found.BRING_UP, Found.EDGE)
def test_what_is_noticed_in_the_program_is_raised_there(id: str, row: Row) -> None:
    assert row.reason or id in raised()


def test_what_is_measured_is_what_the_measures_yield() -> None:
    measured = {id for id, row in catalogue.ROWS.items() if row.found is Found.MEASURED}
    partly = {id for id, row in catalogue.ROWS.items() if row.found is Found.MODE and row.stages}
    assert ids_in(MEASURES) == measured | partly
    assert partly == {"PTH-06"}


# ---------------------------------------------------------------------------------------------- every row is complete


@rows()
def test_row_has_a_name_and_a_time(id: str, row: Row) -> None:
    assert row.name == row.name.strip() != ""
    assert 0.0 <= row.within < inf
    for words in (row.text, row.advice, row.reason):
        assert words == words.strip()
        assert not words.endswith(".")


@rows(*WATCHED)
def test_row_that_is_noticed_has_a_reaction_and_words(id: str, row: Row) -> None:
    assert row.severity > Severity.NONE
    assert row.text or row.reason


@rows(Found.EMERGENCY)
def test_error_of_a_drive_stops_all_and_leads_to_fault(id: str, row: Row) -> None:
    assert (row.severity, row.to_fault, row.stages) == (Severity.QUICK_STOP, True, ())
    assert row.text
    assert row.advice
    known = {row for family in FAMILIES.values() for row in family.errors.values()}
    assert id in known | {catalogue.UNKNOWN_CODE, catalogue.DAMAGED_EMERGENCY}
    assert 0.0 < row.within <= 0.02


@rows(Found.MEASURED)
def test_measured_row_has_limits_mildest_first(id: str, row: Row) -> None:
    assert row.text
    assert row.advice
    severities = [stage.severity for stage in row.stages]
    assert severities == sorted(severities)
    assert severities[-1] is row.severity
    for stage in row.stages:
        assert stage.over >= 0.0
        assert 0.0 <= stage.hold
    assert min(stage.hold for stage in row.stages) <= row.within
    assert row.within > 0.0, "it is noticed in a run"


@rows(Found.MODE)
def test_what_a_mode_finds_takes_time(id: str, row: Row) -> None:
    assert row.text
    assert row.within > 0.0


@rows(Found.BRING_UP, Found.EDGE)
def test_what_edge_and_bring_up_find_has_no_limits(id: str, row: Row) -> None:
    assert row.stages == ()


@rows(Found.LOADING)
def test_what_is_refused_is_refused_before_the_run(id: str, row: Row) -> None:
    assert row.within == 0.0
    assert row.severity is Severity.NONE
    assert (row.stages, row.shows_as, row.text) == ((), (), "")


@rows(Found.ELSEWHERE)
def test_row_that_shows_as_another_says_as_which_and_why(id: str, row: Row) -> None:
    assert row.reason
    assert row.shows_as
    assert (row.stages, row.text) == ((), "")


@rows()
def test_rows_as_which_a_row_may_be_seen_are_noticed(id: str, row: Row) -> None:
    for other in row.shows_as:
        assert catalogue.ROWS[other].found in WATCHED
        assert other != id


@rows(Found.DESIGN, Found.ABSENT)
def test_row_that_is_never_noticed_says_why(id: str, row: Row) -> None:
    assert row.reason
    assert (row.stages, row.text) == ((), "")


def test_words_are_true_of_every_family_that_reports_the_row() -> None:
    """Only an EPOS4 has `si_gains`; what is too low with 0x5113 is a supply of sensors, or of the logic."""
    told = {id: f"{row.text}: {row.advice}" for id, row in catalogue.ROWS.items()}
    families = {id: {family.name for family in FAMILIES.values() if id in family.errors.values()} for id in told}
    assert [id for id, words in told.items() if "si_gains" in words and families[id] != {"epos4"}] == []
    assert "logic" in told["DRV-05"]


def test_texts_are_different() -> None:
    texts = [row.text for row in catalogue.ROWS.values() if row.text]
    assert len(set(texts)) == len(texts)


# ---------------------------------------------------------------------------------------------- how it goes on


@rows()
def test_row_that_leads_to_fault_stops_the_robot(id: str, row: Row) -> None:
    if row.to_fault:
        assert row.severity >= STOPS


@rows(*WATCHED)
def test_row_after_which_a_bring_up_is_needed_leads_there(id: str, row: Row) -> None:
    if row.recovery.kind in (Kind.CALIBRATED, Kind.CONFIGURED) or row.recovery.reset:
        assert row.to_fault


@rows(*WATCHED)
def test_recovery_is_well_formed(id: str, row: Row) -> None:
    recovery = row.recovery
    assert recovery.reset in RESETS
    assert (recovery.kind is Kind.CONFIGURED) <= (recovery.reset == "node")
    assert recovery.window > 0.0
    assert recovery.final in (0, 2)
    if recovery.kind is Kind.AUTOMATIC:
        assert recovery.times >= 1
        assert recovery.settle > 0.0, "nothing flaps"
    else:
        assert (recovery.times, recovery.unless) == (0, ())
    if recovery.kind is Kind.ITSELF:
        assert recovery.settle > 0.0
    for other in recovery.unless:
        assert other in catalogue.ROWS
        assert other != id


@rows(*WATCHED)
def test_mild_rows_need_nobody(id: str, row: Row) -> None:
    if row.severity < STOPS:
        assert row.recovery.kind is Kind.ITSELF


def test_automatic_recovery_needs_the_cause_to_be_gone_for_half_a_second() -> None:
    recovery = automatic(2, 600.0, unless=("COM-11",))
    assert (recovery.kind, recovery.times, recovery.window) == (Kind.AUTOMATIC, 2, 600.0)
    assert (recovery.unless, recovery.settle, recovery.final, recovery.reset) == (("COM-11",), 0.5, 0, "")
    assert automatic(1).window == inf


def test_cause_of_what_goes_by_itself_must_be_gone_for_half_a_second() -> None:
    assert (ITSELF.kind, ITSELF.settle) == (Kind.ITSELF, 0.5), "nothing flickers"


def test_a_person_waits_for_the_cause_to_be_gone_and_no_longer() -> None:
    assert (K.settle, X.settle) == (0.0, 0.0)


def test_people_read_where_a_fault_is_noticed_and_how_it_is_forgotten() -> None:
    assert all(found.value for found in Found)
    assert all(kind.value for kind in Kind)


def test_reactions_have_the_short_names_of_the_specification() -> None:
    assert {severity.name: short for severity, short in SHORT.items()} == {
        "WARN": "W",
        "LIMIT": "L",
        "CONTROLLED_STOP": "S2",
        "QUICK_STOP": "S1",
        "OFF": "S0",
    }


# ---------------------------------------------------------------------------------------------- faults of rows


def test_fault_names_its_device_and_what_was_seen() -> None:
    fault = catalogue.fault("COM-11", "steer-left", "90 ms old")
    assert (fault.id, fault.device, fault.severity, fault.to_fault) == (
        "COM-11",
        "steer-left",
        Severity.QUICK_STOP,
        True,
    )
    assert not fault.final
    assert fault.text == "steer-left: feedback lost (90 ms old)"
    assert catalogue.fault("COM-22").text == "CAN adapter lost"
    assert catalogue.fault("COM-22", detail="unplugged").text == "CAN adapter lost (unplugged)"
    assert catalogue.fault("INP-03", "stick").text == "stick: input frozen: nothing new from it"


def test_row_without_words_for_the_operator_gives_its_name() -> None:
    assert catalogue.fault("SYS-04").text == catalogue.ROWS["SYS-04"].name


@pytest.mark.parametrize(
    ("severity", "to_fault"),
    [(Severity.WARN, False), (STOPS, False), (Severity.QUICK_STOP, True), (Severity.OFF, True)],
)
def test_milder_stage_of_a_row_does_not_lead_to_fault(severity: Severity, to_fault: bool) -> None:
    fault = catalogue.fault("STE-01", severity=severity)
    assert (fault.severity, fault.to_fault) == (severity, to_fault)


@rows(*WATCHED)
def test_fault_of_a_row_has_its_reaction(id: str, row: Row) -> None:
    fault = catalogue.fault(id)
    assert (fault.id, fault.severity, fault.to_fault, fault.device) == (id, row.severity, row.to_fault, "")


def test_unknown_id_is_a_bug_of_ours() -> None:
    with pytest.raises(KeyError, match="COM-99"):
        catalogue.fault("COM-99")


@pytest.mark.parametrize("code", CODES)
def test_known_code_is_its_row_and_the_code_is_shown(code: int) -> None:
    fault = catalogue.emergency("traction-left", code, EPOS1.errors)
    assert fault.id == EPOS1.errors[code]
    assert fault.device == "traction-left"
    assert f"0x{code:04X}" in fault.text


@pytest.mark.parametrize("code", [0x0000, 0x0001, 0x2320, 0x8250, 0xF001, 0xFFFF])
def test_unknown_code_is_a_fault_as_well(code: int) -> None:
    fault = catalogue.emergency("traction-left", code, EPOS1.errors)
    assert (fault.id, fault.severity, fault.to_fault) == ("DRV-31", Severity.QUICK_STOP, True)
    assert f"0x{code:04X}" in fault.text


def test_message_that_cannot_be_read_is_a_fault_as_well() -> None:
    fault = catalogue.emergency("traction-left", -1, EPOS1.errors)
    assert (fault.id, fault.severity, fault.to_fault) == ("DRV-32", Severity.QUICK_STOP, True)
    assert fault.text == "traction-left: damaged error message"


@pytest.mark.parametrize(
    ("detail", "shown"), [("js0: gone", "js0: gone"), ("js\udcff", r"js\udcff"), ("größer", "größer")]
)
def test_the_text_of_a_fault_can_be_written_whatever_was_seen(detail: str, shown: str) -> None:
    assert catalogue.fault("INP-01", "stick", detail).text == f"stick: input lost ({shown})"


def test_only_what_recovers_by_itself_has_a_number_of_recoveries() -> None:
    assert all((row.recovery.times > 0) is (row.recovery.kind is Kind.AUTOMATIC) for row in catalogue.ROWS.values())
