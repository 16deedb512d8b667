"""`artemis bench page`: how its figures are made of what was seen."""

from __future__ import annotations

from pathlib import Path

import pytest

from artemis_lab.bench.page_link import PageFigures, _figures, _Stops
from artemis_lab.commands import bench_page

FOUND = PageFigures(136_000, 0.2, [0.01, 0.02], [0.02], ([0.001, 0.001], [0.0015, 0.0015]))


def test_a_press_is_answered_by_the_next_stop_and_the_flood_is_compared_with_the_time_before() -> None:
    seen = _Stops(stops=[1.010, 5.020, 9.030], ticks=[(10.0, 0.1), (11.5, 0.2), (12.5, 0.3), (14.5, 0.4)])
    told = {"size": 5, "paint": None, "quiet": [1.0, 5.0], "report": [9.0, 99.0], "flood": [12.0, 14.0]}
    found = _figures(told, seen)
    assert found.quiet == pytest.approx([0.010, 0.020])
    assert found.reporting == pytest.approx([0.030])
    assert found.late == ([0.1, 0.2], [0.3])


@pytest.mark.parametrize(
    ("changes", "held", "words"),
    [
        ({}, True, "first paint: 0.2 s (at most 1)"),
        ({"paint": None}, True, "not measured, there is no browser"),
        ({"reporting": [0.03]}, False, "while a report is made, p95: 30.0 ms (at most 25): EXCEEDED"),
        ({"quiet": []}, False, "nan"),
        ({"size": 400_000}, False, "400.0 kB (at most 300): EXCEEDED"),
    ],
)
def test_what_is_exceeded_is_said(
    changes: dict[str, object],
    held: bool,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    parts = {name: getattr(FOUND, name) for name in FOUND.__slots__}
    monkeypatch.setattr(bench_page, "measure_page", lambda *_: PageFigures(**{**parts, **changes}))
    assert bench_page.measure(Path(), 1, 1.0) is held
    assert words in capsys.readouterr().out
