"""Shows a run to ROS 1, from its recording and as slowly as it was: `python -m tests.peers.ros1_shows RUN [SECONDS]`.

After so many seconds of the run the robot stays where it was, until SIGTERM: for scripts/rviz_picture.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from itertools import repeat
from pathlib import Path

from artemis.mission.loading import load_mission
from artemis.planning import localizer_of, setup_for
from artemis.plugins.observers.ros1 import Ros1Observer, Ros1ObserverConfig
from artemis.recording.mcap_reader import Recording
from artemis.run_record import known_map


def main(run: Path, seconds: float) -> None:
    """Tell all that is on the topics, at 50 Hz."""
    (mission,) = (run / "files").glob("*.yaml")
    loaded = load_mission(mission, tried=False)
    shown = known_map(loaded, localizer_of(loaded, simulated=True))
    context = replace(setup_for(loaded, "ros"), map=lambda: shown)
    observer = Ros1Observer(Ros1ObserverConfig(), context)
    ticks = [tick for tick in Recording(run).ticks() if tick.snapshot.time <= seconds]
    begun = time.monotonic()
    for number, tick in enumerate([*ticks, *repeat(ticks[-1], 10_000)]):
        observer.see(tick, (), tick.snapshot.time)
        time.sleep(max(0.0, begun + 0.02 * number - time.monotonic()))


if __name__ == "__main__":
    main(Path(sys.argv[1]), float(sys.argv[2]) if len(sys.argv) > 2 else float("inf"))
