"""Compares recordings of the compiled artemis with those of the plain one, after `make fast`; status 1: some differ."""

from __future__ import annotations

import argparse
import json
import sys

from artemis.build import kind_of_build

from .digests import FAST, differing, digests


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=200, help="how many seeds of a campaign")
    parser.add_argument("--first", type=int, default=1, help="the first of them")
    parser.add_argument("--only", help="print the digests of these seeds, by the artemis of this interpreter")
    words = parser.parse_args()
    if words.only:
        seeds = [int(seed) for seed in words.only.split(",")]
        print(json.dumps({"build": kind_of_build(), "digests": digests(seeds)}))
        return
    if not FAST.exists():
        sys.exit(f"{FAST} is not there: make fast")
    seeds = list(range(words.first, words.first + words.seeds))
    found = differing(seeds)
    print(f"{len(seeds)} recordings compared, {len(found)} differ: {found}")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
