"""Dead reckoning from the driven wheels' distances and the steered wheels' angles."""

from __future__ import annotations

from math import cos, sin

from artemis.axles import Geometry
from artemis.motion.ackermann import Ackermann
from artemis.motion.angles import sinc, wrap
from artemis.values import Odometry, Pose


class Odometer:
    """Integrates the pose of the rear axle's centre along exact arcs.

    Attributes:
        odometry: The newest estimate.
    """

    def __init__(self, geometry: Geometry) -> None:
        self._ackermann = Ackermann(geometry)
        self.reset()

    def reset(self, pose: Pose | None = None) -> None:
        """Begin anew at `pose` (default: the origin), at rest."""
        self.odometry = Odometry(pose=pose or Pose())
        self._rolled = self._slipped = 0.0
        """Since the speed was measured last [m]."""
        self.forget_angles()

    def forget_angles(self) -> None:
        """Take the wheel angles from the next update: what they change by until then is not steering.

        For drives that were told their position.
        """
        self._angles: tuple[float, float] | None = None
        self._change = 0.0

    def update(
        self, distance_left: float, distance_right: float, steering_left: float, steering_right: float, dt: float
    ) -> Odometry:
        """Add what happened since the last update.

        Args:
            distance_left: Distance that the left driven wheel rolled since then [m], forward positive.
            distance_right: The same of the right one.
            steering_left: Angle of the left front wheel now [rad].
            steering_right: The same of the right one.
            dt: Time from the measurement of the last update to this one's [s]; if 0, speed and slip keep their values,
                and what was rolled counts for the next ones.

        The distances belong to the mean angle over the step. Both wheels give the virtual one's distance by least
        squares, after the roll of the turning kingpins is removed. The pose moves along the arc of that angle (thesis
        eq. 3.18 to 3.20 go straight, and 3.20 lacks the distance rolled).
        """
        car, last = self._ackermann, self.odometry
        steering = car.steering_from_wheel_angles(steering_left, steering_right)
        if self._angles is None:
            mean, turned_left, turned_right = steering, 0.0, 0.0
        else:
            change = steering - last.steering
            # the parabola through the last three angles (Adams-Moulton): a chord would smooth every weave a little
            mean = steering - change / 2.0 - (change - self._change) / 12.0
            turned_left, turned_right = steering_left - self._angles[0], steering_right - self._angles[1]
            self._change = change
        self._angles = (steering_left, steering_right)

        distance, residual = car.twist_from_wheels(distance_left, distance_right, mean, turned_left, turned_right)
        advance = distance * cos(mean)
        rolled, slipped = self._rolled + distance, self._slipped + residual
        self._rolled, self._slipped = (rolled, slipped) if dt <= 0.0 else (0.0, 0.0)
        self.odometry = Odometry(
            pose=move(last.pose, advance, distance * sin(mean) / car.wheelbase),
            speed=rolled / dt if dt > 0.0 else last.speed,
            steering=steering,
            distance=last.distance + advance,
            driven=last.driven + (advance if advance > 0.0 else -advance),
            slip=slipped / dt if dt > 0.0 else last.slip,
        )
        return self.odometry


def move(pose: Pose, advance: float, turn: float) -> Pose:
    """The pose at the end of an arc of signed length `advance` [m] that turns by `turn` [rad, left positive]."""
    chord = advance * sinc(turn / 2.0)
    direction = pose.heading + turn / 2.0
    return Pose(x=pose.x + chord * cos(direction), y=pose.y + chord * sin(direction), heading=wrap(pose.heading + turn))
