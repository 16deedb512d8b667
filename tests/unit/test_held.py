"""What a scanner has seen twice and shows no more: how long it is held, and what makes it go."""

import numpy as np
import pytest

from artemis.motion.held import HELD, Held
from artemis.motion.sweep import Rectangle
from artemis.motion.view import View
from artemis.scan import Scan
from artemis.values import Pose
from artemis_lab.bench.obstacle_scenes import BEAMS, FIELD, OUTLINE, SCANNER

BOX = Rectangle(-OUTLINE.rear_m, OUTLINE.front_m, OUTLINE.half_width_m)
INCREMENT = 2 * FIELD / (BEAMS - 1)
MIDDLE = BEAMS // 2
PERIOD = 0.02


def scan(time: float, returns: dict[int, int], start: float = -FIELD) -> Scan:
    """In which only some beams return [mm]."""
    ranges = np.zeros(BEAMS, "<u2")
    for beam, far in returns.items():
        ranges[beam] = far
    return Scan(source="front", time=time, start_angle=start, increment=INCREMENT, ranges=ranges.tobytes())


class Eyes:
    """A view that takes scans one period after the other, of a robot that drives straight ahead."""

    def __init__(self) -> None:
        self.view, self.time, self.x = View(SCANNER, BOX, 1.65, 1.1), 0.0, 0.0

    def take(self, returns: dict[int, int], by: float = 0.0, start: float = -FIELD) -> np.ndarray:
        """One more scan after so many metres. Returns what is held."""
        self.time, self.x = self.time + PERIOD, self.x + by
        self.view.move(Pose(x=self.x), replaced=True)
        self.view.take(scan(self.time, returns, start), self.time, by / PERIOD, 0.0, creeping=False)
        return self.view.around()[1]


LEG = {MIDDLE: 1000}


def test_what_was_seen_twice_is_held_where_it_was_for_half_a_second() -> None:
    eyes = Eyes()
    for _ in range(2):
        assert not eyes.take(LEG).size

    held = [eyes.take({}, by=0.01) for _ in range(30)]

    assert [each.size > 0 for each in held] == [tick * PERIOD < HELD for tick in range(30)]
    for tick in (0, 9):
        assert held[tick].ravel() == pytest.approx([SCANNER.x_m + 1.0 - 0.01 * (tick + 1), 0.0])


def test_dust_is_not_held() -> None:
    eyes = Eyes()
    for returns in ({}, LEG):
        eyes.take(returns)

    assert not eyes.take({}).size


def test_a_return_is_compared_with_three_scans() -> None:
    eyes = Eyes()
    for returns in ({}, LEG, {}, {}, LEG):
        eyes.take(returns)
    assert eyes.view.around()[0].shape == (2, 1)

    for returns in ({}, {}, {}, {}, LEG):
        eyes.take(returns)
    assert eyes.view.around()[0].shape == (2, 0)


def test_one_return_of_it_holds_it_longer_and_what_lies_beyond_ends_it() -> None:
    eyes = Eyes()
    for returns in (LEG, LEG, *[{}] * 20, LEG, *[{}] * 20):
        held = eyes.take(returns)
    assert held.shape == (2, 1)

    wall = dict.fromkeys(range(MIDDLE - 5, MIDDLE + 6), 2000)
    assert eyes.take(wall | {MIDDLE + 1: 0}).shape == (2, 1), "it may hide the beam that shows nothing"
    assert not eyes.take(wall).size


def test_what_is_seen_twice_again_is_not_held_besides() -> None:
    eyes = Eyes()
    for returns in (LEG, LEG, {}, LEG):
        held = eyes.take(returns)

    assert not held.size
    assert eyes.view.around()[0].shape == (2, 1)


def test_what_is_held_is_remembered_once_it_is_nearer_than_the_scanner_sees() -> None:
    eyes = Eyes()
    for returns in ({MIDDLE: 680}, {MIDDLE: 680}):
        eyes.take(returns)
    for _ in range(40):
        eyes.take({}, by=0.007)

    _, held, kept, _ = eyes.view.around()
    assert not held.size
    assert np.hypot(kept[0] - SCANNER.x_m - 0.68 + 0.28, kept[1]).min() < 0.03


def test_an_old_scan_of_other_beams_says_nothing() -> None:
    eyes = Eyes()
    for _ in range(2):
        eyes.take(LEG)

    assert not eyes.take({}, start=-FIELD + 0.5).size


def test_nothing_is_not_near() -> None:
    """A beam that returns nothing is as far as what stands right before the scanner, in millimetres."""
    held = Held()
    held.add(np.array([[0.7], [0.0]]), 0.0)

    held.judge(np.zeros(1), np.array([100.0]), np.zeros(1, np.bool_), np.zeros(1), HELD)

    assert not held.points.size
