"""`artemis init`: asks for the machine, and writes a robot file and a first mission that run at once, simulated."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from shlex import quote
from tempfile import TemporaryDirectory
from typing import TextIO

import numpy as np

from artemis.commands.path_files import write_files
from artemis.errors import ConfigError, similar
from artemis.mission.json_schema import mission_schema, robot_schema
from artemis.mission.loading import load_mission
from artemis.vehicle import RobotFile
from artemis.yaml_edit import Keys, edited
from artemis.yaml_file import Data, survey

RADII = 2.5
"""The first path turns no tighter than so many of the robot's smallest radii (of the rear axle's centre)."""
POINTS = 400
LENGTH_DIGITS = 6
WHEEL_RESERVE, STEERING_SHARE = 1.03, 0.87
"""How much faster than the virtual front wheel the outer one is; share of the steering motors' speed used."""


@dataclass(frozen=True)
class Question:
    """One number of the machine, or a word."""

    key: str
    words: str
    unit: str
    default: float | str
    least: float = 0.0
    most: float = math.inf
    choices: tuple[str, ...] = ()

    def value(self, answer: str) -> float | str:
        """What an answer means; nothing: the default.

        Raises:
            ValueError: no number, or one that no machine has; the text says what is expected.
        """
        if not (answer := answer.strip()):
            return self.default
        if isinstance(self.default, str):
            if self.choices and answer not in self.choices:
                raise ValueError(f"one of these: {similar(answer, self.choices)}")
            if not answer.isprintable():
                raise ValueError("a name of printable characters")
            return answer
        try:
            number = float(answer.replace(",", "."))
        except ValueError:
            raise ValueError(f"a number{f' in {self.unit}' if self.unit else ''}") from None
        if not self.least <= number <= self.most:
            raise ValueError(f"{self.least:g} to {self.most:g} {self.unit}".rstrip())
        return number


LIKE = {
    "artemis": ("artemis.yaml", "two front wheels, each steered and driven by a motor of its own; EPOS"),
    "epos4": ("artemis_epos4.yaml", "the same with EPOS4"),
    "cia402": ("artemis_cia402.yaml", "the same with drives of another maker (CiA 402)"),
    "rear-driven": (
        "rear_driven.yaml",
        "a motor at each rear wheel, one for the front wheels by a measured linkage; EPOS",
    ),
    "tricycle": ("tricycle.yaml", "one front wheel, steered and driven, and two rear wheels; EPOS"),
    "small-car": ("small_car.yaml", "one motor for the rear wheels, one for the front wheels by a linkage; EPOS"),
}
"""Robots to begin with: file in `artemis/testing`, and what they are."""
USUAL = "artemis"

QUESTIONS = (
    Question("name", "Name of the robot", "", "ARTEMIS"),
    Question("wheelbase", "Wheelbase: front axle to rear axle", "m", 0.56, 0.1, 10),
    Question("track", "Track: between the contact points of the {axle} wheels", "m", 0.436, 0.1, 5),
    Question("scrub", "Scrub radius: kingpin to contact point, outwards", "m", 0.0625, 0, 1),
    Question("diameter", "Diameter of the driven wheels", "m", 0.24381, 0.02, 2),
    Question("traction_gear", "Motor turns per turn of a driven wheel", "", 50, 1, 10000),
    Question(
        "steering_gear",
        "Motor turns per turn of a steered wheel about its kingpin, or of the shaft at a linkage",
        "",
        946,
        1,
        10000,
    ),
    Question("steering", "Largest steering angle of the virtual front wheel", "deg", 60, 5, 79),
    Question("speed", "Highest speed", "m/s", 0.7, 0.05, 5),
)
KINGPINS = Question("kingpins", "Distance of the kingpins of the front wheels", "m", 0.311, 0.01, 5)
"""Instead of the scrub radius where the rear wheels are driven: the track is theirs."""


def begin(folder: Path, *, ask: bool, force: bool, like: str | None = None) -> None:
    """Write `folder` with robot, mission `first.yaml`, its path and test, and both schemas, once `run` would take them.

    Args:
        folder: Made if it is not there.
        ask: Ask at the terminal; otherwise every answer is the default, the machine that it is `like`.
        force: Replace files that are there.
        like: The robot to begin with, of `LIKE`; None: that is asked, too.

    Raises:
        ConfigError: files are there already or cannot be written, the input ended before the last answer, the
            answers contradict each other, or there is no robot of this name.
    """
    if like is None:
        like = _nearest_robot(sys.stdin) if ask else USUAL
    elif like not in LIKE:
        raise ConfigError(f"--like {like}: no such robot; {similar(like, LIKE)}")
    template = (files("artemis") / "testing" / LIKE[like][0]).read_bytes()
    machine = RobotFile.model_validate(survey(template, LIKE[like][0])[0].data)
    answers = {each.key: _answer(each, sys.stdin) if ask else each.default for each in questions(machine)}
    made = texts(answers, template, machine)
    with TemporaryDirectory() as trial:
        _write(Path(trial), made, force=False)
        try:
            load_mission(Path(trial, "first.yaml"))
        except ConfigError as error:
            problems = [problem.replace(trial, str(folder)) for problem in error.problems]
            raise ConfigError(
                [*problems, "these numbers make no robot that artemis drives; nothing was written"]
            ) from None
    _write(folder, made, force=force)
    mission = quote(str(folder / "first.yaml"))
    sys.stdout.write(
        f"\n{folder}: made. Next:\n"
        f"  artemis run {mission}    # now, against simulated drives\n"
        f"  artemis doctor --mission {mission}    # what is missing on this computer\n"
        "Motors, gains, currents, sensors of the steering and node ids in robots/robot.yaml are still those of "
        f"{machine.robot}:\n"
        f"{GUIDE} says where each number comes from, and how the first power-up goes.\n"
    )


