"""Runs a module's tests against each of its mutants, every one in a process of its own."""

from __future__ import annotations

import ast
import gc
import importlib
import importlib.abc
import importlib.util
import multiprocessing
import os
import resource
import signal
import sys
from collections.abc import Iterable, Iterator, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from importlib.machinery import ModuleSpec
from math import ceil
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkProcess
from pathlib import Path
from types import ModuleType

import hypothesis
import pytest

from .mutants import Mutant, mutants

ROOT = Path(__file__).parents[2]
PATIENCE, GRACE = 3.0, 1.0
"""Times that a mutant may take of what the module itself takes, and seconds more; of the processor."""
STUCK = 600
"""Seconds of the wall after which a test is given up that only waits."""
MEMORY = 4 << 30
"""Bytes that a mutant may take."""
RECENT = 5
"""Tests that failed last are tried first: the next mutant is often one of the same line."""
_STILLBORN = 97


class Outcome(Enum):
    """What became of a mutant."""

    KILLED = "killed"
    TIMED_OUT = "timed out"
    SURVIVED = "survived"
    STILLBORN = "stillborn"
    """It cannot be imported: proves nothing about the tests, and counts nowhere."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """A module, and the tests that have to notice every change of it."""

    name: str
    """As it is imported."""
    path: Path
    tests: Sequence[Path]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Trial:
    """The tests on one source of the subject."""

    source: str
    changed: Set[str]
    """Modules that have to be imported anew."""
    report: Connection
    limit: int = resource.RLIM_INFINITY
    """Seconds of the processor."""
    recent: tuple[str, ...] | None = None
    """Tests to try first; None: the source is no mutant, and what its tests load is reported."""


def examine(subject: Subject, workers: int) -> Iterator[tuple[Mutant, Outcome]]:
    """Each mutant with its outcome, in the order in which they become known.

    Raises:
        RuntimeError: the tests fail without a mutant, or cannot be run.
    """
    source = subject.path.read_text(encoding="utf-8")
    begun, (mine, its) = _processor_time(), multiprocessing.Pipe()
    _must_pass(subject, _Trial(source=source, changed=changed_by(subject), report=its))
    limit = ceil(GRACE + PATIENCE * (_processor_time() - begun))
    _load(mine.recv())
    waiting = mutants(source, vars(_imported(subject)))
    changed = changed_by(subject)
    _must_pass(subject, _Trial(source=source, changed=changed, report=its, limit=limit, recent=()))
    gc.freeze()  # or every process would look for garbage in all that is loaded here
    running: dict[ForkProcess, Mutant] = {}
    recent: list[str] = []
    while waiting or running:
        while waiting and len(running) < workers:
            mutant = waiting.pop(0)
            trial = _Trial(source=mutant.source(), changed=changed, report=its, limit=limit, recent=tuple(recent))
            running[_begin(subject, trial)] = mutant
        wait([process.sentinel for process in running])
        for process in [process for process in running if not process.is_alive()]:
            yield running.pop(process), _outcome(process)
        while mine.poll():
            failed = mine.recv()
            recent = [failed, *(test for test in recent if test != failed)][:RECENT]


def _must_pass(subject: Subject, trial: _Trial) -> None:
    if _outcome(_begin(subject, trial)) is not Outcome.SURVIVED:
        raise RuntimeError(f"fails without a mutant, run it by hand: {' '.join(map(str, subject.tests))}")


def tested(tests: Sequence[Path], plugin: object) -> int:
    """Exit status of these tests, in this process; property tests always try the same."""
    hypothesis.settings.register_profile(
        "same",
        database=None,
        deadline=None,
        derandomize=True,
        phases=(hypothesis.Phase.explicit, hypothesis.Phase.generate),
        suppress_health_check=list(hypothesis.HealthCheck),  # they ask the clock
    )
    where = ["-c", str(ROOT / "pyproject.toml"), "--rootdir", str(ROOT), "-p", "no:cacheprovider"]
    which = ["-m", "not exhaustive", "--hypothesis-profile=same"]
    how = ["-q", "-x", "-n", "0", "--assert=plain", f"--timeout={STUCK}"]
    return pytest.main([*where, *which, *how, *map(str, tests)], [plugin])


def _processor_time() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _load(modules: Sequence[str]) -> None:
    """Import what the tests need of others once, for all mutants."""
    for name in modules:
        with suppress(ImportError):
            importlib.import_module(name)


def _loaded(subject: Subject) -> list[str]:
    """Names of the imported modules that are installed, or ours and the same whatever the subject is."""
    changed = changed_by(subject)
    modules = [(name, getattr(module, "__file__", None) or "") for name, module in list(sys.modules.items())]
    return [name for name, file in modules if "site-packages" in file or (_is_ours(name) and name not in changed)]


def changed_by(subject: Subject) -> set[str]:
    """Names of the imported modules of ours that import the subject, at first, second or any hand; and its own."""
    uses = {name: _imports(module) for name, module in list(sys.modules.items()) if _is_ours(name)}
    changed = {subject.name}
    while more := {name for name, used in uses.items() if used & changed} - changed:
        changed |= more
    return changed


def _is_ours(name: str) -> bool:
    return name.partition(".")[0] in ("artemis", "artemis_lab")


def _imports(module: ModuleType) -> set[str]:
    """What a module may import: every module that it names, and the packages around these."""
    assert module.__spec__ is not None
    tree = ast.parse(Path(module.__spec__.origin or os.devnull).read_text(encoding="utf-8"))
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return {".".join(parts[:end]) for parts in (name.split(".") for name in names) for end in range(1, len(parts) + 1)}


def _imported(subject: Subject) -> ModuleType:
    """The module as it is."""
    if package := subject.name.rpartition(".")[0]:
        importlib.import_module(package)  # or a module that its package imports would import itself
    spec = importlib.util.spec_from_file_location(subject.name, subject.path)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[subject.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _begin(subject: Subject, trial: _Trial) -> ForkProcess:
    process = multiprocessing.get_context("fork").Process(target=_test, args=(subject, trial), daemon=True)
    process.start()
    return process


def _outcome(process: ForkProcess) -> Outcome:
    process.join()
    match process.exitcode:
        case pytest.ExitCode.OK:
            return Outcome.SURVIVED
        case pytest.ExitCode.NO_TESTS_COLLECTED | pytest.ExitCode.USAGE_ERROR:
            raise RuntimeError("pytest found no tests")
        case code if code == _STILLBORN:
            return Outcome.STILLBORN
        case code if code == -signal.SIGXCPU:
            return Outcome.TIMED_OUT
    return Outcome.KILLED


# ---------------------------------------------------------------------------------------------- in the new process


class _Planted(importlib.abc.MetaPathFinder, importlib.abc.InspectLoader):
    """Whoever imports the module gets this source of it."""

    def __init__(self, subject: Subject, source: str) -> None:
        self._subject = subject
        self._source = source

    def find_spec(self, fullname: str, *_: object) -> ModuleSpec | None:
        if fullname != self._subject.name:
            return None
        path = self._subject.path
        folders = [str(path.parent)] if path.name == "__init__.py" else None
        spec = ModuleSpec(fullname, self, origin=str(path), is_package=folders is not None)
        spec.submodule_search_locations = folders
        return spec

    def get_source(self, _: str) -> str:
        return self._source


@dataclass(frozen=True, slots=True)
class _Chosen:
    """Runs only some tests, in this order (None: all), and reports which one failed."""

    names: tuple[str, ...] | None
    report: Connection

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        if self.names is not None:
            found = {_name(item): item for item in items}
            items[:] = [found[name] for name in self.names if name in found]

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.report.send(_name(report))


def _name(test: pytest.Item | pytest.TestReport) -> str:
    file, _, name = test.location
    return f"{file}::{name}"


def _test(subject: Subject, trial: _Trial) -> None:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (trial.limit, resource.RLIM_INFINITY))
    _forget(trial.changed)
    sys.meta_path.insert(0, _Planted(subject, trial.source))
    try:
        importlib.import_module(subject.name)
    except Exception:  # noqa: BLE001  # a mutant may raise anything
        os._exit(_STILLBORN)
    status = 0
    if first := [test for test in subject.tests if any(f"{test.name}::" in name for name in trial.recent or ())]:
        status = tested(first, _Chosen(trial.recent, trial.report))
        status = 0 if status == pytest.ExitCode.NO_TESTS_COLLECTED else status
    for test in subject.tests:  # most mutants do not get beyond the first: what is not needed is not collected
        status = status or tested([test], _Chosen(None, trial.report))
    if trial.recent is None:
        trial.report.send(_loaded(subject))
    os._exit(status)


def _forget(modules: Iterable[str]) -> None:
    """Whoever imports one of these gets a new one."""
    for name in modules:
        package, _, leaf = name.rpartition(".")
        sys.modules.pop(name, None)
        if package in sys.modules:
            vars(sys.modules[package]).pop(leaf, None)
