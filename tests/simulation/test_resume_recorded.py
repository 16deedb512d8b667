"""A path that was recorded by driving is still there when a later run goes on with the mission."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
from resuming import Done, driven, refused, resume_point, run
from rig import CALIBRATE, MISSIONS, write_mission

from artemis.commands.replay import replay_run
from artemis.motion.track import Track
from artemis.recording.mcap_reader import Recording
from artemis.values import Mode, Tick

STEPS: list[dict[str, Any]] = [
    CALIBRATE,
    {"teleop": {"input": "stick", "until": {"button": "done"}, "record": "shown"}},
    {
        "follow": {
            "path": {"recorded": "shown", "close_within_m": 1.0},
            "start": "nearest",
            "follower": {"plugin": "indiveri", "speed_m_s": 0.3},
        }
    },
]
LOOP = (MISSIONS / "inputs/show_a_loop.csv").read_text()
"""Once round to the left; what is driven between two presses is the path."""


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mission")
    stick = {"plugin": "scripted", "file": "stick.csv"}
    return write_mission(folder, STEPS, {"stick.csv": LOOP}, inputs={"stick": stick})


@pytest.fixture(scope="module")
def first(mission: Path) -> Done:
    """Ended by somebody after a metre of the recorded path."""
    return run(mission, until=driven(1.0))


def kept(done: Done) -> str:
    return (done.folder / "paths/shown.csv").read_text()


@pytest.mark.slow
def test_a_recorded_path_is_gone_on_with(mission: Path, first: Done) -> None:
    length = first.following()[0].wish.tracking
    assert length is not None
    second = run(mission, first.folder)

    assert (first.outcome.exit_status, second.outcome.exit_status) == (1, 0)
    assert second.arc_lengths()[0] == pytest.approx(first.arc_lengths()[-1], abs=0.2)
    assert second.arc_lengths()[-1] == pytest.approx(length.length, abs=0.05)
    assert max(abs(tick.wish.tracking.cross_track) for tick in second.following() if tick.wish.tracking) < 0.05
    assert kept(second) == kept(first)
    assert replay_run(second.folder) == 0


@pytest.mark.slow
def test_a_run_that_goes_on_with_one_that_went_on_has_it_too(mission: Path, first: Done) -> None:
    second = run(mission, first.folder, until=driven(2.0))
    shutil.rmtree(second.folder / "paths")  # as after a kill
    third = run(mission, second.folder)

    assert third.outcome.exit_status == 0
    assert kept(third) == kept(first)


@pytest.mark.slow
def test_a_killed_run_has_recorded_what_was_driven(mission: Path, tmp_path: Path) -> None:
    shutil.copytree(mission.parent, tmp_path / "m", ignore=lambda *_: ["runs"])
    mission = tmp_path / "m" / mission.name
    killed = tmp_path / "m/runs/20260101T000000Z-rig"

    def copy(tick: Tick) -> bool:
        if driven(1.0)(tick) and not killed.exists():
            (running,) = killed.parent.iterdir()
            shutil.copytree(running, killed)
        return False

    whole = run(mission, until=copy)
    assert not (killed / "paths").exists()
    second = run(mission, killed)
    assert second.outcome.exit_status == 0
    assert kept(second) == kept(whole)


def test_a_path_that_is_being_recorded_is_gone_on_with(mission: Path) -> None:
    """Half of it in each run; the press of the button that began it was in the first."""
    first = run(mission, until=lambda tick: tick.mode is Mode.TELEOP and tick.snapshot.time > 20.0)
    track = resume_point(mission, first.folder).tracks["shown"]
    assert track.by_button is True
    assert Track(poses=track.poses).as_csv() == kept(first)
    assert len(track.poses) > 20


def test_a_path_that_cannot_be_had_is_refused(mission: Path, first: Done, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = list(Recording(first.folder).ticks())
    gone = [tick for tick in whole if not (tick.mode is Mode.TELEOP and 22.0 < tick.snapshot.time < 23.0)]
    monkeypatch.setattr(Recording, "ticks", lambda self: iter(gone))
    assert "ticks are missing while the path shown was recorded" in refused(mission, first.folder)
    none = [tick for tick in whole if tick.mode is not Mode.TELEOP]
    monkeypatch.setattr(Recording, "ticks", lambda self: iter(none))
    assert "the path shown" in refused(mission, first.folder)
