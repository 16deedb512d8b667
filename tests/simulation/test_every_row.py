"""The fault table, row by row: each is made to happen, or another test covers it, or it is not built."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from every_row import scenes
from scenes_by_design import BY_DESIGN
from scenes_of_drives import DRIVE_SCENES, UNHEARD
from scenes_of_localizers import LOCALIZER_SCENES
from scenes_of_motion import MOTION_SCENES
from scenes_of_scanners import SCANNER_SCENES
from scenes_of_the_bus import BUS_SCENES
from scenes_of_the_host import HOST_SCENES

from artemis.supervision.catalogue import ROWS
from artemis.supervision.catalogue.row import Found
from artemis.values import Severity
from artemis_lab.injections.emergencies import CODES
from artemis_lab.injections.table import INJECTIONS, NOT_INJECTED

TESTS = Path(__file__).parents[1]
SCENES = {**DRIVE_SCENES, **BUS_SCENES, **MOTION_SCENES, **HOST_SCENES, **SCANNER_SCENES, **LOCALIZER_SCENES}
COVERED = {
    "LAS-08": "simulation/test_obstacle_missions.py::"
    "test_waits_for_what_stands_in_its_way_and_drives_on_once_it_is_gone",
    "CAL-03": "unit/test_homing.py::test_a_home_switch_that_never_changes_is_told",
    "RUN-08": "simulation/test_lost_place.py::test_a_path_is_not_gone_on_with_from_an_unknown_place",
    "INP-02": "unit/test_gamepad.py::test_unplugged_device_is_lost_in_the_next_tick_and_returns_disabled",
    "INP-14": "unit/test_input_chain.py::test_brake_wins_over_the_gas",
    "INP-15": "unit/test_gamepad.py::test_pedal_that_never_moves_stops_the_robot",
    "INP-16": "unit/test_plugin_guard.py::test_an_input_that_fails_to_show_is_a_warning_once",
    "NET-01": "simulation/test_network_operator.py::test_a_cut_link_stops_the_robot",
    "NET-02": "simulation/test_network_operator.py::test_latency_stops_the_robot",
    "NET-03": "simulation/test_network_operator.py::test_a_poor_link_drives_slowly",
    "NET-04": "unit/test_operator_link.py::test_a_burst_after_a_stall_has_no_effect",
    "NET-05": "simulation/test_network_operator.py::test_a_poor_link_drives_slowly",
    "NET-06": "simulation/test_network_operator.py::test_replayed_commands_stop_the_robot_until_they_are_acknowledged",
    "NET-07": "unit/test_operator_link.py::test_a_wrong_key_takes_no_seat_and_disturbs_nobody",
    "NET-08": "unit/test_operator_link.py::test_a_second_operator_is_refused_by_name_until_the_first_releases",
    "NET-09": "unit/test_operator_link.py::test_rubbish_before_the_claim_closes_the_connection",
    "NET-10": "unit/test_operator_link.py::test_a_flood_is_dropped_and_the_rest_drives",
    "NET-12": "unit/test_ros1.py::test_a_master_that_is_not_there_is_told_once_and_met_when_it_comes",
    "NET-13": "unit/test_own_process.py::test_one_that_is_killed_is_back_and_says_so",
    "INP-13": "simulation/test_plugins_misbehave.py"
    "::test_a_stick_that_is_held_when_teleoperation_begins_moves_nothing_until_it_is_released",
    "LOC-07": "unit/test_scan_map.py::test_a_pose_that_does_not_fit_is_refused_and_the_robot_is_followed_as_before",
    "NET-14": "unit/test_ros1_input.py::test_goals_and_initial_poses_are_passed_on_once_where_they_are_allowed",
    "NET-15": "simulation/test_network_operator.py::test_a_poor_link_drives_slowly",
    "LOC-06": "unit/test_localizers.py::test_a_localizer_that_does_not_keep_up_is_a_warning",
    "PTH-01": "unit/test_path.py::test_what_is_no_path_is_refused",
    "PTH-02": "unit/test_path.py::test_every_problem_is_reported_with_its_place",
    "PTH-03": "unit/test_path.py::test_too_sharp_a_curve_is_named_with_its_place",
    "PTH-04": "unit/test_path.py::test_gap_over_an_unreadable_point_is_not_blamed_on_the_next",
    "PTH-05": "simulation/test_plugins_misbehave.py::test_a_path_that_begins_too_far_away_is_not_begun",
    "PTH-10": "unit/test_mode_goto.py::test_a_planner_that_died_is_a_fault_and_never_an_outcome",
    "PTH-11": "simulation/test_goto_missions.py::test_zones_that_are_gone_stop_the_robot_until_they_are_back",
    "MIS-01": "broken/test_broken_files.py::test_a_missing_mission_is_refused",
    "MIS-02": "broken/test_broken_files.py::test_a_broken_file_is_refused_as_its_first_lines_say",
    "MIS-03": "unit/test_mission.py::test_every_misspelt_key_is_named_with_the_right_one",
    "MIS-04": "broken/test_broken_files.py::test_an_edit_that_breaks_a_good_file_is_refused_in_full",
    "MIS-05": "unit/test_policy.py::test_reaction_may_be_more_severe_and_is_never_milder",
    "MIS-06": "broken/test_broken_files.py::test_a_link_out_of_the_folder_is_refused",
    "MIS-07": "unit/test_mission.py::test_the_fastest_step_must_stop_within_the_stop_distance",
    "PLG-01": "unit/test_registry.py::test_broken_plugin_tells_its_reason_and_harms_nobody",
    "PLG-05": "unit/test_host.py::test_growth_beyond_its_limit_is_told",
    "PLG-07": "unit/test_bus_gateway.py::test_what_must_not_leave_is_held_back_and_told_with_its_place_in_the_program",
    "LAS-09": "unit/test_scanning.py::test_one_that_does_not_what_it_shall_is_another_row",
    "NET-11": "unit/test_page_sessions.py::test_a_stop_on_a_page_that_was_not_told_of_the_robot_is_said",
    "SYS-06": "host_death/test_host_death.py::test_every_drive_stops_in_time_when_the_host_dies",
    "SYS-08": "unit/test_journal.py::test_of_a_killed_run_nothing_is_lost",
    "DSK-01": "simulation/test_failing_disk.py"
    "::test_a_run_that_nobody_watches_is_refused_on_a_disk_that_is_nearly_full",
    "DSK-03": "unit/test_recording_disk.py::test_a_slow_disk_is_told_while_ticks_are_dropped",
    "DSK-04": "unit/test_journal.py::test_a_cut_at_any_byte_leaves_every_whole_line",
    "SER-01": "unit/test_serial_line.py::test_bytes_out_of_step_are_thrown_away_and_the_command_repeated",
    "SER-02": "unit/test_serial_line.py::test_a_damaged_answer_is_not_believed",
    "SER-03": "unit/test_serial_line.py::test_a_drive_that_does_not_answer_is_asked_three_times",
    "SER-04": "unit/test_serial_line.py::test_an_answer_that_breaks_off_is_asked_for_again",
    "SER-05": "unit/test_serial_line.py::test_a_port_that_is_unplugged_ends_all_commands_at_once",
    "OPR-03": "unit/test_mode_fault.py::test_run_ends_when_nobody_acknowledges_for_ten_minutes",
    **dict.fromkeys(
        sorted(CODES["epos4"].keys() - CODES["epos1"].keys()),  # in the same order in each process of the tests
        "simulation/test_every_row_families.py::test_error_is_noticed_in_time_and_stops_the_robot",
    ),
}
"""Rows that another test makes happen."""
ABSENT = {id for id, row in ROWS.items() if row.found is Found.ABSENT} - SCENES.keys() - BY_DESIGN.keys()
"""Rows that are not built, and cannot be made to happen."""


def test_every_row_is_made_to_happen_or_covered_elsewhere_or_not_built() -> None:
    tables = (SCENES.keys(), BY_DESIGN.keys(), COVERED.keys(), ABSENT)
    assert sorted(id for table in tables for id in table) == sorted(ROWS)


def test_every_injection_is_played() -> None:
    of_epos4 = CODES["epos4"].keys() - CODES["epos1"].keys()
    others = {"PLG-05", *of_epos4}  # the first needs a process that lives for long
    assert INJECTIONS.keys() - SCENES.keys() - BY_DESIGN.keys() == others
    assert ABSENT <= NOT_INJECTED.keys()


def test_numbers_of_rows() -> None:
    assert (len(ROWS), len(SCENES), len(BY_DESIGN), len(COVERED), len(ABSENT)) == (201, 113, 18, 67, 3)


@pytest.mark.parametrize("id", COVERED)
def test_what_covers_a_row_exists(id: str) -> None:
    file, name = COVERED[id].split("::")
    tree = ast.parse((TESTS / file).read_text(encoding="utf-8"))
    assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_every_reaction_of_a_row_is_seen() -> None:
    """A row with a milder stage has a scene for it, and one for its own reaction."""
    for id, some in SCENES.items():
        stages = {stage.severity for stage in ROWS[id].stages} if id != "COM-31" else set()
        milder = {severity for severity in stages if severity < ROWS[id].severity}
        played = {scene.severity or ROWS[id].severity for _, scene in scenes({id: some})}
        assert milder | {ROWS[id].severity} <= played, id
    assert Severity.OFF not in {row.severity for row in ROWS.values()}
    assert set(UNHEARD) == {"COM-01"}
