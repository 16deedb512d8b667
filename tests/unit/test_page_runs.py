"""What a page knows of past runs: which there are, what a list says of them, and what they are replayed from."""

from __future__ import annotations

import gzip
import io
import os
import zipfile
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest
from synthetic_run import record, run

from artemis.errors import RecordingError
from artemis.page.runs import REPLAY, RunFacts, facts_of, find, runs_of, signature
from artemis.page.runs_replay import IN_PIECE, MOST_TRAIL, _Trail, is_made, write_replay
from artemis.page.runs_work import pack
from artemis.page.view import PageView
from artemis.recording.journal import Journal
from artemis.recording.mcap_reader import Recording
from artemis.values import LocatedPose, Mode, Pose

LAP = 32.0
"""Of the circle [s]: more than this is run time."""


def made(root: Path, name: str, fault_at: float | None = None, journal: bool = True) -> Path:
    folder = root / name
    folder.mkdir(parents=True)
    written = Journal(folder / "journal.jsonl") if journal else None
    record(folder / "recording.mcap", run(fault_at=fault_at), journal=written)
    return folder


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    made(folder, "20260301T120000Z-circle")
    made(folder, "20260301T130000Z-circle", fault_at=4.0)
    return folder


def test_runs_are_listed_newest_first_and_links_are_none(root: Path, tmp_path: Path) -> None:
    (tmp_path / "here").mkdir()
    for name in ("20260301T120000Z-circle", "20260301T130000Z-circle"):
        os.link(root / name / "journal.jsonl", _folder(tmp_path / "here" / name) / "journal.jsonl")
    (tmp_path / "here" / "20260301T140000Z-linked").symlink_to(root / "20260301T120000Z-circle")
    _folder(tmp_path / "here" / "20260301T150000Z-empty")
    linked = _folder(tmp_path / "here" / "20260301T160000Z-file") / "recording.mcap"
    linked.symlink_to(root / "20260301T120000Z-circle" / "recording.mcap")
    assert runs_of(tmp_path / "here") == ["20260301T130000Z-circle", "20260301T120000Z-circle"]
    assert runs_of(tmp_path / "nowhere") == []


def _folder(path: Path) -> Path:
    path.mkdir()
    return path


@pytest.mark.parametrize(
    ("number", "name"),
    [("1", "20260301T120000Z-circle"), ("-1", "20260301T120000Z-circle"), ("\u0660", "20260301T120000Z-circle")]
    + [("0", name) for name in ("", ".", "..", "../x", "x", "20260301T120000Z-circle/", "a\0b")],
)
def test_only_runs_of_the_folders_are_found(root: Path, number: str, name: str) -> None:
    assert find([root], number, name) is None
    assert find([root], "0", "20260301T120000Z-circle") == root / "20260301T120000Z-circle"


def test_a_linked_run_is_not_found(root: Path, tmp_path: Path) -> None:
    (tmp_path / "linked").symlink_to(root / "20260301T120000Z-circle")
    assert find([tmp_path], "0", "linked") is None


def test_the_journal_says_what_a_run_was(root: Path) -> None:
    facts = facts_of(root / "20260301T120000Z-circle")
    assert (facts.mission, facts.robot, facts.state, facts.outcome) == ("circle", "ARTEMIS", "over", "done")
    assert (facts.start, facts.problem, facts.faults, facts.distance) == (
        "2026-03-01T12:00:00.250000+00:00",
        "",
        {},
        0.0,
    )
    assert facts.duration > LAP / 2
    broken = facts_of(root / "20260301T130000Z-circle")
    assert list(broken.faults) == ["DRV-25 steer-left: following error <too large>"]


def _without_journal(folder: Path) -> None:
    (folder / "journal.jsonl").unlink()


