"""The machinery itself: it finds weak tests, it kills, it does not wait for ever, and it keeps its list honest."""

from __future__ import annotations

import importlib
import subprocess
import sys
from dataclasses import replace
from enum import Enum
from pathlib import Path

import pytest

from . import __main__ as main
from .__main__ import Survivor
from .core import CORE
from .mutants import Mutant, mutants
from .running import Outcome, Subject, changed_by

ROOT = Path(__file__).parents[2]


def changes(source: str, **names: object) -> list[str]:
    return [mutant.change for mutant in mutants(source, names)]


# ---------------------------------------------------------------------------------------------- the changes


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("a < b", ["a <= b", "a >= b"]),
        ("a is not b", ["a is b"]),
        ("a + b", ["a - b"]),
        ("a << b", ["a >> b"]),
        ("a and b", ["a or b", "b", "a"]),
        ("not a", ["a"]),
        ("f(1)", ["f(2)", "f(0)"]),
        ("f(0.5)", ["f(0.55)", "f(0.45)"]),
        ("f(True, 'x', b'')", ["f(False, 'x', b'')", "f(True, '', b'')", "f(True, 'x', b'?')"]),
        ("min(a, b)", ["max(a, b)"]),
        ("abs(a)", ["a"]),
        ("f(a=b)", ["f()"]),
        ("{a: b, c: d}", ["{c: d}", "{a: d, c: d}", "{a: b}", "{a: b, c: b}"]),
        ("(a, b)", ["(b,)", "(a,)"]),
        ("a[b:]", ["a[:]"]),
        ("a if b else c", ["a if not b else c"]),
        ("[a for a in b if c]", ["[a for a in b]"]),
    ],
)
def test_an_expression_is_changed(source: str, expected: list[str]) -> None:
    assert changes(source) == [f"`{source}` -> `{after}`" for after in expected]


def test_statements_of_functions_are_left_out_and_values_not_returned() -> None:
    source = "def f(a):\n    '''Say.'''\n    if a:\n        return b\n    g()\n    return b"
    assert changes(source) == [
        "`if a:` -> `if not a:`",
        "`return b` -> `return None`",
        "`return b` -> `pass`",
        "`g()` -> `pass`",
        "`return b` -> `return None` (2)",
    ]


def test_cases_are_left_out() -> None:
    assert changes("match a:\n    case f():\n        b") == ["`case f():` -> `case f() if False:`"]


def test_members_of_enums_are_exchanged() -> None:
    colour = Enum("colour", ["RED", "GREEN"])
    assert changes("Colour.GREEN", Colour=colour) == ["`Colour.GREEN` -> `Colour.RED`"]


def test_what_tells_nothing_of_behaviour_is_left_alone() -> None:
    source = '"""Words."""\nfrom a import b\n@d(1)\nclass C(b[1]):\n    x: Literal[1]\n    """More."""\nf"words {x:04}"'
    assert changes(source) == []


def test_names_of_types_are_left_alone() -> None:
    assert changes("Names = Mapping[str, int]", Names=dict[str, int]) == []
    assert changes("x: TypeAlias = int | str") == []


def test_a_place_is_named_by_function_class_and_table() -> None:
    source = "class A:\n    x = 1\n    def f(self): return 2\nT = {k: {l: 3}}"
    assert list(dict.fromkeys(m.where for m in mutants(source, {}))) == ["A.x", "A.f", "T", "T[k]", "T[k][l]"]


def test_every_mutant_of_the_project_is_python_and_differs() -> None:
    source = (ROOT / "artemis/motion/limits.py").read_text()
    found: list[Mutant] = mutants(source, {})
    assert len(found) > 100
    assert len({(mutant.where, mutant.change) for mutant in found}) == len(found)
    for mutant in found:
        compile(mutant.source(), mutant.change, "exec")


# ---------------------------------------------------------------------------------------------- the run

MODULE = """
LIMIT = 10

def shorten(value):
    while value > LIMIT:
        value -= 1
    return value
"""
WEAK = "from planted import shorten\n\ndef test_it():\n    assert shorten(12) == 10\n"
RUN = """
import sys
from pathlib import Path
from tests.mutation.running import Subject, examine

folder = Path(sys.argv[1])
subject = Subject(name="planted", path=folder / "planted.py", tests=[folder / "test_planted.py"])
for mutant, outcome in examine(subject, workers=2):
    print(outcome.value, mutant.where, mutant.change, sep=": ")
"""


