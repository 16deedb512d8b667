"""Compares what runs record with what they record by another interpreter's artemis; status 1: some differ.

That may be the compiled artemis (`make fast`), or another Python (`scripts/other_python`).
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from pathlib import Path

from artemis.build import kind_of_build

from .digests import FAST, MISSIONS, differing, digests

OF_EXTRAS = re.compile(r"plugin: (network|page|ros1|ros2|rosbridge|scan_map)|^\W*(goto|mapping):", re.MULTILINE)
"""Missions whose work is done by extras, which the other interpreter may not have, or that keep real time."""
TWINS = {
    "calibrate_scanner.yaml": "look_around.yaml",
    "figure_eight_socketcan.yaml": "figure_eight.yaml",
    "figure_eight_udp.yaml": "figure_eight.yaml",
    "return_to_start_cw.yaml": "return_to_start_ccw.yaml",
    "thesis_every_angle.yaml": "thesis_hysteresis.yaml",
    "thesis_slow.yaml": "thesis_fast.yaml",
    "two_robots_second.yaml": "two_robots_first.yaml",
}
"""Missions that compute nothing but what another one computes: they are left out."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--python", type=Path, default=FAST, help="the other one; else that with the compiled artemis")
    parser.add_argument("--seeds", type=int, default=200, help="how many seeds of the fault campaign")
    parser.add_argument("--first", type=int, default=1, help="the first of them")
    parser.add_argument("--missions", action="store_true", help="missions, too, but those of extras and twins")
    parser.add_argument("--print", help="print the digests of these missions and seeds, by this interpreter's artemis")
    words = parser.parse_args()
    if words.print:
        asked = words.print.split(",")
        found = digests([name for name in asked if not name.isdigit()], [int(name) for name in asked if name.isdigit()])
        print(json.dumps({"build": kind_of_build(), "digests": found}))
        return
    if not words.python.exists():
        sys.exit(f"{words.python} is not there" + (": make fast" if words.python == FAST else ""))
    names = sorted(
        path.name
        for path in MISSIONS.glob("*.yaml")
        if words.missions and path.name not in TWINS and not OF_EXTRAS.search(path.read_text())
    )
    build, other = differing(words.python, names, range(words.first, words.first + words.seeds))
    print(f"{len(names) + words.seeds} recordings compared with {build} {words.python}, {len(other)} differ: {other}")
    sys.exit(bool(other))


if __name__ == "__main__":
    main()
