"""A seed becomes a whole mission: what the robot shall do, what goes wrong and when, who helps, what is truly there."""

from __future__ import annotations

import json
import math
import random
import re
from collections.abc import Sequence, Set
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from artemis.axles import OWN_SIDES, HardStop
from artemis.motion.path import check_drivable, path_from_csv
from artemis.states.outline import steps_in
from artemis.supervision.catalogue import ROWS
from artemis.supervision.catalogue.row import Kind
from artemis.supervision.policy import WATCHED
from artemis.vehicle import RobotFile
from artemis_lab.campaign import shapes
from artemis_lab.campaign.besides import besides
from artemis_lab.campaign.sceneries import SceneryDice
from artemis_lab.campaign.trees import ALIGN, ANSWERS, LENGTH, PARTS, TreeDice
from artemis_lab.injections.stage import Lasting, Needs
from artemis_lab.injections.table import INJECTIONS, shows_on

NOT_DRAWN = {
    "SYS-05": "a signal ends the whole process; an operator's `end` is the same path",
    **{f"LOC-0{number}": "no scenario has a localizer" for number in range(1, 6)},
    "PLG-05": "a leak would outlive the run in the process that does many",
}
"""Injections that no scenario draws, each with the reason."""
OF_SCANNERS = [id for id in INJECTIONS if id.startswith("LAS")]
SEEING = 0.1
"""Share of the seeds that have one, if the campaign does."""
MISSION = "mission.yaml"
BRING_UP, RESET, EDGES, STOPS = 5.0, 3.0, 4.5, 15.0
"""Time to the first step [s]; longer with a reset of communication, and where wheels seek edges, or their stops."""
ENDING = ("INP", "RUN-12", "PTH-08")
"""Faults that have to end for the run to end: controls that never rest, a follower or behaviour that never arrives."""
SLOWEST = 0.05
"""A path that is too fast is driven slower, down to this speed [m/s]."""
GRACE = 5.0
"""The robot waits so long for an operator who no longer acts [s]."""
WAITS = 120.0
"""So much longer it may stand, or creep, for what is in its way [s]."""
_PLUGIN = ("PLG-", "PTH-08", "PTH-09", "RUN-11", "RUN-12")
_CAUGHT = re.compile(r"fault:(\w+-\d+)")
_ROLES = {
    Needs.DRIVE: ("traction", "steering"),
    Needs.SOME_DRIVE: ("traction", "steering"),
    Needs.TRACTION: ("traction",),
    Needs.STEERING: ("steering",),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """One run, complete but for the robot file."""

    seed: int
    mission: dict[str, Any]
    """As in a mission file."""
    files: dict[str, str] = field(default_factory=dict)
    """Tables that it names."""
    killed_at: float | None = None
    """Then the host dies as by SIGKILL: nothing of it reaches the bus any more [s]."""
    resumed_after: float | None = None
    """Another run resumes it after so large a share of its recording, or where the host died; None: none does."""

    @property
    def disturbed(self) -> bool:
        """Something goes wrong, or a person stops the robot."""
        return bool(self.faults) or any(act["do"] in ("quickstop", "end") for act in self.operator)

    @property
    def kinds(self) -> tuple[str, ...]:
        """The steps and words of its mission, and what is special in them."""
        found = list(steps_in(self.mission["steps"]))
        follows = [body for _, word, body in found if word == "follow"]
        measures = ("measure" for _, word, body in found if word == "calibrate" and "from_pot" not in str(body))
        backwards = ("backwards" for body in follows if body.get("from_end") or body.get("direction") == "backward")
        sees = ["scanners"] if self.world else []
        return tuple(dict.fromkeys([*(word for _, word, _ in found), *measures, *backwards, *sees]))

    @property
    def faults(self) -> Sequence[dict[str, Any]]:
        """What goes wrong, as in a mission file."""
        given: Sequence[dict[str, Any]] = self.mission["simulation"]["faults"]
        return given

    @property
    def operator(self) -> Sequence[dict[str, Any]]:
        """What the operator does, as in a mission file."""
        given: Sequence[dict[str, Any]] = self.mission["simulation"]["operator"]
        return given

    @property
    def world(self) -> dict[str, Any]:
        """What stands and walks around a robot with scanners, as in a mission file; else nothing."""
        return dict(self.mission["simulation"].get("world", {}))

    @property
    def longest(self) -> float:
        """A run that takes longer than this does not end [s]."""
        acts = [entry["at_s"] for entry in (*self.faults, *self.operator)]
        return max(acts, default=0.0) + GRACE + (WAITS if self.world else 0.0) + 75.0

    def write(self, folder: Path, robot: bytes) -> Path:
        """Lay the mission out in `folder`, with the robot file's content; its path."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "robot.yaml").write_bytes(robot)
        for name, text in self.files.items():
            (folder / name).write_text(text)
        path = folder / MISSION
        path.write_text(json.dumps(self.mission, indent=1) + "\n")  # JSON is YAML, too
        return path


def scenario(seed: int, robot: RobotFile) -> Scenario:
    """The scenario of a seed for a robot: always the same, until something is added here or to the injections."""
    dice = random.Random(seed)
    draw = dice.choices((_follow, _teleop, _tree, _calibrate), (36, 30, 30, 4))[0]
    tick_hz = dice.choice((50, 50, 50, 50, 50, 50, 25, 40, 80, 100))
    if 1000 % tick_hz and any(drive.interpolates for drive in robot.drives.values()):
        tick_hz = 50  # they are told the period in whole milliseconds
    steps, files, inputs, length = draw(dice, robot)
    words = {word for _, word, _ in steps_in(steps)}
    sound = dice.uniform(0, 1) < (0.36 if draw is _tree else 0.05)  # its resumed run is compared with the whole one
    faults = [] if sound else _faults(dice, robot, length, _fitting(robot, words), _CAUGHT.findall(json.dumps(steps)))
    operator = [] if sound else _operator(dice, [fault["at_s"] for fault in faults], length)
    if "ask" in words and dice.uniform(0, 1) < 0.7:
        operator = sorted([*operator, *_answers(dice, length)], key=lambda act: float(act["at_s"]))
    mission = {
        "mission": f"seed-{seed}",
        "robot": "robot.yaml",
        "bus": "simulation",
        "tick_hz": tick_hz,
        "inputs": inputs,
        "steps": steps,
        **({"parts": PARTS} if "call" in words else {}),
        "recovery": _recovery(dice),
        "simulation": {
            "seed": dice.randrange(1 << 32),
            "pace": "fast",
            "true_robot": _true_robot(dice, robot),
            "operator": operator,
            "faults": faults,
        },
    }
    if not robot.has_potentiometers:
        mission = json.loads(json.dumps(mission).replace('"from_potentiometers"', '"align"'))
    killed = round(dice.uniform(0.0, length + 1.0), 4) if dice.uniform(0, 1) < 0.06 else None
    besides(seed, mission, files, length)
    found = Scenario(seed=seed, mission=mission, files=files, killed_at=killed, resumed_after=round(dice.random(), 6))
    return _among_things(found, robot, length) if robot.scanners else found


def sees(seed: int) -> bool:
    """Whether a seed is of a robot with scanners, where the campaign has one."""
    return random.Random(f"sees {seed}").random() < SEEING


def _among_things(given: Scenario, robot: RobotFile, length: float) -> Scenario:
    """The same mission among what stands and walks, with faults of the scanners."""
    dice = random.Random(f"things {given.seed}")
    simulation = given.mission["simulation"]
    heading = math.radians(simulation["true_robot"]["heading_deg"])
    of_scanners = [
        _of_scanner(dice, round(dice.uniform(_first_step(robot), length), 4)) for _ in range(dice.choice((0, 1, 1, 2)))
    ]
    faults = [*(given.faults if dice.random() < 0.4 else ()), *of_scanners]
    mission = {
        **given.mission,
        "obstacles": {
            "mode": dice.choice(("stop", "stop", "stop", "slow")),
            "blocked_after_s": round(dice.uniform(0.5, 5.0), 2),
            "margin_m": dice.choice((0.08, round(dice.uniform(0.05, 0.15), 3))),
            "unseen_reverse": dice.choice(("refused", "refused", "allowed")),
        },
        "simulation": {
            **simulation,
            "faults": sorted(faults, key=lambda fault: float(fault["at_s"])),
            "world": SceneryDice(dice, robot, heading).drawn(length),
        },
    }
    return replace(given, mission=mission)


def _of_scanner(dice: random.Random, at: float) -> dict[str, Any]:
    id = dice.choice(OF_SCANNERS)
    lasts = round(dice.choice((dice.uniform(0.02, 0.3), dice.uniform(0.3, 2.5))), 3)  # a lost one may be waited for
    fault: dict[str, Any] = {"at_s": at, "inject": id, "duration_s": lasts}
    match id:
        case "LAS-01":
            fault["how"] = dice.choice(("unplugged", "silent"))
        case "LAS-03":
            fault |= {"how": dice.choice(("rubbish", "cut", "bit", "lost")), "share": round(dice.uniform(0.1, 1.0), 2)}
        case "LAS-04":
            fault["bytes"] = dice.choice((1, 7, 100))
        case "LAS-05":
            fault["status"] = dice.choice(("dirty", "too dirty", "error"))
        case "LAS-06" if dice.random() < 0.5:
            first = round(dice.uniform(-135.0, 100.0), 1)
            fault["sector_deg"] = [first, round(first + dice.uniform(1.0, 90.0), 1)]
        case "LAS-07":
            fault["seconds"] = round(dice.choice((dice.uniform(0.02, 0.15), dice.uniform(0.15, 0.8))), 3)
            fault["within_s"] = round(dice.choice((0.0, dice.uniform(0.5, 3.0))), 2)
    return fault


def _first_step(robot: RobotFile) -> float:
    """`BRING_UP` of this robot [s]."""
    resets, stops = any(drive.tables.forgets for drive in robot.drives.values()), robot.angle_source("left")
    return BRING_UP + RESET * resets + _edges(robot) + STOPS * isinstance(stops, HardStop)


def _edges(robot: RobotFile) -> float:
    """So much longer each alignment takes [s]."""
    return EDGES * any(drive.tables.analog_step is not None for drive in robot.drives.values())


def _recovery(dice: random.Random) -> dict[str, dict[str, str]]:
    """Some missions go on by themselves after whatever may recover by itself."""
    if dice.uniform(0, 1) < 0.85:
        return {}
    automatic = (id for id, row in ROWS.items() if row.recovery.kind is Kind.AUTOMATIC)
    return {id: {"resume": "continue"} for id in automatic if ROWS[id].found in WATCHED}


def _true_robot(dice: random.Random, robot: RobotFile) -> dict[str, float]:
    """A machine that is not quite as its file says, but sound."""
    steered, driven = robot.sides("steering"), robot.sides("traction")
    return {
        **{f"steering_zero_{side}_deg": round(dice.uniform(-0.5, 0.5), 2) for side in steered},
        **{f"wheel_scale_{side}": round(dice.uniform(0.99, 1.01), 4) for side in driven},
        "potentiometer_noise_v": round(dice.uniform(0.0, 0.004), 4),
        "slip": round(dice.uniform(0.0, 0.02), 3),
        **{f"start_steering_{side}_deg": round(dice.uniform(-20.0, 20.0), 1) for side in steered},
        "heading_deg": round(dice.uniform(-180.0, 180.0), 1),
    }


# ---------------------------------------------------------------------------------------------- what the robot shall do

Part = tuple[list[dict[str, Any]], dict[str, str], dict[str, Any], float]
"""Steps, files, inputs, and about how long the run takes [s]."""


def _tree(dice: random.Random, robot: RobotFile) -> Part:
    """Words around a path, and maybe ahead beyond its end."""
    bend = dice.choice((0.0, 0.0, -1.0, 1.0)) * dice.uniform(0.1, 0.3)
    speed = min(round(dice.uniform(0.3, 0.6), 2), robot.limits.speed_m_s)
    drawn = TreeDice(dice, robot, speed, dice.sample(_fitting(robot, {"follow"}), 2))
    steps, table = drawn.mission(), shapes.table(shapes.sampled(lambda distance: bend, LENGTH))
    return steps, {"path.csv": table}, {}, _first_step(robot) + 2.0 + _edges(robot) + drawn.seconds


def _calibrate(dice: random.Random, robot: RobotFile) -> Part:
    """One wheel's angle is measured, or gains are tried, where all drives have such without unit."""
    side, other = dice.sample(OWN_SIDES, 2)
    wheel = robot.drive_at("steering", side)[1].side
    tried = all(drive.family in ("epos1", "epos2") for drive in robot.drives.values())
    if (robot.has_potentiometers and dice.uniform(0, 1) < 0.4) or not tried:
        words = {"wheels": wheel, "reference_deg": {wheel: round(dice.uniform(-1.0, 1.0), 1)}}
        return [{"calibrate": {"steering": words}}], {}, {}, _first_step(robot) + 17.0
    steering, traction = robot.drive_at("steering", other)[0], robot.drive_at("traction", side)[0]
    gains = {steering: {"position": [160, 10, 210]}, traction: {"velocity": [900, 110]}}
    turn = {"turn": {"side": wheel, "angle_deg": round(dice.uniform(1.0, 6.0), 1)}}
    return [{"calibrate": step} for step in ({"gains": gains}, turn)], {}, {}, _first_step(robot) + 9.0


def _follow(dice: random.Random, robot: RobotFile) -> Part:
    drawn = (*3 * [shapes.straight], *2 * [shapes.arc], shapes.slalom, shapes.eight, shapes.circle)
    shape = dice.choice(drawn)
    points, speed, laps, length = shape(dice)
    mirrored = -1.0 if shape is not shapes.circle and dice.uniform(0, 1) < 0.1 else 1.0
    table = shapes.table([(mirrored * x, y) for x, y in points])
    path, speed = path_from_csv(table, "path.csv"), min(speed, robot.limits.speed_m_s)
    while check_drivable(path, robot, speed) and speed > SLOWEST:
        speed = round(0.75 * speed, 3)
    follow: dict[str, Any] = {"path": "path.csv", "follower": {"plugin": "indiveri", "speed_m_s": speed}, "laps": laps}
    steps: list[dict[str, Any]] = [ALIGN, {"follow": follow}]
    if mirrored < 0.0:
        follow["direction"] = "backward"
    elif laps * length < 1.5 and dice.uniform(0, 1) < 0.15:
        steps.append({"follow": {**follow, "from_end": True}})
        laps += 1
    if dice.uniform(0, 1) < 0.1:
        steps.insert(1, {"wait": {"seconds": round(dice.uniform(0.1, 1.0), 2)}})
    return steps, {"path.csv": table}, {}, _first_step(robot) + 3.0 + _edges(robot) + laps * length / speed


def _teleop(dice: random.Random, robot: RobotFile) -> Part:
    """A person at a stick; rows: time, x to the right, y ahead, enable button."""
    time = begin = _first_step(robot)
    rows: list[tuple[float, float, float, int]] = [(0.0, 0.0, 0.0, 0)]
    y = dice.choice((-1, 1, 1, 1)) * dice.uniform(0.2, 1.0)
    for _ in range(dice.randint(1, 4)):
        time += dice.uniform(0.3, 1.5)
        x = dice.uniform(-0.5, 0.5) if dice.uniform(0, 1) < 0.6 else 0.0
        rows.append((time, x, y, 1 if dice.uniform(0, 1) < 0.9 else 0))
        y = max(-1.0, min(1.0, y + dice.uniform(-0.9, 0.9)))
    time += dice.uniform(0.5, 2.0)
    rows.append((time, 0.0, 0.0, 0))
    if dice.uniform(0, 1) < 0.3:  # the person drives on after a stop
        rows += [(time + 5.0, 0.0, 0.5, 1), (time + 7.0, 0.0, 0.0, 0)]
    rows.append((rows[-1][0] + 1.0, 0.0, 0.0, 0))
    table = "time_s,x,y,enable\n" + "".join(f"{t:.3f},{x:.3f},{y:.3f},{on}\n" for t, x, y, on in rows)
    stick: dict[str, Any] = {"plugin": "scripted", "file": "stick.csv"}
    if dice.uniform(0, 1) < 0.4:
        stick["max_speed_m_s"] = round(dice.uniform(0.3, 1.0) * robot.limits.speed_m_s, 2)
    teleop = {"input": "stick", "until": {"seconds": round(rows[-1][0] - begin, 2)}}
    return [{"teleop": teleop}], {"stick.csv": table}, {"stick": stick}, rows[-1][0]


# ---------------------------------------------------------------------------------------------- what goes wrong


def _faults(
    dice: random.Random, robot: RobotFile, length: float, fitting: Sequence[str], caught: Sequence[str]
) -> list[dict[str, Any]]:
    """In all phases of the run; more than one may be there at once; those that a `try` names more often."""
    number, begin = dice.choices((0, 1, 2, 3, 4), (12, 48, 22, 12, 6))[0], _first_step(robot)
    faults: list[dict[str, Any]] = []
    for _ in range(number):
        phase, last = dice.uniform(0, 1), faults[-1]["at_s"] if faults else 0.0
        if faults and phase < 0.4:
            at = last + dice.uniform(0.0, 0.6)
        elif phase < 0.25:
            at = dice.choice((0.0, dice.uniform(0.0, begin)))
        elif phase < 0.35:
            at = length + dice.uniform(-1.0, 2.0)  # at the end
        else:
            at = dice.uniform(begin, length)
        likely = caught if caught and dice.uniform(0, 1) < 0.5 else fitting
        faults.append(_fault(dice, robot, dice.choice(likely), round(at, 4)))
    return sorted(faults, key=lambda fault: fault["at_s"])


def _nodes(robot: RobotFile, id: str) -> list[str]:
    """Drives to which an injection can happen; of one that happens to none, all."""
    injection = INJECTIONS[id]
    roles = _ROLES.get(injection.needs, ("traction", "steering"))
    fitting = [(name, drive) for name, drive in robot.drives.items() if drive.role in roles]
    return [name for name, drive in fitting if injection.families is None or drive.family in injection.families]


def _fitting(robot: RobotFile, words: Set[str]) -> list[str]:
    """Injections that can happen to this robot, in a mission with these steps and words."""
    general = [id for id in INJECTIONS if id not in NOT_DRAWN and id not in OF_SCANNERS and _nodes(robot, id)]
    drawn = [id for id in general if shows_on(id, robot) and (not id.startswith("INP") or "teleop" in words)]
    return [id for id in drawn if not id.startswith(_PLUGIN) or words & {"follow", "approach"}]


def _fault(dice: random.Random, robot: RobotFile, id: str, at: float) -> dict[str, Any]:
    injection = INJECTIONS[id]
    fault: dict[str, Any] = {"at_s": at, "inject": id}
    if injection.needs in _ROLES:
        fault["node"] = dice.choice(_nodes(robot, id))
    keys = injection.parameters.model_fields
    ends = id.startswith(ENDING) or dice.uniform(0, 1) < 0.5
    if issubclass(injection.parameters, Lasting) and ends:
        fault["duration_s"] = round(dice.choice((dice.uniform(0.02, 0.3), dice.uniform(0.3, 2.5))), 3)
    if "count" in keys and dice.uniform(0, 1) < 0.3:
        fault["count"] = dice.randint(1, 8)
    if "seconds" in keys:
        fault["seconds"] = round(dice.choice((dice.uniform(0.02, 0.2), dice.uniform(0.2, 1.5))), 3)
    if id == "COM-25" and "duration_s" in fault:
        fault["times"] = None
    if "heard" in keys and dice.uniform(0, 1) < 0.25:
        fault["heard"] = False
    return fault


# ---------------------------------------------------------------------------------------------- who helps


def _operator(dice: random.Random, times: Sequence[float], length: float) -> list[dict[str, Any]]:
    """Nobody, or somebody who acknowledges and arms when it suits, and may stop or end the run."""
    acts: list[tuple[float, str]] = []
    if dice.uniform(0, 1) < 0.55:
        for time in (*times[:2], *([dice.uniform(0.0, length)] if dice.uniform(0, 1) < 0.2 else [])):
            acknowledged = time + dice.uniform(0.3, 4.0)
            armed = acknowledged + dice.uniform(0.1, 3.0)
            acts += [(acknowledged, "acknowledge"), (armed, "arm")]
            if dice.uniform(0, 1) < 0.4:  # patient people succeed
                acts += [(armed + 2.5, "acknowledge"), (armed + 5.5, "arm")]
    if dice.uniform(0, 1) < 0.12:
        acts.append((dice.uniform(0.0, length), "quickstop"))
    if dice.uniform(0, 1) < 0.08:
        acts.append((dice.uniform(0.0, length), "end"))
    return [{"at_s": round(time, 4), "do": what} for time, what in sorted(acts)]


def _answers(dice: random.Random, length: float) -> list[dict[str, Any]]:
    """Somebody gives the same answer all the time, also if a run is resumed at once, or takes twice as long."""
    number, answer = round(4.0 * (length + 5.0)), dice.choice(ANSWERS)
    return [{"at_s": 0.5 * index, "do": "answer", "answer": answer} for index in range(1, number + 1)]
