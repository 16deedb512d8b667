"""Where a recorded run was: by its own pose, and truly, which only a simulation knows."""

from __future__ import annotations

import numpy as np

from artemis.errors import ConfigError
from artemis.motion.arrays import Array
from artemis.motion.trajectory import Trajectory
from artemis.report.series import Series


def estimated_trajectory(run: Series) -> Trajectory:
    """The centre of the rear axle by the located pose, in its frame, since the odometry got its origin.

    Each pose at the run time when the drives measured what it is computed from.

    Raises:
        ConfigError: the run ended before.
    """
    return _since_placed(run, run.estimated)


def true_trajectory(run: Series) -> Trajectory | None:
    """Its true places, likewise; None: the run was not simulated.

    Raises:
        ConfigError: the run ended before the odometry got its origin.
    """
    return _since_placed(run, run.true) if np.isfinite(run.true[:, 0]).any() else None


def _since_placed(run: Series, poses: Array) -> Trajectory:
    time, poses = run.moment[run.placed :], poses[run.placed :]
    kept = np.isfinite(poses[:, 0]) & (np.diff(time, prepend=-np.inf) > 0)
    if not kept.any():
        raise ConfigError("the run ended before the odometry got its origin: there are no poses")
    return Trajectory(time=time[kept], poses=poses[kept])