def examined(folder: Path, tests: str) -> subprocess.CompletedProcess[str]:
    (folder / "planted.py").write_text(MODULE)
    (folder / "test_planted.py").write_text(tests)
    command = [sys.executable, "-c", RUN, str(folder)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.exhaustive
def test_a_weak_test_is_found_and_mutants_that_never_end_are_stopped(tmp_path: Path) -> None:
    assert sorted(examined(tmp_path, WEAK).stdout.splitlines()) == [
        "killed: LIMIT: `LIMIT = 10` -> `LIMIT = 11`",
        "killed: LIMIT: `LIMIT = 10` -> `LIMIT = 9`",
        "killed: shorten: `return value` -> `return None`",
        "killed: shorten: `value > LIMIT` -> `value <= LIMIT`",
        "killed: shorten: `value > LIMIT` -> `value >= LIMIT`",
        "survived: shorten: `value -= 1` -> `value -= 2`",
        "timed out: shorten: `value -= 1` -> `pass`",
        "timed out: shorten: `value -= 1` -> `value += 1`",
        "timed out: shorten: `value -= 1` -> `value -= 0`",
    ]


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("tests", "problem"),
    [("def test_it():\n    assert False\n", "fails without a mutant"), ("nothing = 1\n", "pytest found no tests")],
)
def test_tests_that_prove_nothing_are_refused(tmp_path: Path, tests: str, problem: str) -> None:
    run = examined(tmp_path, tests)
    assert run.returncode == 1
    assert problem in run.stderr


@pytest.mark.exhaustive
def test_what_imports_a_mutant_is_imported_anew_and_what_it_imports_is_not() -> None:
    importlib.import_module("artemis.robot")
    changed = changed_by(main.subjects()["motion/limits.py"])
    assert {"artemis.motion.limits", "artemis.robot"} <= changed
    assert not {"artemis.values", "artemis.motion.ackermann"} & changed


@pytest.mark.exhaustive
def test_a_package_changes_with_its_modules_and_all_modules_with_their_package() -> None:
    row = changed_by(main.subjects()["supervision/catalogue/row.py"])
    drives = changed_by(main.subjects()["supervision/catalogue/drives.py"])
    assert {"artemis.supervision.catalogue", "artemis.supervision.catalogue.drives"} <= row & drives


# ---------------------------------------------------------------------------------------------- the judgement

SUBJECTS = {"planted.py": Subject(name="planted", path=Path(), tests=[])}
SURVIVOR = Mutant(line=7, where="f", change="`a` -> `b`", source=str)
LISTED = Survivor(module="planted.py", where="f", change="`a` -> `b`", reason="the same")


def judged(monkeypatch: pytest.MonkeyPatch, survivors: int, known: list[Survivor]) -> int:
    found = [(SURVIVOR, Outcome.SURVIVED)] * survivors + [(SURVIVOR, Outcome.KILLED)] * (100 - survivors)
    monkeypatch.setattr(main, "examine", lambda subject, workers: iter(found))
    return main.judge(SUBJECTS, known, workers=1)


def test_survivors_with_reasons_are_right(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    elsewhere = replace(LISTED, module="other.py")  # not examined, so nothing is said of it
    assert judged(monkeypatch, 2, [LISTED, elsewhere]) == 0
    text = capsys.readouterr().out
    assert "known:    planted.py:7: f: `a` -> `b`: the same" in text
    assert text.endswith("every survivor is known\n")


@pytest.mark.parametrize(
    ("survivors", "known", "problem"),
    [
        (1, [], "1 survivors are not in the list"),
        (0, [LISTED], "gone, take it out of the list: planted.py, f: `a` -> `b`"),
        (3, [LISTED], "3 of 100 survived"),
    ],
)
def test_survivors_that_are_new_or_gone_or_too_many_are_wrong(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    survivors: int,
    known: list[Survivor],
    problem: str,
) -> None:
    assert judged(monkeypatch, survivors, known) == 1
    assert problem in capsys.readouterr().out


def test_every_entry_of_the_list_is_of_the_core_and_has_a_reason() -> None:
    known = main.listed(main.SURVIVORS)
    assert all(entry.module in CORE and entry.reason for entry in known)
    assert len({(entry.module, entry.where, entry.change) for entry in known}) == len(known)


@pytest.mark.exhaustive
def test_every_listed_survivor_is_still_a_mutant() -> None:
    for module, subject in main.subjects().items():
        there = {(mutant.where, mutant.change) for mutant in mutants(subject.path.read_text(), names_of(subject.name))}
        listed = {(entry.where, entry.change) for entry in main.listed(main.SURVIVORS) if entry.module == module}
        assert listed <= there, module


def names_of(module: str) -> dict[str, object]:
    return vars(importlib.import_module(module))