def _write(folder: Path, texts: Mapping[str, str], *, force: bool) -> None:
    made = {folder / name: text for name, text in texts.items()}
    for place in {file.parent for file in made}:
        try:
            place.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError):
            raise ConfigError(f"{place}: a file is where this folder has to be; name another folder") from None
        except OSError as error:
            raise ConfigError(f"{place}: cannot be made: {error.strerror}") from error
    write_files(made, force)


def questions(machine: RobotFile) -> Iterator[Question]:
    """`QUESTIONS`, of which words and defaults are this machine's."""
    rear = machine.geometry.driven_axle == "rear"
    of_rear = rear or machine.geometry.front_wheels == 1
    traction = machine.drive_at("traction", "left")[1]
    steering = machine.drive_at("steering", "left")[1]
    around = machine.metres_per_count("left") * traction.sensor.counts_per_turn * traction.gear_ratio
    numbers = {
        "wheelbase": machine.geometry.wheelbase_m,
        "track": machine.geometry.track_m,
        "scrub": machine.geometry.scrub_radius_m,
        "kingpins": round(machine.geometry.kingpin_distance_m, LENGTH_DIGITS),
        "diameter": round(around / math.pi, 5),
        "traction_gear": traction.gear_ratio,
        "steering_gear": steering.gear_ratio,
        "steering": machine.limits.steering_deg,
        "speed": machine.limits.speed_m_s,
    }
    for asked in QUESTIONS:
        each = KINGPINS if rear and asked.key == "scrub" else asked
        number = numbers.get(each.key)
        default = machine.robot if number is None else int(number) if number == int(number) else number
        yield replace(each, words=each.words.format(axle="rear" if of_rear else "front"), default=default)


def texts(answers: Mapping[str, float | str], template: bytes, machine: RobotFile) -> dict[str, str]:
    """The files by their names in the folder; `answers` to all `questions` about the machine, by key.

    The robot file is `template`, that of `machine`, with what was answered.
    """
    numbers = {key: value for key, value in answers.items() if isinstance(value, float | int)}
    if (kingpins := numbers.pop("kingpins", None)) is not None:
        numbers["scrub"] = max(0.0, round((numbers["track"] - kingpins) / 2.0, LENGTH_DIGITS))
    robot = edited(template, "robots/robot.yaml", _changes(str(answers["name"]), numbers, machine)).decode()
    robot = _without_stale_comments(robot, template.decode())
    return {
        "robots/robot.yaml": _with_schema(robot, "../robot.schema.json", ROBOT_HEAD.format(robot=machine.robot)),
        "first.yaml": _with_schema(
            MISSION.format(
                speed=min(0.3, 0.5 * numbers["speed"]),
                source="from_potentiometers" if machine.has_potentiometers else "align",
            ),
            "mission.schema.json",
            "",
        ),
        "test_first.py": TEST,
        "paths/first.csv": _figure_eight(_radius(numbers)),
        "mission.schema.json": json.dumps(mission_schema(), indent=1) + "\n",
        "robot.schema.json": json.dumps(robot_schema(), indent=1) + "\n",
    }


GUIDE = "the commissioning guide (docs/commissioning.md in the sources of artemis)"
"""A wheel does not contain it."""
ROBOT_HEAD = f"""\
# Written by `artemis init`. What was asked for is this machine's; the rest is that of the robot {{robot}}, so that it
# runs simulated at once. Before the first power-up of a real machine go through every line, with
# {GUIDE}.
"""
MISSION = """\
# Align the wheels, then one lap of a figure eight, on simulated drives.
# On the robot: bus: {{interface: socketcan, channel: can0}}, or what `artemis devices` shows.
mission: first
robot: robots/robot.yaml
bus: simulation
steps:
  - calibrate: {{steering: {source}}}
  - follow: {{path: paths/first.csv, follower: {{plugin: frenet, speed_m_s: {speed:g}}}, laps: 1}}
"""
TEST = '''\
"""What the mission does, without a robot or a simulation: pytest runs this."""

from pathlib import Path

from artemis.testing import walk

FIRST = Path(__file__).with_name("first.yaml")


def test_first_mission_aligns_the_wheels_and_follows_its_path() -> None:
    first = walk(FIRST, "done", "done")
    assert first.steps == ["calibrate steering", "follow paths/first.csv"]
    assert first.ended == "done"
'''


