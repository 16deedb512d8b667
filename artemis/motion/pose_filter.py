"""A pose without the noise of its measurement, and the true zero of the steering, by the wheels' motion in between.

A Kalman filter cut into small ones: a scalar for each coordinate, and one of two states for the heading theta and the
steering zero b, of which a rolled distance ds turns the robot by ds tan(alpha + b) / L. Between a measured pose and the
next the wheels tell the motion; what they cannot explain is noise at once, and a wrong zero in the long run. A pose
that is the wheels' own (odometry) passes as it is.
"""

from __future__ import annotations

import math

from artemis.motion.angles import difference, wrap
from artemis.motion.odometry import move
from artemis.values import Odometry, Pose

POSITION_NOISE, HEADING_NOISE = 0.005, math.radians(0.25)
"""Standard deviation of a measured coordinate [m] and heading [rad]: of a laser's pose in a known map."""
POSITION_WALK, HEADING_WALK, ZERO_WALK = 0.003, math.radians(0.15), math.radians(0.1)
"""What the wheels do not tell, after one metre: slip, play of the steering; grows with the root of the distance."""
ZERO_STD, ZERO_LIMIT = math.radians(1.5), math.radians(5)
"""Of the steering's zero before anything is known of it, and the largest that is believed [rad]."""
JUMP, TURN = 0.2, math.radians(15)
"""A pose that is farther off [m, rad] is no noise: it was set anew, and holds."""


class PoseFilter:
    """Estimates from one measured pose to the next.

    Attributes:
        pose: of the rear axle's centre.
        steering_zero: what to add to a measured steering angle [rad], left positive.
    """

    def __init__(self, wheelbase: float, pose: Pose, odometry: Odometry) -> None:
        self.pose, self.steering_zero = pose, 0.0
        self._wheelbase, self._last = wheelbase, odometry
        self._position = POSITION_NOISE**2
        self._heading, self._both, self._zero = HEADING_NOISE**2, 0.0, ZERO_STD**2

    def update(self, pose: Pose, odometry: Odometry) -> None:
        """Take in the measured pose and the motion, once in each tick."""
        last, self._last = self._last, odometry
        distance = odometry.distance - last.distance
        angle = (odometry.steering + last.steering) / 2 + self.steering_zero
        moved = move(self.pose, distance, distance * math.tan(angle) / self._wheelbase)
        off_x, off_y = pose.x - moved.x, pose.y - moved.y
        off = difference(pose.heading, moved.heading)
        if math.hypot(off_x, off_y) > JUMP or abs(off) > TURN:
            self.pose = pose
            return
        self._predict(abs(distance), distance / (self._wheelbase * math.cos(angle) ** 2))
        gain = self._position / (self._position + POSITION_NOISE**2)
        self._position *= 1 - gain
        whole = self._heading + HEADING_NOISE**2
        heading_gain, zero_gain = self._heading / whole, self._both / whole
        self._zero -= zero_gain * self._both
        self._heading *= 1 - heading_gain
        self._both *= 1 - heading_gain
        heading = wrap(moved.heading + heading_gain * off)
        self.pose = Pose(x=moved.x + gain * off_x, y=moved.y + gain * off_y, heading=heading)
        self.steering_zero = min(max(self.steering_zero + zero_gain * off, -ZERO_LIMIT), ZERO_LIMIT)

    def _predict(self, distance: float, lever: float) -> None:
        """What the estimates lose on a distance [m], on which a wrong zero turns the robot by `lever` [rad/rad]."""
        self._position += POSITION_WALK**2 * distance
        self._heading += lever * (2 * self._both + lever * self._zero) + HEADING_WALK**2 * distance
        self._both += lever * self._zero
        self._zero = min(self._zero + ZERO_WALK**2 * distance, ZERO_STD**2)
