"""The same mission gives the same run, and a recording gives the same commands again, bit for bit."""

from __future__ import annotations

import os
import platform
import random
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from disturbance import random_disturbance
from msgspec.structs import replace
from rig import CALIBRATE, MISSIONS, STICK, TELEOP, Rig, Run, follow, run, stick, straight, write_mission

from artemis.commands.replay import replay_run
from artemis.mission.loading import load_mission
from artemis.motion import path as path_module
from artemis.motion import spline
from artemis.planning import core_from
from artemis.recording.mcap_reader import Recording
from artemis.recording.replay import replay
from artemis.recording.schemas import TickRecord, encode
from artemis.values import DriveFeedback, Mode

pytestmark = pytest.mark.short_alignment

STEPS = [CALIBRATE, follow(0.4)]
BENT = "x,y\n" + "".join(f"{x / 10:.2f},{(x / 10) ** 2 / 8:.4f}\n" for x in range(16))
NOISY = {"potentiometer_noise_v": 0.005, "slip": 0.01, "steering_zero_left_deg": 0.5}
TABLE = stick((0.0, 0.0, 0.0, 0), (5.9, 0.2, 0.6, 1), (7.4, -0.4, -0.5, 1), (8.9, 0.0, 0.0, 0))


def operator(*acts: tuple[float, str]) -> dict[str, object]:
    return {"operator": [{"at_s": time, "do": act} for time, act in acts]}


def done(folder: Path) -> Run:
    return run(write_mission(folder, STEPS, simulation={"seed": 5, "true_robot": NOISY}))


def teleop(folder: Path) -> Run:
    return run(write_mission(folder, [CALIBRATE, TELEOP], {"stick.csv": TABLE}, inputs=STICK))


def frozen_input(folder: Path) -> Run:
    inputs = {"stick": {**STICK["stick"], "done_at_end": False}}
    table = stick((0.0, 0.0, 0.0, 0), (5.9, 0.2, 0.6, 1), (7.4, 0.2, 0.6, 1))
    return run(write_mission(folder, [CALIBRATE, TELEOP], {"stick.csv": table}, inputs=inputs))


def drive_fault(folder: Path) -> Run:
    rig = Rig(write_mission(folder, STEPS))
    return rig.while_following(rig.emergency("steer-left", 0x8611)).run()


def quick_stop_and_arm(folder: Path) -> Run:
    return run(write_mission(folder, STEPS, simulation=operator((5.523, "quickstop"), (8.4, "arm"))))


def fault_and_recovery(folder: Path) -> Run:
    rig = Rig(
        write_mission(
            folder, STEPS, {"line.csv": straight(2.0)}, simulation=operator((8.4, "acknowledge"), (13.4, "arm"))
        )
    )
    return rig.while_following(rig.emergency("traction-right", 0x8611)).run()


def lost_bus(folder: Path) -> Run:
    rig = Rig(write_mission(folder, STEPS))
    return rig.while_following(lambda: setattr(rig.bus, "bus_off", True)).run()


def bad_bus(folder: Path) -> Run:
    return run(write_mission(folder, STEPS), disturb=random_disturbance(3, loss=0.01, delay=0.002))


def twenty_five_hertz(folder: Path) -> Run:
    return run(write_mission(folder, STEPS, tick_hz=25))


KINDS: dict[str, tuple[Callable[[Path], Run], Mode]] = {
    "done": (done, Mode.FOLLOW),
    "teleop": (teleop, Mode.TELEOP),
    "frozen input": (frozen_input, Mode.QUICKSTOP),
    "drive fault": (drive_fault, Mode.FAULT),
    "quick stop and arm": (quick_stop_and_arm, Mode.QUICKSTOP),
    "fault and recovery": (fault_and_recovery, Mode.FAULT),
    "lost bus": (lost_bus, Mode.FAULT),
    "bad bus": (bad_bus, Mode.FOLLOW),
    "25 Hz": (twenty_five_hertz, Mode.FOLLOW),
}


def recorded(seen: Run) -> Recording:
    assert seen.outcome is not None
    return Recording(seen.outcome.run.path)


def records(seen: Run) -> list[bytes]:
    """Every tick of a run, as written."""
    return [encode(tick) for tick in recorded(seen).ticks()]


# ---------------------------------------------------------------------------------------------- replay


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", KINDS)
def test_every_command_of_a_run_is_recomputed_from_its_recording_bit_for_bit(tmp_path: Path, kind: str) -> None:
    make, mode = KINDS[kind]
    seen = make(tmp_path)
    assert mode in seen.modes
    assert recorded(seen).missing is None
    result = seen.recompute()
    assert (result.difference, result.ticks) == (None, len(seen.seen))
    assert seen.outcome is not None
    assert replay_run(seen.outcome.run.path) == 0


