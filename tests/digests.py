"""What runs did, as one number each: `python -m tests.digests --seeds 20` prints JSON.

Two interpreters, or the plain and the compiled build, do the same where they print the same: every tick with all that
was sensed, judged and commanded, and every frame on the wire, to the last bit.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import shutil
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path

from artemis.app import run_mission
from artemis.mission.loading import load_mission, load_model
from artemis.planning import is_fast
from artemis.recording.mcap_reader import Recording
from artemis.recording.schemas import encode
from artemis.values import Tick
from artemis.vehicle import Robot
from artemis_lab.campaign.scenario import scenario

MISSIONS = Path(__file__).parents[1] / "missions"
START = datetime(2000, 1, 1, tzinfo=UTC)


class _Killed(Exception):
    """The host process is gone, as the scenario wants."""


def digest(run: Path) -> str:
    """Of everything that a run's recording holds of its ticks and frames."""
    found = sha256()
    for each in Recording(run).ticks_and_frames():
        found.update(encode(each))
    return found.hexdigest()[:16]


def of_mission(name: str) -> str | None:
    """Of a run of a mission in `missions/`; None: it needs a person or a bus."""
    with tempfile.TemporaryDirectory(prefix="artemis-digests-") as folder:
        copy = Path(folder) / "missions"
        shutil.copytree(MISSIONS, copy, ignore=shutil.ignore_patterns("runs"))
        loaded = load_mission(copy / name)
        if not is_fast(loaded, simulate=True):
            return None
        return digest(run_mission(loaded, copy / name, simulate=True, start=START).run.path)


def of_seed(seed: int) -> str:
    """Of a run of the fault campaign; one that fails or is killed has a digest, too."""
    robot_file = MISSIONS / "robots" / "artemis.yaml"
    given = scenario(seed, load_model(robot_file, Robot))
    with tempfile.TemporaryDirectory(prefix="artemis-digests-") as folder:
        source = given.write(Path(folder), robot_file.read_bytes())
        loaded = load_mission(source)

        def watch(tick: Tick, _: object) -> None:
            if given.killed_at is not None and tick.snapshot.time >= given.killed_at:
                raise _Killed

        failure = ""
        try:
            run_mission(loaded, source, watch=watch, start=START)
        except Exception as error:  # noqa: BLE001  how it fails is part of what it did
            failure = type(error).__name__
        (run,) = (Path(folder) / loaded.mission.record).iterdir()
        return digest(run) + failure


def digests(names: list[str], seeds: range) -> dict[str, str]:
    """By mission and seed, on all processors."""
    jobs: list[tuple[str, Callable[[], str | None]]] = []
    with ProcessPoolExecutor(mp_context=multiprocessing.get_context("spawn")) as pool:
        jobs += [(name, pool.submit(of_mission, name).result) for name in names]
        jobs += [(f"seed {seed}", pool.submit(of_seed, seed).result) for seed in seeds]
        return {name: found for name, result in jobs if (found := result()) is not None}


def main() -> None:
    """Print the digests."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20, help="so many runs of the fault campaign, from seed 1 on")
    parser.add_argument("--no-missions", action="store_true", help="the seeds alone")
    options = parser.parse_args()
    names = [] if options.no_missions else sorted(path.name for path in MISSIONS.glob("*.yaml"))
    json.dump(digests(names, range(1, options.seeds + 1)), sys.stdout, indent=1)
    print()


if __name__ == "__main__":
    main()
