"""Charts of a comparison with the truth: distance and angle from it over time, and over the distance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from artemis.motion.clocks import longest_gap
from artemis.motion.comparison import Comparison
from artemis.report.charts import DEGREES, MILLI, Chart, ChartLine, drawn

TITLE, CAPTION = "Errors", "Distance from the true place, and angle left of the true heading."
DISTANCE = "distance by the odometry [m]"


def error_charts(comparison: Comparison) -> list[Chart]:
    """Over the run time, and over the distance."""
    torn = np.where(after_gap(comparison), np.nan, 1.0)
    place = ChartLine(name="place", ink="estimated", values=MILLI * torn * comparison.error)
    turned = ChartLine(name="heading", ink="estimated", values=DEGREES * torn * comparison.heading_error)
    charts = (
        Chart(name="place [mm]", digits=2, x=comparison.time, lines=(place,), from_zero=True),
        Chart(name="heading [°]", digits=3, x=comparison.time, lines=(turned,)),
        Chart(name="place [mm]", digits=2, x=comparison.distance, lines=(place,), over=DISTANCE, from_zero=True),
    )
    return drawn(charts)


def after_gap(comparison: Comparison) -> NDArray[np.bool_]:
    """Which poses follow a time without any; lines are broken there."""
    return np.append(False, np.diff(comparison.time) > longest_gap(comparison.time))
