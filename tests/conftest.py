"""For all tests: which of them `make test` leaves to others, their order, and how Hypothesis tries.

Anything may run on any worker of pytest-xdist, beside anything else.
"""

from __future__ import annotations

import atexit
import gc
import os
import shutil
import signal
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Generator, Iterator
from contextlib import ExitStack
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: beside other workers its threads wait for each other

import pytest
from hypothesis import settings

STATE = os.environ["XDG_STATE_HOME"] = tempfile.mkdtemp(prefix="artemis-state-")  # no test notes where people record
atexit.register(shutil.rmtree, STATE, ignore_errors=True)

for _shared in ("simulation", "e2e"):  # what tests of other folders take from there: the rig of whole runs, the command
    sys.path.append(str(Path(__file__).parent / _shared))

PROGRAMS = ("browser", "e2e", "peers")
"""Folders of tests that drive other programs, or artemis as a program."""
SKIPPED = "artemis/skipped"
"""Where pytest's cache has the tests, or their files, that the last complete run skipped."""
LATE = "artemis/late"
"""Where it has those in real time that failed beside others, and that no run since the last complete one has passed."""
WHOLE = "artemis/whole"
"""Where it has the files without tests that only `make test-ci` runs, each with the time of its last change."""
TOO_BUSY = "too busy for real time"
REPEATED = pytest.StashKey[bool]()
"""The test failed so, and is repeated alone."""
FETCHED = ("built by scripts/serial_peers", "libLMS1xx: built by scripts/scanner_peers")
SKIPPED_IN_CI = ("/dev/u", "vcan0", TOO_BUSY, "ARTEMIS_SLAM_DATA", "root reads", *FETCHED)
"""Parts of the reasons for which the continuous integration may skip a test: hardware, the load, data that may
not be copied, and programs whose sources are fetched from their authors."""

settings.register_profile("few", settings.default, deadline=None, max_examples=5)
settings.register_profile("short", settings.default, deadline=None, max_examples=40)
settings.register_profile("exhaustive", settings.default, deadline=None, max_examples=200)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Tests stay until the end: who looks for garbage among thousands of them again and again does little else."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(20_000, 10, 10)  # a run's ticks stay until it has been judged: looked at again and again, too
        gc.enable()


def pytest_addoption(parser: pytest.Parser) -> None:
    """After `make test` in an environment without the extras, `--left` is the rest with them; `--late` comes last."""
    parser.addoption("--left", action="store_true", help="only what `make test` leaves out, and what it skipped")
    parser.addoption(
        "--late", action="store_true", help="only what failed in real time beside other tests: it has to pass, alone"
    )


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """`--left` and `--late` import only files with tests for them, as far as known from the run before."""
    if collection_path.is_dir():
        return None
    name = os.path.relpath(collection_path, config.rootpath)
    if config.getoption("late"):
        return True if name not in _files(_kept(config, LATE)) else None
    whole = _whole(config).get(name) == collection_path.stat().st_mtime_ns
    return True if config.getoption("left") and whole and name not in _files(_kept(config, SKIPPED)) else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """What runs in real time comes first: one after the other on one worker, while the others do the rest.

    Then what takes so long that it has a time limit of its own: begun at the end, it would leave processors idle.
    """
    items.sort(key=lambda item: [item.get_closest_marker(mark) is None for mark in ("realtime", "timeout")])
    counts: Counter[str] = Counter()
    for item in items:
        if item.path.parent.name in PROGRAMS:
            item.add_marker(pytest.mark.programs)
        if sampled := item.get_closest_marker("sampled"):
            name = item.nodeid.partition("[")[0]
            if counts[name] % sampled.args[0]:
                item.add_marker(pytest.mark.exhaustive)
            counts[name] += 1
    if not (config.getoption("left") or config.getoption("late")):
        _note_whole(config, items)
    if config.getoption("late"):
        late = _kept(config, LATE)
        items[:] = [item for item in items if item.nodeid in late]
    elif config.getoption("left"):
        skipped = _kept(config, SKIPPED)
        items[:] = [item for item in items if {item.nodeid, item.nodeid.partition("::")[0]} & skipped or _is_left(item)]


def _is_left(item: pytest.Item) -> bool:
    return any(item.get_closest_marker(mark) for mark in ("slow", "exhaustive"))


def _is_for_ci(item: pytest.Item) -> bool:
    """`make test-ci` runs it, and `make test` does not."""
    if item.get_closest_marker("exhaustive"):
        return item.get_closest_marker("programs") is not None
    return item.get_closest_marker("slow") is not None


