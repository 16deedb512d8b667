"""Small fixed scenarios on which bugs are planted; each is clean when nothing is."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

from artemis_lab.campaign.one_run import Result, run_scenario
from artemis_lab.campaign.scenario import Scenario

ROBOTS = Path(__file__).parents[2] / "missions" / "robots"
ROBOT, SEEING, OF_EPOS4, OF_CIA402 = (ROBOTS / f"artemis{which}.yaml" for which in ("", "_lms100", "_epos4", "_cia402"))
REAR_DRIVEN, SMALL_CAR = ROBOTS / "rear_driven.yaml", ROBOTS / "small_car.yaml"
LONGEST = 60.0
"""A run that takes longer does not end [s]: a planted bug need not be watched for as long as a campaign's seed."""
Faults = Sequence[dict[str, Any]]
Acts = Sequence[tuple[float, str]]
TRUE_ROBOT: dict[str, float] = {"potentiometer_noise_v": 0.002, "slip": 0.005}


ALIGN: dict[str, Any] = {"calibrate": {"steering": "from_potentiometers"}}
FOLLOW: dict[str, Any] = {"follow": {"path": "path.csv", "follower": {"plugin": "indiveri", "speed_m_s": 0.4}}}
FOLLOW_BACK = {"follow": {**FOLLOW["follow"], "from_end": True}}


def run(given: Scenario, robot: Path = ROBOT, *, replayed: bool = False) -> Result:
    """In a folder that is gone afterwards."""
    with tempfile.TemporaryDirectory() as folder, patch.object(Scenario, "longest", LONGEST):
        robot = SEEING if given.world else robot
        return run_scenario(given, robot.read_bytes(), Path(folder), replayed=replayed)


def _scenario(
    steps: list[dict[str, Any]],
    files: dict[str, str],
    faults: Faults,
    acts: Acts,
    *,
    killed_at: float | None = None,
    tick_hz: float = 50,
    inputs: dict[str, Any] | None = None,
    **true_robot: float,
) -> Scenario:
    mission = {
        "mission": "staged",
        "robot": "robot.yaml",
        "bus": "simulation",
        "tick_hz": tick_hz,
        "inputs": inputs or {},
        "steps": steps,
        "simulation": {
            "seed": 1,
            "true_robot": {**TRUE_ROBOT, **true_robot},
            "operator": [{"at_s": time, "do": what} for time, what in acts],
            "faults": list(faults),
        },
    }
    return Scenario(seed=1, mission=mission, files=files, killed_at=killed_at)


def drive(
    *faults: dict[str, Any],
    acts: Acts = (),
    rows: str = "",
    seconds: float = 3.5,
    pushed_from: float = 5.0,
    top: float = 0.4,
    **keys: float,
) -> Scenario:
    """By hand, from 5 s straight ahead with `top` [m/s], the button released at 7 s; `rows` more of the stick."""
    table = f"time_s,x,y,enable\n0,0,0,0\n{pushed_from},0,1,1\n7,0,1,0\n7.5,0,0,0\n{rows}60,0,0,0\n"
    stick = {"stick": {"plugin": "scripted", "file": "stick.csv", "max_speed_m_s": top}}
    steps = [{"teleop": {"input": "stick", "until": {"seconds": seconds}}}]
    return _scenario(steps, {"stick.csv": table}, faults, acts, inputs=stick, **keys)


def follow(*faults: dict[str, Any], acts: Acts = (), bend: float = 0.0) -> Scenario:
    """Along 1 m of a straight line, or 2 m with a bend of this curvature [1/m], from 7.3 s on, with 0.4 m/s."""
    table = "x,y\n" + "".join(f"{x:.5f},{y:.5f}\n" for x, y in _line(bend))
    return _scenario([ALIGN, FOLLOW], {"path.csv": table}, faults, acts)


LATE: dict[str, Any] = {"wait": {"for": "run_s > 1000", "at_most_s": 0.3}}
WAIT: dict[str, Any] = {"wait": {"seconds": 0.3}}
WORDS: list[dict[str, Any]] = [
    {"during": {"steps": [FOLLOW], "when": [{"if": "driven_m > 0.3", "steps": [{"say": "far"}, WAIT]}]}},
    {"repeat": {"times": 2, "steps": [{"try": {"steps": [LATE], "catch": {"any": [WAIT]}}}]}},
    {"together": {"steps": [FOLLOW_BACK], "beside": [{"wait": {"for": "run_s > 1000"}}]}},
]


