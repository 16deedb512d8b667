"""Sums have the same bits on every Python, and whatever decides uses no other ones."""

from __future__ import annotations

import ast
from pathlib import Path

import artemis
from artemis.motion.totals import mean, total

ARTEMIS = Path(artemis.__file__).parent
CORE, MODULES = ("motion", "supervision", "states", "plugins", "sim"), ("values.py", "progress.py", "robot.py")
"""Whatever a tick reaches, and the simulation beside it."""
WHILE_LOADING = {
    f"motion/{module}.py" for module in ("clocks", "rounding", "spline", "step_response", "comparison", "gain_tuning")
}
"""They make a path of points or judge recordings: their results are given to the core, or come after it."""


def test_values_are_added_from_left_to_right() -> None:
    assert total([1e16, 1.0, 1.0, -1e16]) == 0.0, "no compensation"
    assert total([1.0, 1.0, 1e16, -1e16]) == 2.0
    assert total(number * 0.1 for number in range(4)) == 0.1 + 0.2 + 0.30000000000000004
    assert total([]) == 0


def test_whole_numbers_stay_whole() -> None:
    assert isinstance(total([1, 2, 3]), int)


def test_mean_of_some() -> None:
    assert mean([1.0, 2.0, 6.0]) == 3.0


def test_the_core_leaves_no_sum_to_python_or_blas() -> None:
    """The built-in `sum` of floats compensates since Python 3.12; BLAS adds in an order of its own."""
    files = [file for part in CORE for file in (ARTEMIS / part).rglob("*.py")] + [
        ARTEMIS / module for module in MODULES
    ]
    assert len(files) > 100
    found = []
    for file in files:
        is_core = str(file.relative_to(ARTEMIS)) not in WHILE_LOADING
        for node in ast.walk(ast.parse(file.read_text())):
            match node:
                case ast.Name(id="sum"):
                    found.append(f"{file}:{node.lineno}: use `total`")
                case ast.BinOp(op=ast.MatMult()) | ast.Attribute(attr="dot" | "matmul" | "einsum" | "linalg") if (
                    is_core
                ):
                    found.append(f"{file}:{node.lineno}: multiply and add in plain Python")
    assert not found
