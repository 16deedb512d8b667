"""Many runs of many followers: each a task for a process of its own, whose failure is a result like any other."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from itertools import product
from pathlib import Path as FilePath

from artemis.plugins.contracts import Follower, PluginContext
from artemis.plugins.guard import PLUGIN_ERRORS, told
from artemis.plugins.registry import FOLLOWERS, listing, load
from artemis.vehicle import RobotFile
from artemis_lab.bench import full_stack
from artemis_lab.bench.cases import CASES, CLEAN, NOISY, Case, random_case
from artemis_lab.bench.courses import Course, five_courses, random_course
from artemis_lab.bench.driving import FollowerRefused, RunOutcome, drive
from artemis_lab.bench.judge import Figures, RunTrack
from artemis_lab.bench.python_robotics import REFERENCES, reference

SPEED = 0.7
"""What followers are told to drive, at most the robot's speed [m/s]."""
FRAMES = "frames"
"""The column of the whole stack: simulated drives, every frame, odometry only."""
RANDOM = "random"


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """One run."""

    follower: str
    """An installed one, or one of `REFERENCES`."""
    course: str
    """One of the five; `random-SEED`."""
    case: str
    """One of `CASES`, `FRAMES` or `RANDOM`."""
    robot: RobotFile
    seed: int
    checkout: FilePath | None = None
    """Of PythonRobotics."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
    """What came of a task."""

    task: Task
    figures: Figures | None
    """None: it did not drive to its end."""
    problem: str = ""
    """Why: `refused`, `raised`, `lost`, `late` or `elsewhere`, a colon, and words."""
    track: RunTrack | None = None
    """Of what goes into a figure."""


def installed() -> list[str]:
    """Followers by their names."""
    return [found.name for found in listing(FOLLOWERS)]


def tasks(
    followers: Iterable[str],
    courses: Iterable[str],
    robot: RobotFile,
    *,
    seed: int,
    frames: bool,
    random: int,
    checkout: FilePath | None,
) -> Iterator[Task]:
    """All runs of a bench; `random`: so many random courses for each follower.

    The outside reference is slow: it does its runs with and without noise only.
    """
    courses = list(courses)
    for follower in followers:
        outside = follower in REFERENCES
        cases = [CLEAN, NOISY] if outside else [*CASES, FRAMES] if frames else list(CASES)
        for course, case in product(courses, cases):
            yield Task(follower=follower, course=course, case=case, robot=robot, seed=seed, checkout=checkout)
        for number in range(seed, seed + random if not outside else seed):
            course = f"{RANDOM}-{number}"
            yield Task(follower=follower, course=course, case=RANDOM, robot=robot, seed=number, checkout=checkout)


def run_all(given: Iterable[Task], finished: Callable[[Measurement], None]) -> list[Measurement]:
    """Do every run, as many at once as there are processors; each is told to `finished` as it ends."""
    given = list(given)
    rows: dict[int, Measurement] = {}
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(os.cpu_count() or 1, len(given)), mp_context=fresh) as pool:
        futures = {pool.submit(run, task): index for index, task in enumerate(given)}
        for future in as_completed(futures):
            rows[futures[future]] = future.result()
            finished(future.result())
    return [rows[index] for index in range(len(given))]


def run(task: Task) -> Measurement:
    """Do one run; whatever the follower does is part of the result."""
    try:
        driven = _drive(task)
    except FollowerRefused as refusal:
        return Measurement(task=task, figures=None, problem=f"refused: {refusal}")
    except KeyboardInterrupt:
        raise
    except PLUGIN_ERRORS as error:  # the follower's: a stranger's code may raise anything
        return Measurement(task=task, figures=None, problem=f"raised: {told(error)}")
    figures = None if driven.problem else driven.figures
    return Measurement(
        task=task, figures=figures, problem=driven.problem, track=driven.track if task.case == CLEAN else None
    )


def _drive(task: Task) -> RunOutcome:
    course, case = _course(task), random_case(task.seed) if task.case == RANDOM else CASES.get(task.case)
    if case is None:
        return full_stack.drive(task.follower, options(task.follower, task.robot), course, task.robot, task.seed)
    robot = case.robot(task.robot)
    return drive(follower(task, robot, case), course, robot, case.conditions, task.seed)


def _course(task: Task) -> Course:
    if task.case == RANDOM:
        return random_course(task.seed, task.robot)
    return next(course for course in five_courses() if course.name == task.course)


def follower(task: Task, robot: RobotFile, case: Case) -> Follower:
    """The follower of a task, new."""
    if task.follower in REFERENCES and task.checkout is not None:
        return reference(task.follower, task.checkout, robot, case.conditions.period, SPEED)
    plugin = load(FOLLOWERS, task.follower)
    config = plugin.Config.model_validate(options(task.follower, robot))
    made: Follower = plugin(config, PluginContext(name=task.follower, robot=robot, folder=FilePath()))
    return made


def options(name: str, robot: RobotFile) -> dict[str, float]:
    """What a mission would write beside `plugin:`: the speed, if it takes one; all else has its default."""
    fields = load(FOLLOWERS, name).Config.model_fields
    return {"speed_m_s": min(SPEED, robot.limits.speed_m_s)} if "speed_m_s" in fields else {}
