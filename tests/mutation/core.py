"""The safety core, and the tests that hold it: all of it is covered, and every change of it fails one of them."""

from __future__ import annotations

from collections.abc import Mapping

CORE: Mapping[str, tuple[str, ...]] = {
    "motion/limits.py": ("unit/test_limits.py", "properties/test_limits_properties.py"),
    "states/machine.py": ("unit/test_machine.py", "properties/test_machine_properties.py"),
    "devices/epos_state.py": ("unit/test_epos_state.py", "properties/test_epos_state_properties.py"),
    "devices/canopen.py": ("unit/test_canopen.py", "properties/test_canopen_properties.py"),
}
"""Modules in `artemis/` -> tests in `tests/`, the quick ones first."""
