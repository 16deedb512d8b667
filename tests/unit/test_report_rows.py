"""Of a long run a report keeps the rows that matter, and no more memory than of a short one."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import synthetic_run

from artemis.motion.arrays import Array
from artemis.recording.journal import Entry
from artemis.recording.mcap_reader import Recording
from artemis.recording.mcap_writer import Recorder
from artemis.report import rows
from artemis.report.figures import thinned
from artemis.report.rows import Errors, Rows
from artemis.report.series import read_series
from artemis.report.summary import summary

TICKS = 300_000


def hours() -> Array:
    """Run time, x, y, a wave with two spikes, a value that is known only for a while."""
    time = np.arange(TICKS) / 50
    table = np.column_stack([time, time / 5, np.sin(time), np.sin(time / 7), np.full(TICKS, np.nan)])
    table[123_456, 3], table[234_567, 3] = 9.0, -9.0
    table[100_000:200_000, 4] = 1.0
    return table


def kept(table: Array, ticks: int | None, moments: tuple[float, ...] = ()) -> Array:
    found = Rows(table.shape[1], 1, 2, ticks, moments)
    for row in table.tolist():
        found.add(row)
    return found.table()


def test_a_long_run_keeps_its_extremes_in_few_rows() -> None:
    table = hours()
    few = kept(table, TICKS, (4000.013,))

    assert len(few) < TICKS / 4
    assert np.all(np.diff(few[:, 0]) > 0)
    np.testing.assert_array_equal(few[[0, -1]], table[[0, -1]])
    np.testing.assert_array_equal(np.nanmax(few, axis=0), np.nanmax(table, axis=0))
    np.testing.assert_array_equal(np.nanmin(few, axis=0), np.nanmin(table, axis=0))
    assert few[few[:, 3] == 9.0, 0].tolist() == [123_456 / 50]
    assert 4000.02 in few[:, 0]
    assert np.isnan(few[few[:, 0] < 1990, 4]).all()
    assert np.hypot(np.diff(few[:, 1]), np.diff(few[:, 2])).max() < 0.5  # a curve stays one


def test_the_line_of_a_long_run_has_the_extremes_of_every_stretch() -> None:
    table = hours()
    few = kept(table, TICKS)

    x, y = thinned(few[:, 0], few[:, 3])
    assert len(x) < 4000
    for begin in range(0, TICKS, 10_000):
        part = table[begin : begin + 10_000, [0, 3]]
        shown = y[(x >= part[0, 0]) & (x <= part[-1, 0])]
        assert (shown.max(), shown.min()) == pytest.approx((part[:, 1].max(), part[:, 1].min()), abs=0.01)


@pytest.mark.parametrize("ticks", [None, 5000])
def test_a_short_run_keeps_every_row_and_a_long_one_if_it_must(ticks: int | None) -> None:
    table = hours()[:5000]

    np.testing.assert_array_equal(kept(table, ticks), table)


def test_errors_count_what_is_known() -> None:
    errors = Errors()
    assert (errors.rms, errors.max) == (None, None)
    for some in ([], [3.0, np.nan], [np.nan], [-4.0]):
        errors.add(np.array(some))

    assert errors.rms == pytest.approx(12.5**0.5)
    assert errors.max == 4.0


def test_a_long_run_has_the_numbers_of_all_its_ticks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = Recording(_recorded(tmp_path / "recording.mcap", laps=2))
    whole, facts = read_series(recording), summary(recording)
    monkeypatch.setattr(rows, "ALL", 500)
    monkeypatch.setattr(rows, "STRETCHES", 20)

    few, short = read_series(recording), summary(recording)

    assert len(few.time) < len(whole.time) == few.ticks
    assert short == facts
    for name, wheel in few.wheels.items():
        assert np.nanmax(wheel.measured) == np.nanmax(whole.wheels[name].measured)
    assert (few.modes, few.drive_states, few.frames) == (whole.modes, whole.drive_states, whole.frames)
    np.testing.assert_array_equal(few.bus_load, whole.bus_load)
    assert 12.5 in few.time  # when the fault came


@pytest.mark.exhaustive
def test_memory_does_not_grow_with_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rows, "ALL", 500)
    monkeypatch.setattr(rows, "STRETCHES", 20)
    peaks = [_peak(_recorded(tmp_path / f"{laps}.mcap", laps)) for laps in (1, 6, 11)]  # the first one warms caches

    assert peaks[2] - peaks[1] < 400_000  # all ticks, decoded, are 30 MB; their numbers alone are 1.4 MB


def _recorded(path: Path, laps: int) -> Path:
    recorder = Recorder(path, synthetic_run.provenance(), threaded=False)
    for each in synthetic_run.run(laps):
        recorder.observe(each.tick, each.frames, each.true_pose)
    recorder.note(Entry(time=12.5, kind="fault", text="DRV-25 steer-left: blocked"))
    recorder.close("done")
    return path


def _peak(path: Path) -> int:
    tracemalloc.start()
    try:
        read_series(Recording(path))
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
