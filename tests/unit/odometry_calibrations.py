"""Many seeded calibrations of the odometry: how far off they are, and how often the truth is in the interval.

Run with `.venv/bin/python tests/unit/odometry_calibrations.py [SEEDS [FIRST]]`. Every machine hides errors as large as
its parameters' plausible bands; two minutes of driving, a tracker of 2 mm and 0.2 degrees at 20 to 100 Hz whose clock
is off by up to 0.2 s, wheels that slip by 0.2 %.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from calibrated_drives import DESCRIBED, drive, hidden

from artemis.calibration.fit import fit
from artemis.calibration.fitted_run import Run
from artemis.calibration.kinematics import TWO_WHEELS, Kinematics


@dataclass(slots=True)
class Tally:
    """Of one parameter over many calibrations."""

    seen: int = 0
    inside: int = 0
    errors: list[float] = field(default_factory=list)


def calibrated(seeds: Iterable[int], on_axle: bool, wander: float = 0.0, filtered: float = 0.0) -> dict[str, Tally]:
    """One calibration a seed, by the names of the parameters."""
    tallies = {each.name: Tally() for each in TWO_WHEELS}
    for seed in seeds:
        true = hidden(seed)
        driven = drive(true, seed, on_axle=on_axle, wander=wander, filtered=filtered)
        found = fit([Run(log=driven.log, truth=driven.truth)], Kinematics.of(DESCRIBED), TWO_WHEELS)
        for each in found.estimates[: len(TWO_WHEELS)]:
            tally, error = tallies[each.parameter.name], each.value - true[each.parameter.name]
            tally.seen += each.seen
            tally.inside += abs(error) <= each.half_width
            tally.errors.append(error)
    return tallies


def main(seeds: int, first: int) -> None:
    """Print both tables."""
    for on_axle, wander, filtered in ((True, 0.0, 0.0), (False, 0.0, 0.0), (True, 0.01, 0.2)):
        place = "at the rear axle's centre" if on_axle else "anywhere on the robot"
        place += ", slip of 1 % correlated over 3 s, truth filtered over 0.2 s" if wander else ""
        print(f"{seeds} calibrations, tracker {place}")
        print(f"{'parameter':20s}{'seen':>6s}{'inside 95 %':>14s}{'rms error':>12s}{'largest':>12s}")
        for name, tally in calibrated(range(first, first + seeds), on_axle, wander, filtered).items():
            errors = np.degrees(tally.errors) if "zero" in name else 100 * np.array(tally.errors)
            unit = "deg" if "zero" in name else "%"
            rms, largest = float(np.sqrt(np.mean(errors**2))), float(np.abs(errors).max())
            share = f"{tally.inside / seeds:.1%}"
            print(f"{name:20s}{tally.seen:>6d}{share:>14s}{rms:>8.4f} {unit:3s}{largest:>8.4f} {unit}", flush=True)


if __name__ == "__main__":
    numbers = [int(word) for word in sys.argv[1:]]
    main(*(numbers + [200, 0][len(numbers) :]))
