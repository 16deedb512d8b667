"""`artemis bench page`: how its figures are made of what was seen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from artemis_lab.bench.page_link import LossFigures, PageFigures, _figures, _losses, _Seen
from artemis_lab.bench.page_losses import HAND_DIES, PAGE_DIES
from artemis_lab.commands import bench_page

FOUND = PageFigures(136_000, 0.2, [0.01, 0.02], [0.02], ([0.001, 0.001], [0.0015, 0.0015]), (0.04, 0.01))
LOST = LossFigures({HAND_DIES: [0.1, 0.31], PAGE_DIES: [0.04]}, ([0.001], [0.0011]))


def test_a_press_is_answered_by_the_next_stop_and_the_flood_is_compared_with_the_time_before() -> None:
    ticks = [(10.0, 0.1, 0.0), (11.5, 0.2, 0.0), (12.5, 0.3, 0.0), (14.5, 0.4, 0.0)]
    seen = _Seen(stops=[1.010, 5.020, 9.030], ticks=ticks)
    told = {"size": 5, "paint": None, "quiet": [1.0, 5.0], "report": [9.0, 99.0], "flood": [12.0, 14.0]}
    found = _figures({**told, "shares": [0.04, 0.01]}, seen)
    assert found.quiet == pytest.approx([0.010, 0.020])
    assert found.reporting == pytest.approx([0.030])
    assert found.late == ([0.1, 0.2], [0.3])
    assert found.shares == (0.04, 0.01)


def test_a_loss_is_answered_by_the_first_lower_set_point() -> None:
    ticks = [(1.0, 0.0, 0.5), (2.0, 0.0, 0.5), (2.1, 0.0, 0.5), (2.3, 0.0, 0.45), (5.0, 0.0, 0.0), (6.0, 0.0, 0.0)]
    events = [(HAND_DIES, 2.05), (HAND_DIES, 5.5), (HAND_DIES, 0.5), (PAGE_DIES, 2.15)]
    found = _losses(events, _Seen(ticks=ticks))
    assert found.after == {
        HAND_DIES: [pytest.approx(0.25), float("inf"), float("inf")],
        PAGE_DIES: [pytest.approx(0.15)],
    }


def test_ticks_around_the_losses_of_the_page_are_compared() -> None:
    ticks = [(1.0, 0.1, 0.5), (9.0, 0.2, 0.5), (10.1, 0.3, 0.4), (11.4, 0.4, 0.0), (20.0, 0.5, 0.0)]
    assert _losses([(PAGE_DIES, 10.0), (HAND_DIES, 1.0)], _Seen(ticks=ticks)).late == ([0.2], [0.3, 0.4])


@pytest.mark.parametrize(
    ("changes", "held", "words"),
    [
        ({}, True, "| first paint, nothing of it known before | 0.2 s | 1 s |"),
        ({"paint": None}, True, "not measured, there is no browser"),
        ({"reporting": [0.03]}, False, "while a report is made, p95 of 1 | 30.0 ms EXCEEDED | 25 ms |"),
        ({"quiet": []}, False, "nan"),
        ({"size": 400_000}, False, "400.0 kB EXCEEDED | 300 kB |"),
        ({"shares": (0.04, 0.05)}, False, "processor for each browser that watches | 5.0 % EXCEEDED | 3 % |"),
        ({}, True, "| the hand's process is killed: the first lower set-point, worst of 2 | 310.0 ms | 350 ms |"),
        ({"after": {PAGE_DIES: [0.1, 0.4]}}, False, "worst of 2 | 400.0 ms EXCEEDED | 350 ms |"),
        ({"lost_late": ([0.001], [0.0022])}, False, "frozen or killed, p99 of 1 | 1.2 ms EXCEEDED | 1 ms |"),
    ],
)
def test_what_is_exceeded_is_said(
    changes: dict[str, Any],
    held: bool,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    parts = {name: changes.get(name, getattr(FOUND, name)) for name in FOUND.__slots__}
    lost = LossFigures(changes.get("after", LOST.after), changes.get("lost_late", LOST.late))
    monkeypatch.setattr(bench_page, "measure_page", lambda *_: PageFigures(**parts))
    monkeypatch.setattr(bench_page, "measure_losses", lambda *_: lost)
    assert bench_page.measure(Path(), 1, 1.0, 2) is held
    assert words in capsys.readouterr().out