def compose(*faults: dict[str, Any], resumed_after: float | None = None, acts: Acts = ()) -> Scenario:
    """Words around a path, there (from 7.3 s on, with a break at 0.3 m) and back."""
    table = "x,y\n" + "".join(f"{x:.5f},{y:.5f}\n" for x, y in _line(0.0))
    return replace(_scenario([ALIGN, *WORDS], {"path.csv": table}, faults, acts), resumed_after=resumed_after)


def approach(*faults: dict[str, Any], acts: Acts = ()) -> Scenario:
    """Ahead for 0.8 m by a behaviour, from 7.3 s on, with 0.4 m/s."""
    step = {"approach": {"until": "driven_m > 0.8", "at_most_m": 2.0, "speed_m_s": 0.4}}
    return _scenario([ALIGN, step], {}, faults, acts)


def among(
    things: dict[str, Any],
    *faults: dict[str, Any],
    steps: Sequence[dict[str, Any]] = (),
    mode: str = "stop",
    **keys: object,
) -> Scenario:
    """Along 2 m, or some steps, from 7.3 s on, with a scanner in a hall with these things in it."""
    walls = [{"points": [[-3, -3], [6, -3], [6, 3], [-3, 3], [-3, -3]]}]
    given = _scenario([ALIGN, *(steps or [_ahead(2.0, 0.6)])], {}, faults, ())
    simulation = {**given.mission["simulation"], "world": {"walls": walls, **things}}
    rules = {"mode": mode, "blocked_after_s": 1.0, **keys}
    return replace(given, mission={**given.mission, "obstacles": rules, "simulation": simulation})


def _ahead(distance: float, speed: float, **keys: object) -> dict[str, Any]:
    """Follow a straight line; backwards for a negative distance [m]."""
    backwards = {"direction": "backward"} if distance < 0.0 else {}
    path = {"waypoints": [[0, 0], [distance, 0]]}
    return {"follow": {"path": path, "follower": {"speed_m_s": speed}, **backwards, **keys}}


def measure(*faults: dict[str, Any], new: bool = False, **true_robot: float) -> Scenario:
    """The steering is calibrated, and the drives keep it."""
    reference = {"left": 7.0, "right": -4.0} if new else {"left": 0.8, "right": -1.3}
    words = {"potentiometers": "new" if new else "known", "reference_deg": reference, "save": "drives"}
    hidden = {"steering_zero_left_deg": 0.8, "steering_zero_right_deg": -1.3, **true_robot}
    return _scenario([{"calibrate": {"steering": words}}], {}, faults, (), inputs=None, **hidden)


def _line(bend: float) -> list[tuple[float, float]]:
    """Straight, or into a bend, through it and out of it."""
    length, step = (2.0, 0.02) if bend else (1.0, 0.02)
    x = y = heading = 0.0
    points = [(x, y)]
    for number in range(round(length / step)):
        distance = (number + 0.5) * step
        heading += bend * min(1.0, distance / 0.6, (length - distance) / 0.6) * step
        x, y = x + step * math.cos(heading), y + step * math.sin(heading)
        points.append((x, y))
    return points


def fault(id: str, at: float = 6.5, node: str | None = None, **options: object) -> dict[str, Any]:
    """An injection."""
    return {"at_s": at, "inject": id, **({"node": node} if node else {}), **options}


POST: dict[str, Any] = {"x_m": 2.2, "y_m": 0.05, "diameter_m": 0.1}
LEFT, RIGHT, STEER = "traction-left", "traction-right", "steer-left"
AGAIN = "13.5,0,1,1\n15,0,0,0\n"
"""The stick is pushed once more."""