def _cut_recording(folder: Path) -> None:
    content = (folder / "recording.mcap").read_bytes()
    (folder / "recording.mcap").write_bytes(content[: len(content) // 2])


def _cut_journal(folder: Path) -> None:
    content = (folder / "journal.jsonl").read_bytes().splitlines(keepends=True)
    (folder / "journal.jsonl").write_bytes(b"".join(content[:-1]) + b'{"sequence": broken')
    os.utime(folder / "journal.jsonl", (1e9, 1e9))


def _no_recording(folder: Path) -> None:
    (folder / "recording.mcap").unlink()


def _rubbish(folder: Path) -> None:
    (folder / "recording.mcap").write_bytes(b"rubbish" * 100)
    _without_journal(folder)


@pytest.mark.parametrize(
    ("damage", "state", "outcome", "problem"),
    [
        (_without_journal, "over", "done", ""),
        (_cut_recording, "over", "done", "cut off"),
        (_cut_journal, "over", "done", "line"),
        (_no_recording, "over", "done", "no recording here"),
        (_rubbish, "unfinished", "", "not an MCAP file"),
    ],
)
def test_damage_is_said(tmp_path: Path, damage: Callable[[Path], None], state: str, outcome: str, problem: str) -> None:
    folder = made(tmp_path, "20260301T130000Z-circle", fault_at=4.0)
    whole = facts_of(folder)
    damage(folder)
    facts = facts_of(folder)
    assert (facts.state, facts.outcome) == (state, outcome)
    assert problem in facts.problem
    assert bool(problem) == bool(facts.problem)
    assert str(tmp_path) not in facts.problem
    if damage is not _rubbish:
        assert (facts.mission, facts.faults) == (whole.mission, whole.faults)
        assert facts.duration == pytest.approx(whole.duration, abs=0.1)


def test_a_run_without_an_end_runs_or_has_broken_off(tmp_path: Path) -> None:
    folder = _folder(tmp_path / "run")
    journal = Journal(folder / "journal.jsonl")
    journal.mark(7.0)
    written = journal.path.read_bytes()
    assert facts_of(folder) == RunFacts(state="running", duration=7.0)
    journal.close()
    (folder / "journal.jsonl").write_bytes(written)
    facts = facts_of(folder)
    assert (facts.state, facts.duration, facts.distance) == ("unfinished", 7.0, None)


# ---------------------------------------------------------------------------------------------------- replays


def content(file: Path) -> Any:  # noqa: ANN401 (JSON)
    return msgspec.json.decode(gzip.decompress(file.read_bytes()))


def states_of(folder: Path, index: dict[str, Any]) -> list[tuple[float, dict[str, Any]]]:
    """All states, as a page makes them again from what differs."""
    found = []
    for number in range(len(index["pieces"])):
        state: dict[str, Any] = {}
        for time, changed in content(folder / f"{number}.json.gz")["states"]:
            state = {**state, **changed}
            found.append((time, state))
    return found


def test_a_replay_has_the_states_that_a_live_page_was_told(root: Path, tmp_path: Path) -> None:
    folder, told = root / "20260301T120000Z-circle", list[float]()
    target = tmp_path / REPLAY
    write_replay(folder, target, told.append)
    index = content(target / "index.json.gz")
    states = dict(states_of(target, index))
    recording = Recording(folder)
    view = PageView(recording.robot, recording.mission, {})
    for tick in recording.ticks():
        view.show(tick)
        if (time := round(tick.snapshot.time, 3)) in states:
            shown, live = states.pop(time), msgspec.json.decode(msgspec.json.encode(view.state(tick)))
            assert shown.pop("ran") == pytest.approx(live.pop("ran"), abs=0.11), "not every tick is shown"
            assert shown == live
    assert not states
    assert index["about"] == msgspec.json.decode(msgspec.json.encode(view.about()))
    assert (index["whole"], index["outcome"], index["problem"], index["map"]) == (True, "done", "", False)
    assert index["end"] == pytest.approx(recording.duration)
    assert told == sorted(told)


def test_states_are_apart_and_the_last_one_is_there(root: Path, tmp_path: Path) -> None:
    write_replay(root / "20260301T120000Z-circle", tmp_path / REPLAY)
    index = content(tmp_path / REPLAY / "index.json.gz")
    times = [time for time, _ in states_of(tmp_path / REPLAY, index)]
    apart = [after - before for before, after in pairwise(times)]
    assert max(apart) == pytest.approx(0.1, abs=0.021)
    assert times[-1] == pytest.approx(index["end"])


def test_a_piece_needs_no_other(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("artemis.page.runs_replay.IN_PIECE", 50)
    write_replay(root / "20260301T120000Z-circle", tmp_path / REPLAY)
    index = content(tmp_path / REPLAY / "index.json.gz")
    assert len(index["pieces"]) > 4
    for number, begin in enumerate(index["pieces"]):
        piece = content(tmp_path / REPLAY / f"{number}.json.gz")
        assert piece["states"][0][0] == begin
        assert {"mode", "pose", "wheels", "sample", "drives", "step"} <= set(piece["states"][0][1])
        assert {name for time, part in piece["parts"] if time == begin for name in part} >= {"faults", "path", "scan"}


def test_modes_and_faults_are_marked_when_they_were(root: Path, tmp_path: Path) -> None:
    write_replay(root / "20260301T130000Z-circle", tmp_path / REPLAY)
    index = content(tmp_path / REPLAY / "index.json.gz")
    begun: dict[str, float] = {}
    for tick in Recording(root / "20260301T130000Z-circle").ticks():
        begun.setdefault(tick.mode.value, tick.snapshot.time)
    assert [[time, mode] for mode, time in begun.items()] == index["modes"]
    assert [time for time, _, _ in index["faults"]] == [begun[Mode.FAULT.value]]
    states = dict(states_of(tmp_path / REPLAY, index))
    assert {states[time]["mode"] for time in begun.values()} == set(begun)
    parts = [part for _, part in content(tmp_path / REPLAY / "0.json.gz")["parts"]]
    assert [fault["id"] for part in parts for fault in part.get("faults", [])] == ["DRV-25"]


def test_modes_are_known_without_a_journal(tmp_path: Path) -> None:
    folder = made(tmp_path, "run", fault_at=4.0, journal=False)
    write_replay(folder, folder / REPLAY)
    assert [mode for _, mode in content(folder / REPLAY / "index.json.gz")["modes"]] == [
        "init",
        "ready",
        "follow",
        "fault",
    ]


def test_a_replay_is_kept_until_the_run_changes(tmp_path: Path) -> None:
    folder = made(tmp_path, "run", fault_at=3.0)
    assert not is_made(folder / REPLAY, folder)
    write_replay(folder, folder / REPLAY)
    assert is_made(folder / REPLAY, folder)
    before = signature(folder)
    with (folder / "recording.mcap").open("ab") as file:
        file.write(b"more")
    assert signature(folder) != before
    assert not is_made(folder / REPLAY, folder)
    write_replay(folder, folder / REPLAY)
    assert is_made(folder / REPLAY, folder)


def test_a_replay_that_is_only_begun_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = made(tmp_path, "run")
    monkeypatch.setattr("artemis.page.runs_replay.IN_PIECE", 50)

    def leave(share: float) -> None:
        raise InterruptedError

    with pytest.raises(RecordingError):
        write_replay(folder, folder / REPLAY, leave)
    index = content(folder / REPLAY / "index.json.gz")
    assert (index["whole"], len(index["pieces"])) == (False, 1)
    assert index["known"] < index["end"]
    assert not is_made(folder / REPLAY, folder)


def test_what_cannot_be_read_or_written_is_said(tmp_path: Path) -> None:
    folder = made(tmp_path, "run", fault_at=3.0)
    (folder / REPLAY).write_text("in the way")
    with pytest.raises(RecordingError, match="cannot be written"):
        write_replay(folder, folder / REPLAY)
    _rubbish(folder)
    with pytest.raises(RecordingError, match="not an MCAP file"):
        write_replay(folder, folder / "elsewhere")


def test_the_way_is_thinned_evenly_and_cut_between_frames() -> None:
    trail = _Trail()
    for number in range(3 * MOST_TRAIL):
        frame = "odom" if number < MOST_TRAIL else "map"
        trail.see(number / 10, LocatedPose(pose=Pose(x=0.06 * number, y=0.0), frame=frame))
    assert len(trail.points) <= MOST_TRAIL
    assert trail.points.count(None) == 1
    known = [point for point in trail.points if point is not None]
    gaps = [after[1] - before[1] for before, after in pairwise(known)]
    assert max(gaps) <= 4 * 0.06 + 1e-9
    assert known[-1][1] > 0.06 * (3 * MOST_TRAIL - 8)


def test_a_piece_is_a_minute() -> None:
    assert IN_PIECE * 0.1 == 60.0


# ---------------------------------------------------------------------------------------------------- archives


def test_an_archive_has_the_files_of_the_run_alone(tmp_path: Path) -> None:
    folder = made(tmp_path, "run", fault_at=2.0)
    _folder(folder / "files")
    (folder / "files" / "mission.yaml").write_text("mission: circle\n")
    (folder / "files" / "secret").symlink_to("/etc/hostname")
    (folder / ".hidden").write_text("x")
    _folder(folder / REPLAY)
    (folder / REPLAY / "index.json.gz").write_text("x")
    out = io.BytesIO()
    pack(folder, out)
    archive = zipfile.ZipFile(out)
    assert archive.testzip() is None
    assert archive.namelist() == ["run/files/mission.yaml", "run/journal.jsonl", "run/recording.mcap"]
    assert archive.read("run/recording.mcap") == (folder / "recording.mcap").read_bytes()
