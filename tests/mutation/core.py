"""The safety core, and the tests that hold it: all of it is covered, and every change of it fails one of them."""

from __future__ import annotations

from collections.abc import Mapping

_ROWS = ("unit/test_supervisor_rows.py",)
_TABLE = ("unit/test_faults_page.py", "unit/test_catalogue.py", *_ROWS)

CORE: Mapping[str, tuple[str, ...]] = {
    "motion/limits.py": ("unit/test_limits.py", "properties/test_limits_properties.py"),
    "states/machine.py": ("unit/test_machine.py", "properties/test_machine_properties.py"),
    "devices/epos_state.py": ("unit/test_epos_state.py", "properties/test_epos_state_properties.py"),
    "devices/canopen.py": ("unit/test_canopen.py", "properties/test_canopen_properties.py"),
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
    ),
    "supervision/steered.py": (
        "unit/test_wheels_steered.py",
        "unit/test_wheels_exactly.py",
        *_ROWS,
    ),
    "supervision/supervisor.py": (
        "unit/test_supervisor_times.py",
        "unit/test_supervisor.py",
        "unit/test_supervisor_budgets.py",
        "unit/test_supervisor_recovery.py",
        *_ROWS,
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
