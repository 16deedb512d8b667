"""Numbers that decide how a map is made. One set fits all: they were chosen on one building, and tried on others."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class MapSettings:
    """Lengths [m], angles [rad]; a score is the mean value of the cells in which a scan's points lie, 0 to 1."""

    # the scan
    nearest: float = 0.1
    farthest: float = 40.0
    spacing: float = 0.03
    """A point closer to the last one is left out."""
    least_points: int = 20

    # the likelihood grid
    cell: float = 0.05
    width: float = 0.08
    """Standard deviation of the values around a point, and of the weight of a point off its line."""
    cells: int = 2048
    """Per side of the wrap-around grid, a power of two: what is matched at one time is no wider."""

    # matching against the last key scans
    key_distance: float = 0.5
    key_turn: float = 0.35
    local: int = 15
    """Key scans that one is matched against."""
    window: float = 0.15
    window_turn: float = 0.10
    window_share: float = 0.3
    """Of the odometry's step, added to the window."""
    blind_window: float = 0.45
    blind_turn: float = 0.35
    """Windows where there is no odometry."""
    prior: float = 0.02
    sure: float = 0.75
    """From the odometry matched as well as this: nothing is searched."""
    poor: float = 0.5
    """Matched no better: searched in a window three times as wide."""
    margin: float = 0.1
    """By which a searched pose has to be better than the one from the odometry."""
    key_score: float = 0.6
    """Below it the next key scan comes after a quarter of the distance."""
    least_score: float = 0.35
    """Below it the odometry stands."""
    weak: float = 0.05
    """Share of the beams that has to constrain every direction; else the weakest is taken from the odometry."""
    seeming: float = 0.02
    """Share of the beams that seems to constrain a direction though nothing is there: noise of the normals."""
    odometry_noise: float = 0.01
    odometry_share: float = 0.1
    odometry_beam: float = 0.1
    """Standard deviation of a beam where it is weighed against odometry: the errors of beams are not independent."""
    kept_distance: float = 0.04
    kept_turn: float = 0.04
    """Scans between two key scans that are kept, to be matched once more at the end, are so far apart."""
    still: float = 0.002
    still_turn: float = 0.001
    """Odometry that moved less since the last scan that was kept: this one adds nothing."""

    # loops
    gap: int = 15
    """Key scans that lie between the ends of a loop at least."""
    places: int = 2
    """Searched for each key scan."""
    loop_radius: float = 3.0
    loop_window: float = 3.0
    """The widest."""
    wide_window: float = 20.0
    """Likewise where all places around are searched, and one has to be better than all others."""
    loop_score: float = 0.60
    loop_least: float = 2.0
    """Beams that have to constrain the weakest direction."""
    unique: float = 0.5
    unique_margin: float = 0.1
    """A loop has to score so much better than every other pose in its window that is further away than `unique`."""
    half: int = 4
    """Key scans to each side that make up a place."""
    drift: float = 0.02
    drift_turn: float = 0.008
    """Standard deviations after 1 m; they grow with the square root of the distance."""
    sure_loop: float = 0.3
    sure_loop_turn: float = 0.08
    """A loop that corrects more needs a second one that agrees."""
    agree: float = 0.25
    agree_turn: float = 0.06
    solve_every: int = 30
    """New loops after which the graph is solved while it grows, at least,"""
    solve_share: float = 0.05
    """and as a share of all: a graph of any size is solved a bounded number of times for each doubling."""

    # the graph
    beam: float = 0.03
    """Standard deviation of a beam."""
    cauchy_loop: float = 1.5
    cauchy_step: float = 3.0
    """Robust scales, in standard deviations."""

    # the last pass
    neighbours: int = 10
    neighbour_radius: float = 4.0