def _changes(name: str, numbers: Mapping[str, float], machine: RobotFile) -> dict[Keys, Data]:
    """What differs from the template's `machine`, by keys.

    Raises:
        ConfigError: the motors are too slow for the speed asked for.
    """
    speed, around = numbers["speed"], math.pi * numbers["diameter"]
    wheel_speed = round(WHEEL_RESERVE * speed, 4)
    changes: dict[Keys, Data] = {
        ("robot",): name,
        ("geometry", "wheelbase_m"): numbers["wheelbase"],
        ("geometry", "track_m"): numbers["track"],
        ("geometry", "scrub_radius_m"): numbers["scrub"],
        ("limits", "speed_m_s"): speed,
        ("limits", "wheel_speed_m_s"): wheel_speed,
        ("limits", "steering_deg"): numbers["steering"],
    }
    for side in machine.sides("traction"):
        drive, traction = machine.drive_at("traction", side)
        fastest = traction.motor.max_speed_rpm / 60 / numbers["traction_gear"] * around
        if wheel_speed > fastest:
            gear, rpm = numbers["traction_gear"], traction.motor.max_speed_rpm
            raise ConfigError(
                f"{speed:g} m/s is too fast: a motor of {rpm} rpm and a gear of {gear:g} drive a wheel of "
                f"{numbers['diameter']:g} m at {fastest / WHEEL_RESERVE:.2f} m/s at most"
            )
        counts = traction.sensor.counts_per_turn * numbers["traction_gear"]
        changes["calibration", "traction", f"{side}_m_per_count"] = float(f"{around / counts:.7e}")
        changes["drives", drive, "gear_ratio"] = numbers["traction_gear"]
    for side in machine.sides("steering"):
        steer, steering = machine.drive_at("steering", side)
        changes["drives", steer, "gear_ratio"] = numbers["steering_gear"]
        turned = round(steering.lag_counts * numbers["steering_gear"] / steering.gear_ratio)
        changes["drives", steer, "following_error_counts"] = max(turned, 1)
        rate = STEERING_SHARE * 6 * steering.motor.max_speed_rpm / numbers["steering_gear"]
        changes["limits", "steering_rate_wheel_deg_s"] = min(machine.limits.steering_rate_wheel_deg_s, round(rate, 1))
    return changes


def _without_stale_comments(text: str, template: str) -> str:
    """Without the head, which is about another machine, and without comments beside what was changed."""
    kept = set(template.splitlines())
    lines = text[text.index("\nrobot:") + 1 :].splitlines()
    return "\n".join(line if line in kept else line.partition(" #")[0].rstrip() for line in lines) + "\n"


def _radius(numbers: Mapping[str, float]) -> float:
    """Smallest radius of the rear axle's centre that the first path asks for [m]."""
    return RADII * numbers["wheelbase"] / math.tan(math.radians(min(numbers["steering"], 45)))


def _with_schema(text: str, schema: str, head: str) -> str:
    return f"# yaml-language-server: $schema={schema}\n{head}{text}"


def _figure_eight(radius: float) -> str:
    """A closed path: the lemniscate of Gerono (a sin t, 0.4 a sin 2t) of which the tightest curve has `radius` [m].

    It is turned so that it begins at its crossing with heading 0.
    """
    t = np.linspace(0.0, 2 * np.pi, POINTS + 1)
    x, y = np.sin(t), 0.4 * np.sin(2 * t)
    dx, dy, ddx, ddy = np.cos(t), 0.8 * np.cos(2 * t), -np.sin(t), -1.6 * np.sin(2 * t)
    tightest = float(np.min((dx**2 + dy**2) ** 1.5 / np.maximum(np.abs(dx * ddy - dy * ddx), 1e-9)))
    size, turned = radius / tightest, math.atan2(0.8, 1.0)
    along = size * (x * math.cos(turned) + y * math.sin(turned))
    across = size * (y * math.cos(turned) - x * math.sin(turned))
    rows = "".join(f"{one:.4f},{other:.4f}\n" for one, other in zip(along.tolist(), across.tolist(), strict=True))
    return (
        f"# A figure eight, closed; the tightest curve has {radius:.2f} m. Written by `artemis init`.\nx_m,y_m\n{rows}"
    )


def _nearest_robot(source: TextIO) -> str:
    """The robot to begin with, as it was answered."""
    width = max(map(len, LIKE))
    sys.stdout.write("".join(f"  {name:{width}}  {words}\n" for name, (_, words) in LIKE.items()))
    return str(_answer(Question("like", "Which of these is nearest", "", USUAL, choices=tuple(LIKE)), source))


def _answer(question: Question, source: TextIO) -> float | str:
    unit = f" [{question.unit}]" if question.unit else ""
    while True:
        sys.stdout.write(f"{question.words}{unit} ({question.default}): ")
        sys.stdout.flush()
        if not (line := source.readline()):
            raise ConfigError("the input ended before the last answer; nothing was written. --yes takes every default")
        try:
            return question.value(line)
        except ValueError as expected:
            sys.stdout.write(f"  {line.strip()!r}: expected {expected}\n")