def _note_whole(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep which of the files of these tests have none that only `make test-ci` runs; one worker does."""
    cache = _cache(config)
    if cache is None or getattr(config, "workerinput", {"workerid": "gw0"})["workerid"] != "gw0":
        return
    paths = {item.path for item in items}
    left = {item.path for item in items if _is_for_ci(item)}
    known = {os.path.relpath(path, config.rootpath): path.stat().st_mtime_ns for path in paths}
    whole = {name: time for name, time in _whole(config).items() if name not in known}
    for path in paths - left:
        name = os.path.relpath(path, config.rootpath)
        whole[name] = known[name]
    cache.set(WHOLE, whole)


@pytest.hookimpl(tryfirst=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Remember what a run of all tests skipped; in the continuous integration only some may be skipped."""
    terminal = session.config.pluginmanager.get_plugin("terminalreporter")
    if terminal is None or hasattr(session.config, "workerinput"):
        return
    config = session.config
    skipped: list[pytest.TestReport] = terminal.stats.get("skipped", [])
    whole = config.args_source is pytest.Config.ArgsSource.TESTPATHS and not config.option.keyword
    complete = whole and not config.getoption("left") and not config.getoption("late")
    late = set() if complete else _kept(config, LATE)
    late -= {report.nodeid for report in terminal.stats.get("passed", [])}
    late |= {report.nodeid for report in skipped if TOO_BUSY in str(report.longrepr)}  # also at its end
    late |= _kept(config, LATE) & {report.nodeid for report in terminal.stats.get("error", [])}
    if cache := _cache(config):
        cache.set(LATE, sorted(late))
        if complete:
            cache.set(SKIPPED, sorted({report.nodeid for report in skipped}))
    if config.getoption("late"):
        if late:
            terminal.section("still not passed", red=True)
            terminal.line("\n".join(sorted(late)))
        session.exitstatus = pytest.ExitCode.TESTS_FAILED if late else pytest.ExitCode.OK
    elif config.getoption("left") and os.environ.get("CI") == "true":
        reasons = [str(report.longrepr) for report in skipped]
        wrong = [reason for reason in reasons if not any(allowed in reason for allowed in SKIPPED_IN_CI)]
        if wrong:
            terminal.section("skipped, although the continuous integration has to run it", red=True)
            terminal.line("\n".join(wrong))
            session.exitstatus = pytest.ExitCode.TESTS_FAILED


def _cache(config: pytest.Config) -> pytest.Cache | None:
    """Pytest's cache; None where its plugin is not used."""
    return getattr(config, "cache", None)


def _whole(config: pytest.Config) -> dict[str, int]:
    cache = _cache(config)
    found: dict[str, int] = cache.get(WHOLE, {}) if cache else {}
    return found


def _files(tests: set[str]) -> set[str]:
    """Of tests by their names."""
    return {test.partition("::")[0] for test in tests}


def _kept(config: pytest.Config, name: str) -> set[str]:
    """Tests, or files of tests, that pytest's cache has by a name."""
    cache = _cache(config)
    return set(cache.get(name, [])) if cache else set()


def pytest_configure() -> None:
    """Ctrl-C means what it means at a terminal, also where the tests were started with `&`.

    The first worker has the tests in real time: processors are theirs before the other workers'.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if os.environ.get("PYTEST_XDIST_WORKER", "gw0") != "gw0":
        os.nice(10)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """What fails in real time beside other tests may have been held up by them: `--late` repeats it alone."""
    report = yield
    beside = "PYTEST_XDIST_WORKER" in os.environ and item.get_closest_marker("realtime")
    if report.failed and beside and not item.config.getoption("late"):
        reason = f"failed beside other tests, where this machine may be {TOO_BUSY}; `make late` repeats it alone"
        item.stash[REPEATED] = True
        report.outcome = "skipped"
        report.longrepr = (str(item.path), item.location[1] or 0, f"{reason}: {report.longreprtext}")
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """What is left open by a test that will be repeated is not the fault of the next one, in which it is collected."""
    result = yield
    if REPEATED in item.stash:
        for name in ("last_exc", "last_type", "last_value", "last_traceback"):  # they hold what the test had
            vars(sys).pop(name, None)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            gc.collect()
    return result


def pytest_xdist_auto_num_workers() -> int:
    """One more than there are processors: the one with the tests in real time mostly waits."""
    return (os.cpu_count() or 1) + 1


@pytest.fixture(scope="module", autouse=True)
def _short_alignment(request: pytest.FixtureRequest) -> Iterator[None]:
    """In the whole runs of modules with the mark `short_alignment`."""
    if not request.node.get_closest_marker("short_alignment"):
        yield
        return
    from every_row import short_alignment

    with short_alignment():
        yield


@pytest.fixture
def closing() -> Iterator[ExitStack]:
    """What a test puts in is closed at its end."""
    with ExitStack() as stack:
        yield stack


@pytest.fixture
def domain() -> Iterator[int]:
    """The number of a domain of ROS 2 that no other test uses."""
    from ros2_rig import own_domain

    with own_domain() as number:
        yield number
