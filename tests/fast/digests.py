"""What is in the recordings of campaign missions, faults included, in a few characters for each seed."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from multiprocessing import get_context
from pathlib import Path

from mcap.exceptions import McapError
from mcap.reader import make_reader

from artemis.app import run_mission
from artemis.devices.can_bus import Traffic
from artemis.mission.loading import load_mission, load_model
from artemis.values import Tick
from artemis.vehicle import Robot
from artemis_lab.campaign.scenario import scenario

HERE = Path(__file__).parents[2]
ROBOT = HERE / "missions" / "robots" / "artemis.yaml"
FAST = HERE / "build" / "fast" / "bin" / "python"
START = datetime(2000, 1, 1, tzinfo=UTC)


class Killed(Exception):
    """The scenario ends the host here."""


def digest(seed: int) -> str:
    """Of all messages in the recording of a seed, with how its run ended."""
    given = scenario(seed, load_model(ROBOT, Robot))

    def watch(tick: Tick, _traffic: Traffic) -> None:
        if given.killed_at is not None and tick.snapshot.time >= given.killed_at:
            raise Killed

    ended = ""
    with tempfile.TemporaryDirectory() as folder:
        source = given.write(Path(folder), ROBOT.read_bytes())
        loaded = load_mission(source)
        try:
            run_mission(loaded, source, watch=watch, start=START + timedelta(seconds=seed))
        except Exception as error:  # noqa: BLE001 (some scenarios have the program fail: both builds must, and alike)
            ended = repr(error)
        (run,) = (Path(folder) / loaded.mission.record).iterdir()
        found = hashlib.sha256(ended.encode())
        # Where the disk fails the recording may end in the middle of a message.
        with (run / "recording.mcap").open("rb") as file, suppress(McapError):
            for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
                found.update(channel.topic.encode() + message.log_time.to_bytes(8, "little") + message.data)
    return found.hexdigest()


def digests(seeds: Sequence[int]) -> dict[str, str]:
    """By seed, on all processors; what runs is the artemis of this interpreter."""
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        return dict(zip(map(str, seeds), pool.map(digest, seeds), strict=True))


def digests_of(python: str | Path, seeds: Sequence[int], build: str) -> dict[str, str]:
    """The same by another interpreter, whose artemis is of this kind."""
    command = [str(python), "-m", "tests.fast", "--only", ",".join(map(str, seeds))]
    environment = {**os.environ, "PYTHONSAFEPATH": "1"}  # the folder we stand in has the plain sources
    done = subprocess.run(command, cwd=HERE, env=environment, capture_output=True, text=True, check=True)
    told = json.loads(done.stdout)
    assert told["build"] == build, f"{python} runs a {told['build']} artemis"
    found: dict[str, str] = told["digests"]
    return found


def differing(seeds: Sequence[int], fast: str | Path = FAST) -> list[int]:
    """Seeds of which the compiled artemis records something else."""
    plain = digests(seeds)
    compiled = digests_of(fast, seeds, "compiled")
    return [seed for seed in seeds if plain[str(seed)] != compiled[str(seed)]]
