"""The safety core, and the tests that hold it: all of it is covered, and every change of it fails one of them."""

from __future__ import annotations

from collections.abc import Mapping

_ROWS = ("unit/test_supervisor_rows.py",)
_MODES = ("unit/test_mode_details.py", "unit/test_mode_memory.py", "unit/test_mode_corners.py")
_HANDS = ("unit/test_hands.py", "unit/test_hand_over.py", "unit/test_mode_teleop.py")
_MISSION = ("unit/test_mission_advance.py", "unit/test_mode_questions.py", "unit/test_mission_condition.py")
_STOPS = ("unit/test_stop_details.py", "unit/test_modes_at_rest.py", "unit/test_mode_fault.py", *_MODES)
_TABLE = ("unit/test_faults_page.py", "unit/test_catalogue.py", "unit/test_axles.py", *_ROWS)
_BATTERY, _ROBOTS = "simulation/test_runs_on_battery.py", "simulation/test_other_robots.py"

CORE: Mapping[str, tuple[str, ...]] = {
    "motion/limits.py": ("unit/test_limits.py", "properties/test_limits_properties.py"),
    "states/machine.py": ("unit/test_machine.py", "properties/test_machine_properties.py"),
    "motion/sweep.py": ("unit/test_sweep.py",),
    "motion/obstacles.py": ("unit/test_core_obstacles.py", "unit/test_obstacles.py"),
    "states/blocked.py": ("unit/test_core_obstacles.py", "unit/test_mode_goto.py"),
    "states/goto.py": ("unit/test_mode_goto.py", "simulation/test_asked_goals.py"),
    "states/modes.py": (
        "unit/test_answering.py",
        "unit/test_modes.py",
        "unit/test_core.py",
        "unit/test_core_obstacles.py",
        "unit/test_hand_over.py",
        *_MODES,
    ),
    "states/mode.py": (*_STOPS, "unit/test_bring_up_details.py", "unit/test_modes.py", "unit/test_mode_init.py"),
    "states/plan.py": (
        "unit/test_mode_goto.py",
        "unit/test_modes.py",
        "unit/test_mode_timed.py",
        *_STOPS,
        "unit/test_core.py",
        "unit/test_core_obstacles.py",
        "unit/test_hand_over.py",
        "unit/test_mode_act.py",
        *_MISSION,
        _BATTERY,
    ),
    "states/advance.py": (*_MISSION, "unit/test_mode_act.py", "unit/test_mission_behaviours.py"),
    "states/condition.py": _MISSION,
    "states/distance_left.py": ("unit/test_distance_left.py",),
    "states/init.py": (
        "unit/test_bring_up_details.py",
        "unit/test_mode_init.py",
        *_MODES,
    ),
    "states/ready.py": (
        "unit/test_mode_recorded.py",
        "unit/test_mode_goto.py",
        "unit/test_modes.py",
        "unit/test_hand_over.py",
        "unit/test_mode_timed.py",
        "unit/test_mode_act.py",
        *_MISSION,
        *_MODES,
    ),
    "states/teleop.py": (*_HANDS, *_MISSION, "unit/test_modes.py", "unit/test_mode_timed.py", *_MODES),
    "states/priority.py": _HANDS,
    "states/hands.py": _HANDS,
    "states/keeping.py": ("unit/test_keeping.py",),
    "states/alignment.py": ("unit/test_alignment.py", "unit/test_bring_up_details.py"),
    "states/steering.py": ("unit/test_measuring_steering.py",),
    "states/parts.py": ("unit/test_parts.py", "properties/test_reversing_properties.py"),
    "states/requests.py": ("unit/test_requests.py",),
    "states/act.py": ("unit/test_mode_act.py", *_MISSION, "unit/test_mission_behaviours.py"),
    "states/follow.py": (
        "unit/test_mode_follow_exactly.py",
        "unit/test_mode_follow.py",
        "unit/test_mode_goto.py",
        "unit/test_mode_recorded.py",
    ),
    "states/homing.py": ("unit/test_homing.py",),
    "states/quickstop.py": _STOPS,
    "states/fault.py": _STOPS,
    "states/end.py": _STOPS,
    "robot.py": (
        "unit/test_core_details.py",
        "unit/test_core.py",
        "unit/test_core_obstacles.py",
        "unit/test_robot.py",
        _BATTERY,
    ),
    "devices/epos_state.py": ("unit/test_epos_state.py", "properties/test_epos_state_properties.py"),
    "devices/canopen.py": ("unit/test_canopen.py", "properties/test_canopen_properties.py"),
    "families/objects.py": (
        "unit/test_canopen.py",
        "properties/test_canopen_properties.py",
        "unit/test_family_tables.py",
    ),
    "supervision/measures.py": (
        "unit/test_measures.py",
        "unit/test_measures_host.py",
        *_ROWS,
        "unit/test_supervisor.py",
    ),
    "supervision/wheels.py": (
        "unit/test_wheels_exactly.py",
        "unit/test_wheels.py",
        "unit/test_wheels_braking.py",
        "unit/test_wheels_steered.py",
        *_ROWS,
        _ROBOTS,
    ),
    "supervision/steered.py": (
        "unit/test_wheels_steered.py",
        "unit/test_wheels_exactly.py",
        *_ROWS,
        _ROBOTS,
    ),
    "supervision/scanners.py": ("unit/test_supervisor_scanners.py", "unit/test_expected_returns.py"),
    "supervision/expected_returns.py": ("unit/test_expected_returns.py", "unit/test_supervisor_scanners.py"),
    "supervision/supervisor.py": (
        "unit/test_supervisor_times.py",
        "unit/test_supervisor.py",
        "unit/test_supervisor_budgets.py",
        "unit/test_supervisor_recovery.py",
        "unit/test_hand_over.py",
        "unit/test_supervisor_scanners.py",
        *_ROWS,
        _BATTERY,
    ),
    "supervision/policy.py": ("unit/test_policy.py", "unit/test_supervisor.py"),
    **{
        f"supervision/catalogue/{table}.py": _TABLE
        for table in (
            "__init__",
            "row",
            "drives",
            "communication",
            "motion",
            "inputs",
            "surroundings",
            "host",
        )
    },
}
"""Modules in `artemis/` -> tests in `tests/`, the quick ones first."""
