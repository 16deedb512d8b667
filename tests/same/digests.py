"""What runs did, as one number each: every tick with all that was sensed, judged and commanded, and every frame."""

from __future__ import annotations

import json
import multiprocessing
import os
import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path

from artemis.app import run_mission
from artemis.mission.loading import load_mission, load_model
from artemis.planning import is_fast
from artemis.recording.mcap_reader import Recording
from artemis.values import Tick
from artemis.vehicle import RobotFile
from artemis_lab.campaign.scenario import scenario

HERE = Path(__file__).parents[2]
MISSIONS = HERE / "missions"
FAST = HERE / "build" / "fast" / "bin" / "python"
"""The interpreter with the compiled artemis."""
START = datetime(2000, 1, 1, tzinfo=UTC)


class Killed(Exception):
    """The scenario ends the host here."""


def digest(run: Path) -> str:
    """Of everything that a run's recording holds of its ticks and frames, as far as it is whole."""
    found = sha256()
    for each in Recording(run).ticks_and_frames():
        found.update(repr(each).encode())  # every field; its JSON has no defaults
    return found.hexdigest()[:16]


def of_mission(name: str) -> str:
    """Of a run of a mission in `missions/`; nothing where it needs a person."""
    with tempfile.TemporaryDirectory(prefix="artemis-digests-") as folder:
        copy = Path(folder) / "missions"
        shutil.copytree(MISSIONS, copy, ignore=shutil.ignore_patterns("runs"))
        loaded = load_mission(copy / name)
        if not is_fast(loaded, simulate=True):
            return ""
        return digest(run_mission(loaded, copy / name, simulate=True, start=START).run.path)


def of_seed(seed: int) -> str:
    """Of a run of the fault campaign, with how its program failed if it did."""
    robot_file = MISSIONS / "robots" / "artemis.yaml"
    given = scenario(seed, load_model(robot_file, RobotFile))

    def watch(tick: Tick, _: object) -> None:
        if given.killed_at is not None and tick.snapshot.time >= given.killed_at:
            raise Killed

    failure = ""
    with tempfile.TemporaryDirectory(prefix="artemis-digests-") as folder:
        source = given.write(Path(folder), robot_file.read_bytes())
        loaded = load_mission(source)
        try:
            run_mission(loaded, source, watch=watch, start=START)
        except Exception as error:  # noqa: BLE001  how it fails is part of what it did
            failure = repr(error)
        (run,) = (Path(folder) / loaded.mission.record).iterdir()
        return f"{digest(run)} {failure}".rstrip()


def digests(names: Sequence[str], seeds: Sequence[int]) -> dict[str, str]:
    """By mission and seed, on all processors, by the artemis of this interpreter."""
    with ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn")) as pool:
        missions, runs = pool.map(of_mission, names), pool.map(of_seed, seeds)
        return {**dict(zip(names, missions, strict=True)), **dict(zip(map(str, seeds), runs, strict=True))}


def digests_of(python: Path, names: Sequence[str], seeds: Sequence[int]) -> tuple[str, dict[str, str]]:
    """The same by another interpreter, and which build of artemis that has."""
    command = [str(python), "-m", "tests.same", "--print", ",".join([*names, *map(str, seeds)])]
    # in the folder we stand in are the plain sources; the other interpreter knows where the tests are
    environment = {**os.environ, "PYTHONSAFEPATH": "1", "PYTHONPATH": ""}
    done = subprocess.run(command, cwd=HERE, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    told = json.loads(done.stdout)
    return told["build"], told["digests"]


def differing(python: Path, names: Sequence[str], seeds: Sequence[int]) -> tuple[str, list[str]]:
    """The build of another interpreter's artemis, and the missions and seeds of which it records something else."""
    ours, (build, theirs) = digests(names, seeds), digests_of(python, names, seeds)
    return build, [name for name, found in ours.items() if found != theirs[name]]
