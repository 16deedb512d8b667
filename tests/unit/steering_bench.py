"""Steered wheels on a bench: potentiometers that are not as the robot file says, and who turns and accepts."""

# ruff: noqa: ANN401  (keys of the step and of the plan are handed on)

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import groupby
from math import degrees, radians
from typing import Any

from core_builders import PERIOD, ROBOT, STEERING, ObedientDrives
from msgspec.structs import replace
from routine_rig import RoutinePlayer

from artemis.drive_states import DriveState
from artemis.states.plan import Plan, Shared
from artemis.states.steering import SteeringStep, calibrate_steering
from artemis.values import DriveFeedback, Job, JobKind, JobResult, Request, SetPoints, Wish

LEFT, RIGHT = STEERING
SIDES = ("left", "right")


@dataclass
class Truth:
    """What is true of one wheel's potentiometers: voltages where its motor counts 0, slopes, and the play."""

    volts: tuple[float, float]
    slopes: tuple[float, float]
    lag_deg: float = 0.0
    """So far the wheel stays behind its motor."""
    drift: float = 0.0
    """Of the first one [V], with each reading."""
    readings: int = 0


def as_known(side: str, turned_deg: float = 0.0, slope: float = 1.0) -> Truth:
    """As the robot file says, but for a wheel that is turned, and for a factor of its slopes."""
    known = ROBOT.potentiometers(side)
    slopes = known.slope_deg_per_v[0] * slope, known.slope_deg_per_v[1] * slope
    volts = tuple(zero + turned_deg / each for zero, each in zip(known.zero_v, slopes, strict=True))
    return Truth((volts[0], volts[1]), slopes)


class Bench(ObedientDrives):
    """All drives are on in the beginning; motors count what they are told at a reference."""

    def __init__(self, **truth: Truth) -> None:
        super().__init__(DriveState.OPERATION_ENABLE)
        self.angles = dict.fromkeys(STEERING, 0.0)
        self.truth = {side: truth.get(side) or as_known(side) for side in SIDES}
        self.counted = dict.fromkeys(STEERING, 0.0)
        """Of the encoders less where the motor stands."""
        self.before = dict.fromkeys(STEERING, 0.0)
        self.side = dict.fromkeys(STEERING, 0.0)
        self.held: set[str] = set()
        """Motors that do not turn."""

    def react(self, wish: Wish, points: SetPoints) -> tuple[DriveFeedback, ...]:
        told = {
            LEFT: self.angles[LEFT] if LEFT in self.held else points.steering_left - self.counted[LEFT],
            RIGHT: self.angles[RIGHT] if RIGHT in self.held else points.steering_right - self.counted[RIGHT],
        }
        points = replace(points, steering_left=told[LEFT], steering_right=told[RIGHT])
        return tuple(self._seen(feedback) for feedback in super().react(wish, points))

    def _seen(self, feedback: DriveFeedback) -> DriveFeedback:
        name = feedback.name
        if name not in STEERING:
            return feedback
        truth, angle = self.truth[ROBOT.drives[name].side], self.angles[name]
        if angle != self.before[name]:
            self.side[name] = 1.0 if angle > self.before[name] else -1.0
        self.before[name] = angle
        wheel = degrees(angle) - self.side[name] * truth.lag_deg
        first, second = (volt + wheel / slope for volt, slope in zip(truth.volts, truth.slopes, strict=True))
        truth.readings += 1
        pots = first + truth.drift * truth.readings, second
        said: dict[str, Any] = {"position": angle + self.counted[name], "potentiometers": pots, **self.changes[name]}
        return replace(feedback, **said)


@dataclass
class Measuring:
    """A step that measures, played with such drives and a person."""

    step: SteeringStep
    bench: Bench = field(default_factory=Bench)
    plan: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        made = Shared(Plan(**{"robot": ROBOT, "steps": (self.step,), **self.plan}))
        self.player = _BenchPlayer(made, lambda shared, seen: calibrate_steering(shared, self.step, seen), self.bench)

    @property
    def shared(self) -> Shared:
        return self.player.mode.shared

    def phases(self) -> list[str]:
        """One after the other; the same may come again."""
        return [phase for phase, _ in groupby(wish.phase for wish in self.player.wishes)]

    def ask(self, words: str, *, longest: float = 60.0) -> Wish:
        """To the wish that shows these words; its question has just begun."""
        return self.player.until(lambda wish: words in wish.phase, longest=longest)

    def press(self, *requests: Request) -> Wish:
        return self.player.tick(requests=requests)

    def wait(self, seconds: float = 0.6) -> None:
        for _ in range(round(seconds / PERIOD)):
            self.player.tick()

    def accept(self) -> Wish:
        """After the question could be read."""
        self.wait()
        return self.press(Request.ACCEPT)


class _BenchPlayer(RoutinePlayer):
    def _perform(self, job: Job) -> JobResult:
        assert isinstance(self.drives, Bench)
        if job.kind is JobKind.REFERENCE:
            self.drives.counted[job.drive] = job.value - self.drives.angles[job.drive]
        return super()._perform(job)


def turned(wishes: Iterable[Wish], side: str) -> list[float]:
    """Angles of one wheel that wishes command [degrees]."""
    from artemis.motion.ackermann import Ackermann

    car = Ackermann(ROBOT.geometry)
    return [degrees(car.wheel_angles(wish.command.steering)[side == "right"]) for wish in wishes]


def measuring(bench: Bench | None = None, plan: dict[str, Any] | None = None, **step: Any) -> Measuring:
    """A step with these keys; `reference` in degrees."""
    reference = {side: radians(angle) for side, angle in step.pop("reference", {}).items()}
    return Measuring(SteeringStep(reference=reference, **step), bench or Bench(), plan or {})
