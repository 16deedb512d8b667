"""`python -m tests.fuzz [--seconds 60] [--seed 1] [--target mission]...`: fuzzes every target for that long.

An input that lets something out is kept in `build/fuzz/`; once its cause is gone, it belongs into the corpus.
"""

from __future__ import annotations

import argparse
import resource
import traceback
from hashlib import sha256
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from artemis.clock import stopwatch

from .fuzzing import Target, TooSlow, attempt, inputs
from .targets import targets

FOUND = Path("build/fuzz")
MEMORY = 4 << 30
"""Bytes that all of it may take."""
ENOUGH = 20
"""Findings of one target after which it goes on to the next."""


def main() -> int:
    """Print a line for each target; 1 if anything was found."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="for each target")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--target", action="append", help="only this one (repeatable)")
    options = parser.parse_args()
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    with TemporaryDirectory() as folder:
        chosen = [each for each in targets(Path(folder)) if each.name in (options.target or [each.name])]
        found = sum([search(target, options.seconds, options.seed) for target in chosen])
    return 1 if found else 0


def search(target: Target, seconds: float, seed: int) -> int:
    """Fuzz one target; returns how many different ways of failing were found."""
    begun = stopwatch()
    count = most = 0
    found: set[str] = set()
    for data in inputs(target, Random(f"{target.name} {seed}")):
        if stopwatch() - begun > seconds or len(found) >= ENOUGH:
            break
        count += 1
        try:
            most = max(most, attempt(target, data) // (1 + len(data) // 1000))
        except (Exception, TooSlow) as error:  # noqa: BLE001  # whatever comes out is a finding
            place = traceback.extract_tb(error.__traceback__)[-1]
            cause = f"{type(error).__name__} at {place.filename}:{place.lineno}"
            if cause not in found:
                found.add(cause)
                FOUND.mkdir(parents=True, exist_ok=True)
                file = FOUND / f"{target.name}-{sha256(data).hexdigest()[:8]}"
                file.write_bytes(data)
                print(f"{file}: {cause}: {error}"[:500], flush=True)
    rate = count / (stopwatch() - begun)
    print(f"{target.name}: {count} inputs, {rate:.0f}/s, at most {most} of {target.steps} calls; {len(found)} found")
    return len(found)


if __name__ == "__main__":
    raise SystemExit(main())
