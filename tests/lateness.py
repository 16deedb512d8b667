"""What a test of a run in real time may not be failed for."""

from __future__ import annotations

import os

import pytest

LATE_ROWS = ("SYS-01", "COM-08", "COM-11", "COM-28", "COM-29", "DRV-20")
"""Faults of runs whose host, or drives in another process, are late."""
BACK = 2.0
"""A process that was killed does its work again after so long at the latest [s]."""


def skip_if_late(shown: str, *others: str) -> None:
    """A machine that is busy with something else stops a real-time run, rightly: then there is nothing to test.

    A late host says so itself. Drives in another process that answer too late (and `others`, which are faults too) are
    only believed to be late where more than twice as many programs want to run as there are processors.
    """
    for fault in (*LATE_ROWS, *others) if os.getloadavg()[0] > 2 * (os.cpu_count() or 1) else ("SYS-01",):
        if fault in shown:
            pytest.skip(f"this machine is too busy for real time: {shown[shown.index(fault) :].splitlines()[0]}")
