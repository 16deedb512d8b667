"""A slice of `artemis bench obstacles`: its bars hold, and they can fail."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from artemis.cli import app
from artemis.motion import obstacles
from artemis_lab.bench import obstacle_bars
from artemis_lab.bench.obstacle_bars import cost, legs, look_times, persons, slow_downs, standing, who_stays

CALLS = 75
"""Python functions that a look with three arcs calls at most: in each third one it also looks for what moves."""


class Here(Executor):
    """One after the other, in this process."""

    def map(self, fn: Callable[..., Any], *iterables: Iterable[Any], **_: object) -> Iterator[Any]:
        return map(fn, *iterables)


def done() -> None: ...


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(obstacle_bars, "PIECE", 4.0)


@pytest.mark.parametrize("first", [7, pytest.param(100, marks=pytest.mark.exhaustive)])
def test_slice_of_the_bars(first: int) -> None:
    bars = [each(Here(), 3, first, done) for each in (standing, who_stays, legs)]
    bars.append(standing(Here(), 2, first, done, around=True))
    bars += [persons(Here(), 8, first, done), *slow_downs(Here(), 4.0, first, done)]

    assert all(bar.met for bar in bars), bars
    assert "0 of 3 scenes" in bars[0].measured


@pytest.mark.exhaustive
def test_bars_fail_without_the_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(obstacles.ObstacleStop, "look", lambda *_: None)

    assert not standing(Here(), 8, 2000, done).met
    assert not standing(Here(), 4, 2000, done, around=True).met
    assert not persons(Here(), 8, 0, done).met
    assert not who_stays(Here(), 8, 0, done).met
    assert not legs(Here(), 4, 0, done).met


def test_a_look_calls_few_functions() -> None:
    assert max(look_times(looks)[2] for looks in (20, 21, 22)) <= CALLS


def test_cost_is_the_median_and_the_slowest(monkeypatch: pytest.MonkeyPatch) -> None:
    def measured(slowest: float) -> Callable[[int], tuple[np.ndarray, np.ndarray, int]]:
        return lambda looks: (np.array([90.0] * 90 + [slowest] * 10), np.array([45.0]), 7)

    monkeypatch.setattr(obstacle_bars, "look_times", measured(200.0))
    assert cost(100) == (
        "a look with 541 near beams",
        "<= 100 us median, <= 250 us p99",
        "90 us, 200 us; 2.0 x a numpy kernel of 60 operations; 7 Python calls",
        True,
    )
    monkeypatch.setattr(obstacle_bars, "look_times", measured(300.0))
    assert not cost(100).met


@pytest.mark.slow
def test_command_prints_one_table(monkeypatch: pytest.MonkeyPatch) -> None:
    @contextmanager
    def here(_number: int) -> Iterator[Executor]:
        yield Here()

    monkeypatch.setattr("artemis_lab.commands.bench_obstacles.workers", here)
    monkeypatch.setattr(
        "artemis_lab.commands.bench_obstacles.cost", lambda looks: obstacle_bars.Bar("a", "b", "c", False)
    )

    result = CliRunner().invoke(app, ["bench", "obstacles", "--scenes", "1", "--kilometres", "0.004", "--workers", "1"])

    assert result.exit_code == 1
    assert [line.split("  ")[0] for line in result.stdout.splitlines()[2:]] == [
        "what",
        "a",
        "contacts with what stands",
        "contacts with what stands, also behind",
        "person crossing at 1.5 m/s, contact faster than 0.1 m/s",
        "person who steps in or aside, contact while driving",
        "thin leg, 15 % of the beams return, contact",
        "corridor of 0.90 m",
        "dust of 0.0005 a beam",
    ]
