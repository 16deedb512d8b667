"""A process that grows is noticed once it has settled."""

from __future__ import annotations

import pytest

from artemis.devices.host import MORE_FILES, MORE_MEMORY, MORE_THREADS, SETTLED, HostWatch, Usage, usage


class Process:
    def __init__(self) -> None:
        self.usage: Usage = (100_000_000, 5, 20)
        self.looks = 0

    def measure(self) -> Usage:
        self.looks += 1
        return self.usage


def test_growth_before_the_run_has_settled_is_none() -> None:
    process = Process()
    watch = HostWatch(process.measure)
    assert watch.look(0.0) is None
    process.usage = (900_000_000, 50, 200)
    assert watch.look(SETTLED) is None
    assert watch.look(SETTLED + 2.0) is None


@pytest.mark.parametrize(
    ("number", "more", "words"), [(0, MORE_MEMORY, "memory"), (1, MORE_THREADS, "threads"), (2, MORE_FILES, "files")]
)
def test_growth_beyond_its_limit_is_told(number: int, more: int, words: str) -> None:
    process = Process()
    watch = HostWatch(process.measure)
    watch.look(SETTLED)
    grown = list(process.usage)
    grown[number] += more
    process.usage = (grown[0], grown[1], grown[2])
    assert watch.look(SETTLED + 2.0) is None
    grown[number] += 1
    process.usage = (grown[0], grown[1], grown[2])
    told = watch.look(SETTLED + 4.0)
    assert told is not None
    assert words in told


def test_it_looks_once_a_second() -> None:
    process = Process()
    watch = HostWatch(process.measure)
    for tick in range(200):
        watch.look(SETTLED + tick * 0.02)
    assert process.looks == 4


def test_this_process_has_memory_threads_and_files() -> None:
    memory, threads, files = usage()
    assert memory > 1_000_000
    assert threads >= 1
    assert files >= 1