def test_what_is_before_a_damaged_chunk_is_recomputed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    seen = done(tmp_path)
    path, content = recorded(seen).path, bytearray(recorded(seen).path.read_bytes())
    content[content.index(b"zstd", len(content) // 2) + 100] ^= 1
    path.write_bytes(content)

    damaged = recorded(seen)
    assert 0 < damaged.number < len(seen.seen)
    assert replay_run(path) == 0
    told = capsys.readouterr().out
    assert "the recording is not whole: the file is damaged" in told
    assert f" of the {damaged.number} ticks that are there recomputed: every command equal" in told


def test_a_mission_for_a_real_bus_that_is_simulated_replays_with_the_faults_of_its_follower(tmp_path: Path) -> None:
    bus = {"interface": "virtual", "channel": "replay"}
    seen = run(write_mission(tmp_path, STEPS, bus=bus, simulation={"faults": [{"at_s": 5.9, "inject": "PLG-02"}]}))
    assert seen.fault_ids == ["PLG-02"]
    assert seen.outcome is not None
    assert replay_run(seen.outcome.run.path) == 0


class Altered(Recording):
    """A recording in which one sensed value was another."""

    change: tuple[int, Callable[[TickRecord], TickRecord]]

    def ticks(self) -> Iterator[TickRecord]:
        at, change = self.change
        for number, tick in enumerate(super().ticks()):
            yield change(tick) if number == at else tick


def with_drives(tick: TickRecord, drives: tuple[DriveFeedback, ...]) -> TickRecord:
    return replace(tick, snapshot=replace(tick.snapshot, sensed=replace(tick.snapshot.sensed, drives=drives)))


def roll_on(tick: TickRecord) -> TickRecord:
    """The first drive's position is another by the smallest step that a float has."""
    first, *others = tick.snapshot.sensed.drives
    moved = replace(first, position=first.position + 1e-9)
    return with_drives(tick, (moved, *others))


def lose_state(tick: TickRecord) -> TickRecord:
    """A drive's emergency that was never sent."""
    first, *others = tick.snapshot.sensed.drives
    failed = replace(first, emergencies=(0x8611,))
    return with_drives(tick, (failed, *others))


@pytest.mark.parametrize("change", [roll_on, lose_state])
def test_one_altered_value_is_reported_with_its_tick(
    tmp_path: Path, change: Callable[[TickRecord], TickRecord]
) -> None:
    seen = done(tmp_path)
    assert seen.outcome is not None
    altered = Altered(seen.outcome.run.path)
    ticks = [number for number, s in enumerate(seen.seen) if s.mode is Mode.FOLLOW]
    altered.change = random.Random(1).choice(ticks), change
    result = replay(altered, core_from(load_mission(seen.mission)))
    assert result.difference is not None
    assert result.difference.startswith(f"tick {altered.change[0]} differs")
    assert result.ticks == altered.change[0] + 1


def test_a_mission_that_was_changed_after_the_run_does_not_recompute(tmp_path: Path) -> None:
    """A recording replayed with another robot or speed is not the same run: the first command that differs is shown."""
    seen = run(write_mission(tmp_path / "slow", STEPS))
    other = write_mission(tmp_path / "fast", [CALIBRATE, follow(0.3)])
    result = replay(recorded(seen), core_from(load_mission(other)))
    assert result.difference is not None
    assert "command" in result.difference or "set_points" in result.difference


# ---------------------------------------------------------------------------------------------- determinism


@pytest.mark.sampled(2)
@pytest.mark.parametrize("kind", ["done", "teleop", "fault and recovery", "bad bus"])
def test_the_same_mission_twice_gives_identical_records(tmp_path: Path, kind: str) -> None:
    make, _ = KINDS[kind]
    first, second = make(tmp_path / "first"), make(tmp_path / "second")
    assert records(first) == records(second)
    frames, again = ([f for _, f in recorded(seen).frames()] for seen in (first, second))
    assert frames == again


def test_another_seed_gives_another_run_where_there_is_noise(tmp_path: Path) -> None:
    one, other = (
        run(write_mission(tmp_path / str(seed), STEPS, simulation={"seed": seed, "true_robot": NOISY}))
        for seed in (1, 2)
    )
    assert records(one) != records(other)
    assert one.status == other.status == 0


def test_without_anything_random_the_seed_does_not_matter(tmp_path: Path) -> None:
    one, other = (run(write_mission(tmp_path / str(seed), STEPS, simulation={"seed": seed})) for seed in (1, 2))
    assert records(one) == records(other)


# ---------------------------------------------------------------------------------------------- another computer


def test_a_replay_drives_the_route_of_the_run_whatever_it_is_made_into_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on another processor, where numpy and scipy give other last bits."""
    seen = run(write_mission(tmp_path, [CALIBRATE, follow(0.4, path="bent.csv")], {"bent.csv": BENT}))
    assert seen.outcome is not None
    exact = spline.smoothed
    monkeypatch.setattr(path_module, "smoothed", lambda *given: exact(*given) * (1.0 + 1e-15))
    assert replay(recorded(seen), core_from(load_mission(seen.mission))).difference is not None
    assert replay_run(seen.outcome.run.path) == 0


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="names kernels of x86 processors")
@pytest.mark.parametrize("name", ["follow_corner", "three_point_turn"])
def test_a_run_of_one_processor_replays_as_on_another(tmp_path: Path, name: str) -> None:
    missions = shutil.copytree(MISSIONS, tmp_path / "missions", ignore=shutil.ignore_patterns("runs"))
    vectors = " ".join(np.show_config(mode="dicts")["SIMD Extensions"].get("found", []))
    here = {"OPENBLAS_CORETYPE": "Haswell"}
    there = {"OPENBLAS_CORETYPE": "Prescott", "NPY_DISABLE_CPU_FEATURES": vectors}
    for command, processor in (("run", here), ("replay", there)):
        where = missions / f"{name}.yaml" if command == "run" else next((missions / "runs").iterdir())
        words = [sys.executable, "-m", "artemis", command, str(where)]
        done = subprocess.run(words, env={**os.environ, **processor}, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
    assert "every command equal, bit for bit" in done.stdout
