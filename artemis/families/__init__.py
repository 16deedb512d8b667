"""Drive families, as data: one module of tables each, below the robot file and everything that drives."""

from __future__ import annotations

from artemis.families.epos1 import EPOS1
from artemis.families.epos2 import EPOS2
from artemis.families.epos4 import EPOS4
from artemis.families.family import Family

__all__ = ["EPOS1", "EPOS2", "EPOS4", "FAMILIES", "GENERATIONS", "Family"]

FAMILIES: dict[str, Family] = {family.name: family for family in (EPOS1, EPOS2, EPOS4)}
"""Those that are whole by themselves, by their names in robot files."""
GENERATIONS = {family.generation: family for family in FAMILIES.values() if family.generation is not None}
"""By the second-last hexadecimal digit of a maxon hardware version."""
