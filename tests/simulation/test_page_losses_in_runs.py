"""A hand that drives at the page is lost: the robot begins its controlled stop within 0.35 s. On virtual time, with the
times of a link whose beats come every 50 ms and take 40 ms there and back.
"""

from __future__ import annotations

import asyncio
from math import floor
from pathlib import Path

import pytest
from rig import MISSIONS
from test_page_acts_in_a_run import Somebody, run

from artemis.bridges.operator.session import BEAT_EVERY, Arrived, LinkReport
from artemis.bridges.page.port import ENDED
from artemis.bridges.page.session import FRESH
from artemis.values import Mode, Request, Tick

LONGEST = 0.35
"""From the loss to the first set-point of the controlled stop [s]."""
TRIP, HELD = 0.04, 1.0
"""There and back; the hand drives steadily for so long before it is lost [s]."""
TICK = 0.02


class Lost(Somebody):
    """Drives forward, until it is lost so long after a tick; and is there again later, to end the run."""

    def __init__(self, closes: bool, phase: float, burst: bool) -> None:
        super().__init__(lambda _, tick: self._watch(tick))
        self._closes, self._phase, self._burst = closes, phase, burst
        self._steady, self._before, self._mode = 0, 0.0, Mode.INIT
        self.at: float | None = None

    def _watch(self, tick: Tick) -> None:
        now = asyncio.get_running_loop().time()
        self._mode = tick.mode
        self._steady = self._steady + 1 if tick.set_points.speed > 0.0 and tick.set_points.speed == self._before else 0
        self._before = tick.set_points.speed
        if self._steady == HELD / TICK:
            self.at = now + self._phase

    def take(self) -> list[LinkReport]:
        now = asyncio.get_running_loop().time()
        beat = floor((now - TRIP) / BEAT_EVERY) * BEAT_EVERY
        if self.at is None or now < self.at:
            held = self._mode is Mode.TELEOP
            self._newest = Arrived(beat, True, held, not held, 0.0, 0.0, 0.0, (0.0, 0.8 if held else 0.0))
            return [LinkReport("held", "phone", 0.0, newest=self._newest)]
        if now > self.at + 3.0:
            rest = Arrived(beat, True, False, True, 0.0, 0.0, 0.0, (0.0, 0.0))
            return [LinkReport("held", "phone", now, newest=rest, requests=[Request.END], asked=now)]
        if self._closes:
            return [LinkReport("lost", "phone", self.at, ENDED)]
        if self._burst and now > self.at + 1.5:  # what the network kept comes at once, and quotes old beats
            return [LinkReport("held", "phone", 0.0, newest=self._newest)] * 30
        return []


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots/artemis.yaml").write_bytes((MISSIONS / "robots/artemis.yaml").read_bytes())
    return tmp_path


@pytest.mark.short_alignment
@pytest.mark.parametrize("phase", [0.001, 0.007, 0.013, 0.019])
@pytest.mark.parametrize(
    ("closes", "burst"),
    [
        pytest.param(False, False, id="the hand or the page is frozen, or offline"),
        pytest.param(False, True, id="the network stalls, and passes on what it kept"),
        pytest.param(True, False, id="the hand or the page is killed"),
    ],
)
def test_the_robot_stops_when_the_hand_is_lost(closes: bool, burst: bool, phase: float, folder: Path) -> None:
    lost = Lost(closes, phase, burst)
    teleop = {"teleop": {"input": "page", "until": {"button": "done"}}}
    outcome, ticks = run(folder, lost, [teleop], {"robot": "robots/artemis.yaml"})
    assert lost.at is not None
    later = [tick for tick in ticks if tick.snapshot.sensed.time > lost.at]
    before = max(tick.set_points.speed for tick in ticks)
    first = next(tick for tick in later if tick.set_points.speed < before)
    after = first.snapshot.sensed.time - lost.at
    assert 0.0 < after <= (TICK if closes else LONGEST)
    assert closes or after > FRESH - TRIP - BEAT_EVERY - TICK, "and not much sooner"
    assert first.mode is Mode.QUICKSTOP
    speeds = [tick.set_points.speed for tick in later[later.index(first) :]]
    assert speeds == sorted(speeds, reverse=True), "nothing that comes later drives"
    assert speeds[-1] == 0.0
    assert any("NET-01" in line for line in lost.journal)
    assert outcome.exit_status == 1