SCENARIOS: dict[str, Scenario] = {
    "by hand": drive(),
    "path": follow(),
    "bend": follow(bend=1.0),
    "slight bend": follow(bend=0.45),
    "over-current, acknowledged and armed": drive(
        fault("DRV-02", node=LEFT), acts=[(8.0, "acknowledge"), (9.8, "arm")], rows=AGAIN, seconds=6.0
    ),
    "over-current, acknowledged only": drive(
        fault("DRV-02", node=LEFT), acts=[(8.0, "acknowledge"), (16.0, "end")], rows=AGAIN, seconds=6.0
    ),
    "over-current, not acknowledged": drive(fault("DRV-02", node=LEFT), acts=[(16.0, "end")]),
    "limit switch": drive(fault("DRV-26", node=RIGHT)),
    "unknown error": drive(fault("DRV-31", node=STEER)),
    "error unheard": drive(fault("DRV-08", node=RIGHT, heard=False)),
    "collision unheard": drive(fault("DRV-21", node=RIGHT, heard=False)),
    "sensor supply, acknowledged": drive(fault("DRV-05", node=LEFT), acts=[(8.0, "acknowledge"), (10.0, "end")]),
    "silent drive": drive(fault("COM-11", node=STEER)),
    "no heartbeat": drive(fault("COM-28", node=RIGHT)),
    "restarted": drive(fault("COM-26", node=LEFT)),
    "pre-operational": drive(fault("COM-27", node=RIGHT)),
    "off by itself": drive(fault("COM-02", node=RIGHT)),
    "second master": drive(fault("COM-17", node=RIGHT)),
    "unplugged": drive(fault("COM-22")),
    "silent bus": drive(fault("COM-29")),
    "runaway": drive(fault("RUN-01", node=LEFT)),
    "last set-points lost": drive(fault("COM-12", 7.37), acts=[(14.0, "end")], seconds=8.0),
    "slipping": drive(fault("RUN-05", node=LEFT)),
    "slipping at full speed": drive(fault("RUN-05", node=LEFT), top=0.7),
    "potentiometer off": drive(fault("STE-03", node=STEER)),
    "potentiometer open": drive(fault("STE-04", node=STEER)),
    "frozen stick": drive(fault("INP-03", duration_s=6.0)),
    "stick frozen again and again": drive(
        *(fault("INP-03", at, duration_s=0.4) for at in (8.0, 10.0, 12.0, 14.0)),
        acts=[(9.5, "arm"), (11.5, "arm"), (13.5, "arm"), (16.0, "end")],
        seconds=20.0,
    ),
    "without power in a bend, acknowledged": drive(
        fault("SYS-09", 10.5),
        acts=[(13.6, "acknowledge"), (17.0, "end")],
        rows="9,0,1,1\n9.5,0.6,1,1\n15,0,0,0\n",
        seconds=8.0,
    ),
    "stopped by a person": drive(acts=[(6.5, "quickstop"), (9.0, "arm")], rows="9.5,0,1,1\n10.5,0,0,0\n", seconds=5.0),
    "stopped, acknowledged only": drive(
        acts=[(6.5, "quickstop"), (8.0, "acknowledge"), (12.0, "end")], rows="9.5,0,1,1\n11,0,0,0\n", seconds=8.0
    ),
    "stopped while the wheels are aligned": follow(acts=[(6.6, "quickstop"), (8.0, "arm")]),
    "stopped while the watchdog is proven": drive(acts=[(0.77, "quickstop"), (3.0, "acknowledge"), (4.0, "end")]),
    "stick held at the start": drive(pushed_from=3.0, seconds=1.0),
    "computer asleep": drive(fault("SYS-03", seconds=0.7)),
    "computer dozes at the start": drive(fault("SYS-03", 0.0, seconds=0.15), acts=[(6.5, "end")]),
    "computer dozes": drive(fault("SYS-03", seconds=0.15)),
    "input takes long": drive(
        fault("PLG-04", 10.1, input="stick", seconds=0.05), rows="9,0,1,1\n10,-1,1,1\n12,0,0,0\n", seconds=8.0
    ),
    "runaway while it slows down": drive(fault("RUN-01", 7.0, LEFT), top=0.5),
    "stick lost before the start": drive(fault("INP-01", 0.0, duration_s=0.1)),
    "killed before it can notice": drive(fault("COM-11", node=STEER), killed_at=6.55),
    "follower late": follow(fault("PLG-03", 8.5, seconds=0.07)),
    "acknowledged while the computer stands still": follow(
        fault("PTH-09", 8.5, seconds=0.45), acts=[(8.7, "acknowledge"), (12.0, "arm")]
    ),
    "button stuck while the computer stands still": follow(fault("OPR-02", 8.0), fault("PTH-09", 8.6, seconds=0.45)),
    "counter near its end": drive(
        fault("RUN-09", 0.0, STEER),
        acts=[(5.0, "acknowledge"), (8.5, "arm")],
        rows="13,-1,1,1\n15,0,0,0\n",
        seconds=6.0,
    ),
    "killed": drive(killed_at=6.5),
    "killed, and resumed": replace(compose(), killed_at=9.5, resumed_after=0.0),
    "program fails between two ticks": drive(fault("SYS-04", 4.1707), tick_hz=40),
    "program fails just before a tick": drive(fault("SYS-04", 6.5199)),
    "follower raises": follow(fault("PLG-02", 8.5)),
    "follower asks for too much": follow(fault("RUN-12", 8.0, duration_s=1.2), bend=1.0),
    "follower steers too far": follow(
        fault("RUN-12", 8.0, speed_m_s=0.15, steering_deg=85.0, duration_s=2.8), bend=1.0
    ),
    "another product": drive(fault("COM-33", 0.0, STEER, answers="another product")),
    "does not watch": drive(fault("COM-30", 0.0, STEER)),
    "write not kept": drive(fault("COM-10", 0.0, LEFT)),
    "write not kept, and not needed": drive(fault("COM-10", 0.0, STEER)),
    "follower steers too far at the end of the path": follow(fault("RUN-12", 9.6, duration_s=2.0)),
    "error in bring-up": drive(fault("DRV-02", 0.42, LEFT)),
    "damaged EMCY while it is enabled": drive(fault("DRV-32", 2.904, STEER)),
    "another mode shown while it is enabled": drive(fault("COM-04", 2.892, STEER)),
    "collision while it is enabled": drive(fault("DRV-21", 2.904, STEER)),
    "stick lost while the step ends": drive(fault("INP-04", 6.55), top=0.7, seconds=2.4),
    "steering measured": measure(),
    "new potentiometers measured": measure(new=True, steering_zero_left_deg=25.0, steering_zero_right_deg=-30.0),
    "wheel blocked while it is measured": measure(fault("STE-02", 10.0, STEER)),
    "drive lost while it is measured": measure(fault("COM-26", 10.0, STEER)),
    "another calibration in a drive": drive(fault("CAL-02", 0.0, STEER)),
    "driven by somebody else before the bring-up": drive(
        fault("EST-01", 0.0, duration_s=1.9), fault("SYS-10", 4.0, RIGHT), acts=[(2.3, "acknowledge"), (6.0, "end")]
    ),
    "unresponsive on a slope": follow(
        fault("RUN-02", 10.1), fault("COM-27", 10.4, "steer-right"), acts=[(15.0, "acknowledge"), (17.0, "end")]
    ),
    "two lost together": drive(
        fault("COM-28", node=RIGHT, duration_s=1.5),
        fault("COM-28", 6.53, "steer-right", duration_s=0.3),
        acts=[(12.0, "end")],
        seconds=9.0,
    ),
    "words": compose(),
    "words, resumed while the wheels are aligned": compose(resumed_after=0.3),
    "words, resumed after the break": compose(resumed_after=0.54),
    "words, resumed in the second round": compose(resumed_after=0.7),
    "words, resumed on the way back": compose(resumed_after=0.8),
    "words, resumed after a fault": compose(
        fault("DRV-25", 8.0, STEER), acts=[(9.0, "acknowledge"), (11.0, "arm")], resumed_after=0.66
    ),
    "behaviour": approach(),
    "wheels freed in a stop": approach(
        fault("PTH-07", 8.28, duration_s=0.16), acts=[(8.35, "quickstop"), (10.0, "arm"), (20.0, "end")]
    ),
    "behaviour raises": approach(fault("PLG-02", 8.5)),
    "behaviour answers with rubbish": approach(fault("PLG-06", 8.5)),
    "behaviour late": approach(fault("PTH-09", 8.5, seconds=0.05)),
    "behaviour asks for no number": approach(fault("RUN-11", 8.5)),
    "drive fault under a behaviour": approach(
        fault("DRV-02", 8.5, LEFT), acts=[(10.0, "acknowledge"), (13.0, "arm"), (20.0, "end")]
    ),
    "post in the way": among({"poles": [POST]}),
    "post beside the path": among({"poles": [{**POST, "y_m": 0.24}]}),
    "post in the way of a robot that creeps": among({"poles": [POST]}, mode="slow"),
    "post that is taken away": among({"poles": [{**POST, "until_s": 14.0}]}, blocked_after_s=10.0),
    "wall in the way": among({"walls": [{"points": [[2.1, -2], [2.4, 2]]}]}),
    "wall in the way, late scans": among(
        {"walls": [{"points": [[3.0, -2], [3.0, 2]]}]},
        fault("LAS-07", 11.5, seconds=0.14),
        steps=[_ahead(3.0, 0.7)],
        margin_m=0.03,
        clear_m=0.03,
    ),
    "box behind": among(
        {"boxes": [{"x_m": -0.65, "y_m": 0.0, "length_m": 0.3, "width_m": 1.5}]}, steps=[_ahead(-0.8, 0.3)]
    ),
    "person in the way": among({"persons": [{"path": [[7, 2.2, 2.0], [9.5, 2.2, 0.0]]}]}),
    "nothing in the way": among({}),
    "scanner unplugged": among({}, fault("LAS-01", 8.5)),
    "scanner silent": among({}, fault("LAS-01", 8.5, how="silent")),
    "scanner frozen": among({"poles": [POST]}, fault("LAS-02", 8.5)),
    "scanner covered": among({}, fault("LAS-06", 8.5)),
    "scanner ill": among({}, fault("LAS-05", 8.5)),
    "askew": drive(start_steering_left_deg=20.0, start_steering_right_deg=15.0),
}
"""By what happens."""
