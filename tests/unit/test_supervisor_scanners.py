"""What is measured of laser scanners: each row at its limit, below it, and for a mission that needs them or not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from core_builders import PERIOD, ROBOT
from msgspec.structs import replace
from supervision_rig import Watch

from artemis.mounting import Mounting
from artemis.scan import Condition, Scan
from artemis.supervision import catalogue
from artemis.supervision.catalogue.row import Found
from artemis.supervision.scanners import BEGIN_TIME
from artemis.supervision.supervisor import Supervisor
from artemis.values import Mode, Request, Severity

W, L, S2 = Severity.WARN, Severity.LIMIT, Severity.CONTROLLED_STOP
PLACE = Mounting(
    plugin="lms1xx", x_m=0.5, y_m=0.0, heading_deg=0.0, height_m=0.3, least_range_m=0.5, mask=((-135.0, -120.0),)
)
TURN = 0.015
Change = Callable[[int, Scan], Scan | None]


class Looked(Watch):
    """Ticks of a robot with a scanner, one scan in each; two metres all around, and some noise."""

    def __init__(self, *, needed: bool = True, mounting: Mounting = PLACE) -> None:
        super().__init__()
        robot = ROBOT.model_copy(update={"scanners": {"front": mounting}})
        self.supervisor = Supervisor(robot, PERIOD, needs_scanners=needed)
        self.number = 0
        self._dice = np.random.default_rng(1)

    def scan(self, **changes: Any) -> Scan:  # noqa: ANN401 (of a scan)
        """The next one."""
        self.number += 1
        ranges = 2000 + self._dice.integers(-30, 30, 541)
        scan = Scan(
            source="front",
            time=self.time + PERIOD - 0.001 - 541 * TURN / 541,
            beam_time=TURN / 541,
            start_angle=-np.radians(135.0),
            increment=np.radians(0.5),
            ranges=ranges.astype("<u2").tobytes(),
            counter=self.number,
        )
        return replace(scan, **changes)

    def see(self, seconds: float, change: Change = lambda number, scan: scan) -> list[Severity]:
        """How bad it was in each tick, with scans changed so."""
        found = []
        for number in range(round(seconds / PERIOD)):
            scan = change(number, self.scan())
            self.tick(scans=() if scan is None else (scan,))
            found.append(self.verdict.severity)
        return found

    def after(self, id: str, change: Change, severity: Severity, longest: float = 3.0) -> float | None:
        """When the row is first found so severe [s]; None: not in so long."""
        begun = self.time + PERIOD
        for number in range(round(longest / PERIOD)):
            scan = change(number, self.scan())
            self.tick(scans=() if scan is None else (scan,))
            if self.severity(id) >= severity:
                return self.time - begun
        return None


@pytest.fixture
def watch() -> Looked:
    found = Looked()
    assert set(found.see(1.0)) == {Severity.NONE}
    return found


def blank(first: int, last: int) -> Change:
    def change(number: int, scan: Scan) -> Scan:
        ranges = scan.millimetres.copy()
        ranges[first:last] = 0
        return replace(scan, ranges=ranges.tobytes())

    return change


def equal(times: int) -> Change:
    kept: list[Scan] = []

    def change(number: int, scan: Scan) -> Scan:
        kept.append(scan)
        return replace(scan, ranges=kept[0].ranges) if number < times else scan

    return change


def test_a_scanner_that_measures_is_no_fault(watch: Looked) -> None:
    assert set(watch.see(10.0)) == {Severity.NONE}


def test_no_scan(watch: Looked) -> None:
    assert watch.after("LAS-01", lambda number, scan: scan if number >= 8 else None, S2) is None
    assert watch.after("LAS-01", lambda number, scan: None, S2) == pytest.approx(8 * PERIOD)
    assert "no scan for 180 ms" in watch.verdict.faults[0].text


def every(ticks: int) -> Change:
    """A scanner that scans only in every so-many-th tick."""

    def change(number: int, scan: Scan) -> Scan | None:
        return None if number % ticks else replace(scan, counter=scan.counter // ticks)

    return change


@pytest.mark.parametrize(("ticks", "longest"), [(2, 0.17), (4, 0.20), (5, 0.25), (10, 0.50), (20, 0.50)])
def test_a_slow_scanner_is_lost_after_two_and_a_half_of_its_own_periods(ticks: int, longest: float) -> None:
    watch = Looked()
    assert set(watch.see(3.0, every(ticks))) == {Severity.NONE}
    silent = (watch.time - PERIOD) % (ticks * PERIOD)  # since its last scan
    assert watch.after("LAS-01", lambda number, scan: None, S2) == pytest.approx(longest - silent, abs=1.01 * PERIOD)


def test_a_scan_that_got_lost_makes_no_slower_scanner(watch: Looked) -> None:
    watch.see(1.0, lambda number, scan: None if number % 2 else scan)
    assert watch.after("LAS-01", lambda number, scan: None, S2) == pytest.approx(8 * PERIOD, abs=1.01 * PERIOD)


def test_a_scanner_has_time_to_begin() -> None:
    watch = Looked()
    assert watch.after("LAS-01", lambda number, scan: None, S2, 90.0) == pytest.approx(BEGIN_TIME, abs=PERIOD)
    assert "no scan yet" in watch.verdict.faults[0].text


def test_the_same_scan_again(watch: Looked) -> None:
    kept = watch.scan()
    assert watch.after("LAS-02", lambda number, scan: kept, S2) == pytest.approx(PERIOD)
    assert "came again" in watch.verdict.faults[0].text


def test_equal_scans(watch: Looked) -> None:
    assert watch.after("LAS-02", equal(4), S2) is None
    assert watch.after("LAS-02", equal(5), S2) == pytest.approx(4 * PERIOD)
    assert "5 equal scans" in watch.verdict.faults[0].text


def test_damaged_telegrams(watch: Looked) -> None:
    assert watch.after("LAS-03", lambda number, scan: replace(scan, garbled=int(number == 3)), W) == pytest.approx(
        3 * PERIOD
    )
    watch.see(2.0)
    assert watch.after("LAS-03", lambda number, scan: replace(scan, garbled=1), S2) is None, "every other one"
    watch.see(2.0)
    assert watch.after("LAS-03", lambda number, scan: replace(scan, garbled=2), S2) == pytest.approx(2 * PERIOD)
    assert "6 of 10 telegrams" in watch.verdict.faults[0].text


def test_lost_scans_by_their_counter(watch: Looked) -> None:
    def every(nth: int) -> Change:
        return lambda number, scan: replace(scan, counter=1000 + nth * number)

    assert watch.after("LAS-03", every(2), W) == pytest.approx(0.0), "a jump from the last one"
    watch = Looked()
    assert watch.after("LAS-03", every(1), W) is None
    watch = Looked()
    assert watch.after("LAS-03", every(2), S2) is None
    watch = Looked()
    assert watch.after("LAS-03", every(3), S2) == pytest.approx(3 * PERIOD)


def test_after_a_pause_or_a_restart_nothing_counts_as_lost(watch: Looked) -> None:
    watch.after("LAS-01", lambda number, scan: None, S2)
    assert watch.after("LAS-03", lambda number, scan: replace(scan, counter=50_000 + number), W) is None
    assert watch.after("LAS-03", lambda number, scan: replace(scan, counter=number), W) is None, "it counts anew"


@pytest.mark.parametrize(("condition", "severity"), [(Condition.DIRTY, L), (Condition.FAULTY, S2)])
def test_what_it_says_of_itself(watch: Looked, condition: Condition, severity: Severity) -> None:
    assert watch.after("LAS-05", lambda number, scan: replace(scan, condition=condition, status=5), severity) == 0.0
    assert watch.verdict.severity is severity
    assert "status 0x0005" in watch.verdict.faults[0].text


@pytest.mark.parametrize(
    ("first", "last", "found"),
    [
        (0, 541, True),
        (100, 100 + 20, False),
        (100, 100 + 21, True),
        (0, 31 + 20, False),  # 31 of them see the robot itself
    ],
)
def test_a_cover_on_the_window(watch: Looked, first: int, last: int, found: bool) -> None:
    took = watch.after("LAS-06", blank(first, last), L)
    assert took == (pytest.approx(5 * PERIOD) if found else None)
    if found:
        assert watch.after("LAS-06", blank(first, last), S2) == pytest.approx(1.0 - 6 * PERIOD)
        watch.see(1.0)
        assert watch.verdict.severity is S2, "a person has to look: the robot was stopped for it"
        assert watch.verdict.recovers


@pytest.mark.parametrize(("hidden", "found"), [(40, False), (41, True)])
def test_a_cover_of_a_finer_scanner_is_as_wide(hidden: int, found: bool) -> None:
    watch = Looked()

    def fine(number: int, scan: Scan) -> Scan:
        ranges = np.repeat(scan.millimetres, 2)[1:]
        if number > 50:
            ranges[400 : 400 + hidden] = 0
        return replace(scan, ranges=ranges.tobytes(), increment=scan.increment / 2, beam_time=scan.beam_time / 2)

    assert (watch.after("LAS-06", fine, L) is not None) == found


@pytest.mark.parametrize("value", [1, 40, 497])
def test_a_cover_that_gives_short_values(watch: Looked, value: int) -> None:
    def short(number: int, scan: Scan) -> Scan:
        ranges = value + scan.millimetres % 3
        return replace(scan, ranges=ranges.astype("<u2").tobytes())

    assert watch.after("LAS-06", short, L) == pytest.approx(5 * PERIOD)


def test_what_was_far_may_vanish(watch: Looked) -> None:
    def far(number: int, scan: Scan) -> Scan:
        ranges = scan.millimetres + np.uint16(1100)
        if number > 50:
            ranges[100:200] = 0
        return replace(scan, ranges=ranges.tobytes())

    assert watch.after("LAS-06", far, L) is None


def test_in_the_open_more_than_four_fifths_without_return_are_blind() -> None:
    seen, mostly = 510, round(0.8 * 510)
    watch = Looked()
    assert watch.after("LAS-06", blank(541 - mostly, 541), L) is None
    watch = Looked()
    assert watch.after("LAS-06", blank(541 - mostly - 1, 541), L) == pytest.approx(5 * PERIOD)
    assert seen == 541 - 31


def test_out_into_the_open_and_close_to_a_wall_nothing_is_blind(watch: Looked) -> None:
    def opening(number: int, scan: Scan) -> Scan:
        ranges = scan.millimetres.copy()
        ranges[: 11 * number] = 0 if number < 50 else ranges[: 11 * number]
        return replace(scan, ranges=np.where(ranges, ranges + np.uint16(9000), 0).astype(np.uint16).tobytes())

    assert watch.after("LAS-06", opening, L) is None

    def nearing(number: int, scan: Scan) -> Scan:
        wall = 700 - 15 * number
        return replace(scan, ranges=np.full(541, wall if wall > 500 else 0, np.uint16).tobytes())

    assert Looked().after("LAS-06", nearing, L) is None


def acknowledge(watch: Looked, change: Change, **changes: Any) -> bool:  # noqa: ANN401 (of what is sensed)
    """Whether somebody who acknowledges LAS-06 is rid of it: at once, and for as long as nothing else is seen."""
    scan = change(1000, watch.scan())
    assert scan is not None
    watch.tick(scans=(scan,), requests=(Request.ACKNOWLEDGE,), **changes)
    at_once = "LAS-06" not in watch.ids()
    watch.see(2.5, lambda number, scan: change(1000 + number, scan))
    assert ("LAS-06" not in watch.ids()) == at_once
    return at_once


def stopped(watch: Looked, change: Change) -> Looked:
    """The robot is stopped for what the scanner does not see."""
    assert watch.after("LAS-06", change, S2) is not None
    watch.mode = Mode.QUICKSTOP
    watch.see(1.0, lambda number, scan: change(1000 + number, scan))
    assert watch.verdict.stops
    return watch


def few(first: int, last: int, until: int = 10**6) -> Change:
    """Only some beams return, from far away, in so many scans; then none does."""

    def change(number: int, scan: Scan) -> Scan:
        ranges = np.zeros(541, np.uint16)
        ranges[first:last] = (scan.millimetres + np.uint16(6000))[first:last] if number < until else 0
        return replace(scan, ranges=ranges.tobytes())

    return change


def test_a_few_returns_in_the_open_that_are_lost_at_once_are_a_cover_or_open_ground_as_a_person_says() -> None:
    sees, nothing = few(100, 120), few(0, 0)
    watch = stopped(Looked(), sees)
    assert acknowledge(watch, sees)
    assert watch.verdict.faults == ()
    assert acknowledge(stopped(watch, nothing), nothing), "in the open nobody knows but who looks"


def test_open_ground_at_the_first_scan_is_taken_as_it_is_by_a_person_who_looks() -> None:
    nothing = few(0, 0)
    watch = stopped(Looked(), nothing)
    assert not watch.verdict.final
    assert acknowledge(watch, nothing)
    watch.see(1.0)
    assert watch.after("LAS-06", nothing, L) == pytest.approx(5 * PERIOD), "it has seen since"


def test_a_person_who_has_looked_is_believed_where_much_is_still_seen(watch: Looked) -> None:
    change = blank(100, 200)
    assert acknowledge(stopped(watch, change), change)
    assert watch.verdict.faults == ()
    assert watch.after("LAS-06", blank(100, 230), L) == pytest.approx(5 * PERIOD), "as seen then, and no less"


@pytest.mark.parametrize(("last", "accepted"), [(541, False), (541 - 100, False), (541 - 103, True)])
def test_nobody_can_accept_a_scanner_that_saw_and_now_sees_nearly_nothing(
    watch: Looked, last: int, accepted: bool
) -> None:
    """Of 510 beams that see 102 are a fifth."""
    assert acknowledge(stopped(watch, blank(0, last)), blank(0, last)) == accepted
    watch.see(1.0)
    assert watch.ids() == [], "it sees again"


def test_what_was_doubted_before_is_no_cover_for_sure() -> None:
    """Of 510 beams that see 102 are a fifth."""
    sparse, enough, nothing = few(541 - 101, 541), few(541 - 102, 541), few(0, 0)
    watch = stopped(Looked(), sparse)
    assert acknowledge(watch, sparse)
    assert acknowledge(stopped(watch, nothing), nothing)
    watch = Looked()
    assert set(watch.see(1.0, enough)) == {Severity.NONE}
    assert not acknowledge(stopped(watch, nothing), nothing)


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode not in (Mode.QUICKSTOP, Mode.FAULT)])
def test_an_acknowledgement_says_nothing_of_a_scanner_where_it_is_ignored(mode: Mode) -> None:
    watch = stopped(Looked(), few(0, 0))
    watch.mode = mode
    assert not acknowledge(watch, few(0, 0))
    watch.mode = Mode.FAULT
    assert acknowledge(watch, few(0, 0))


def test_an_acknowledgement_is_for_a_scanner_only_where_nothing_else_stops_the_robot() -> None:
    watch = stopped(Looked(), few(0, 0))
    drive = catalogue.fault("DRV-25", "steer-left")
    assert not acknowledge(watch, few(0, 0), faults=(drive,))
    watch.tick(requests=(Request.ACKNOWLEDGE,))
    assert watch.ids() == ["LAS-06"], "the one that was acknowledged is gone"
    watch.see(2.5, few(0, 0))
    assert acknowledge(watch, few(0, 0))


def test_nobody_looks_at_a_window_that_moves() -> None:
    watch = stopped(Looked(), few(0, 0))
    watch.speeds = (0.1, 0.1)
    scan = few(0, 0)(0, watch.scan())
    assert scan is not None
    watch.tick(scans=(scan,), requests=(Request.ACKNOWLEDGE,))
    assert "LAS-06" in watch.ids()


def test_one_of_two_scanners_is_accepted_and_the_covered_one_is_not() -> None:
    watch = Looked()
    robot = ROBOT.model_copy(update={"scanners": {"front": PLACE, "rear": PLACE}})
    watch.supervisor = Supervisor(robot, PERIOD, needs_scanners=True)

    def tick(rear: bool, **changes: Any) -> None:  # noqa: ANN401 (of what is sensed)
        scan = watch.scan()
        blind = replace(scan, ranges=bytes(2 * 541))
        watch.tick(scans=(blind, replace(scan if rear else blind, source="rear")), **changes)

    for number in range(150):
        tick(number < 50)
    watch.mode = Mode.QUICKSTOP
    assert {fault.device for fault in watch.verdict.stopping} == {"front", "rear"}
    tick(rear=False, requests=(Request.ACKNOWLEDGE,))
    assert [(fault.id, fault.device) for fault in watch.verdict.faults] == [("LAS-06", "rear")]


def late(seconds: float) -> Change:
    return lambda number, scan: replace(scan, time=scan.time - seconds)


def test_scans_that_come_late(watch: Looked) -> None:
    assert watch.after("LAS-07", late(0.05), W) is None
    assert watch.after("LAS-07", late(0.075), W) == pytest.approx(1.0)
    assert watch.after("LAS-07", late(0.15), S2) is None
    assert watch.after("LAS-07", late(0.175), S2) == pytest.approx(0.1)
    assert "late" in watch.verdict.faults[0].text


def test_what_a_mission_does_not_need_is_a_warning() -> None:
    ills: list[tuple[str, Change]] = [
        ("LAS-01", lambda number, scan: None),
        ("LAS-02", equal(10**6)),
        ("LAS-05", lambda number, scan: replace(scan, condition=Condition.FAULTY)),
        ("LAS-06", blank(0, 541)),
    ]
    for id, change in ills:
        watch = Looked(needed=False)
        watch.see(1.0)
        assert watch.after(id, change, W) is not None
        assert watch.after(id, change, L) is None
    told = Looked(needed=False)
    edge = (catalogue.fault("PLG-02", "front", "bug"), catalogue.fault("LAS-01", "front", "no route"))
    assert told.tick(faults=edge).severity is W
    assert told.tick(faults=(catalogue.fault("PLG-02", "follower", "bug"),)).severity > W


def test_scanners_that_no_robot_file_knows_are_not_watched() -> None:
    watch = Looked()
    watch.see(1.0)
    ours = watch.scan()
    watch.tick(scans=(ours, replace(ours, source="rear", condition=Condition.FAULTY)))
    assert watch.verdict.faults == ()


def test_scans_that_are_sensed_between_two_ticks_count(watch: Looked) -> None:
    watch.tick(after=0.005, scans=(watch.scan(),), urgent=True)
    assert set(watch.see(1.0)) == {Severity.NONE}


def test_every_row_of_scanners_is_here() -> None:
    text = Path(__file__).read_text(encoding="utf-8")
    measured = [id for id, row in catalogue.ROWS.items() if id.startswith("LAS") and row.found is Found.MEASURED]
    assert len(measured) == 6
    assert all(f'after("{id}"' in text for id in measured)
