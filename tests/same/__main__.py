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

OF_EXTRAS = re.compile(r"plugin: (network|ros1|ros2|rosbridge|scan_map)|^\W*(goto|mapping):", re.MULTILINE)
"""Missions whose work is done by extras, which the other interpreter may not have, or that keep real time."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--python", type=Path, default=FAST, help="the other one; else that with the compiled artemis")
    parser.add_argument("--seeds", type=int, default=200, help="how many seeds of the fault campaign")
    parser.add_argument("--first", type=int, default=1, help="the first of them")
    parser.add_argument("--missions", action="store_true", help="missions, too, but those of extras")
    parser.add_argument("--print", help="print the digests of these missions and seeds, by this interpreter's artemis")
    words = parser.parse_args()
    if words.print:
        asked = words.print.split(",")
        found = digests([name for name in asked if not name.isdigit()], [int(name) for name in asked if name.isdigit()])
        print(json.dumps({"build": kind_of_build(), "digests": found}))
        return
    if not words.python.exists():
        sys.exit(f"{words.python} is not there" + (": make fast" if words.python == FAST else ""))
    names = (
        sorted(p.name for p in MISSIONS.glob("*.yaml") if not OF_EXTRAS.search(p.read_text())) if words.missions else []
    )
    build, other = differing(words.python, names, range(words.first, words.first + words.seeds))
    print(f"{len(names) + words.seeds} recordings compared with {build} {words.python}, {len(other)} differ: {other}")
    sys.exit(bool(other))


if __name__ == "__main__":
    main()
