"""What a page gets of a run, from its ticks: numbers at the page's rate, other values only when they change."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from math import hypot
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from artemis.drive_states import DriveState
from artemis.motion.ackermann import Ackermann
from artemis.motion.planned_route import route_poses
from artemis.motion.route import Route
from artemis.recording.event_log import EventLog
from artemis.recording.journal import Entry, Level
from artemis.report.fault_words import explained_now
from artemis.report.mission_boxes import Box, boxes_of
from artemis.report.mission_times import MissionTimes
from artemis.scan import Scan
from artemis.states.outline import numbered
from artemis.states.requests import by_hand
from artemis.values import Fault, JobKind, JobResult, LocatedPose, Mode, Request, Tick
from artemis.vehicle import RobotFile
from artemis.yaml_file import dotted

if TYPE_CHECKING:
    from artemis.mapping.occupancy import ShownMap

TRAIL_STEP, MOST_TRAIL = 0.05, 6000
"""Distance of the points at which the driven path is kept [m], and their highest number."""
HISTORY_EVERY, MOST_HISTORY = 0.2, 3000
"""Interval at which time series are kept [s], and their highest number of values: ten minutes."""
MOST_BEAMS = 360
PATH_STEP = 0.05
DETAILS = {"job", "result", "phase", "frames", "verdict"}
"""Kinds of journal entries that are not shown unless something is wrong: their content is shown elsewhere."""
SERIES = ("time", "speed", "wished", "steering", "cross_track", "battery", "late")
"""Columns of the time series, before the drives' currents."""

Part = dict[str, Any]


class PageView:
    """Sees every tick; `state` and the versioned parts are for senders."""

    def __init__(
        self,
        robot: RobotFile,
        mission: Mapping[str, Any],
        routes: Mapping[int, Route],
        map: Callable[[], ShownMap | None] = lambda: None,
        input: str = "page",
    ) -> None:
        """Begin.

        Args:
            robot: its geometry, drives and scanners.
            mission: in its file's own form; empty: not known.
            routes: the paths of the mission's steps that are known before the run, by the step's number.
            map: the run's map as it is at present, the same object until it changes.
            input: the name of the mission's input over which operators at the page act.
        """
        self._input = input
        self._robot, self._mission, self._routes, self._map = robot, mission, dict(routes), map
        self._events = EventLog({name: drive.node_id for name, drive in robot.drives.items()}, robot.errors)
        self._steering = {robot.drive_at("steering", side)[0]: side for side in robot.sides("steering")}
        self._read = self._steering if robot.has_potentiometers else {}
        self._car = Ackermann(robot.geometry)
        self._shown_map: ShownMap | None = None
        self._faults: tuple[Fault, ...] | None = None
        self._path_of: int | None = None
        self._planned: dict[int, JobResult] = {}
        self._next_history = 0.0
        self._presses = (-1, 0)
        """How often recording of a path was started or ended, and in which step."""
        self._frame = ""
        self._times = MissionTimes(mission)
        self.log: list[Part] = []
        """New lines since the sender took them."""
        self.trail: list[tuple[float, float]] = []
        self.history: list[list[float | None]] = []
        self.parts: dict[str, tuple[int, Any]] = {}
        """The newest of each, with its version."""
        self._put("scan", None)

    # ------------------------------------------------------------------------------------------ once

    def about(self) -> Part:
        """What holds for the whole run."""
        robot, geometry = self._robot, self._robot.geometry
        limits = robot.limits
        outline = robot.outline
        front = outline.front_m if outline else geometry.wheelbase_m + 0.15
        rear = outline.rear_m if outline else 0.15
        half = outline.half_width_m if outline else geometry.track_m / 2 + 0.05
        turn = [self._turn(side) for side in ("left", "right")]
        return {
            "robot": robot.robot,
            "mission": str(self._mission.get("mission", "")),
            "simulated": self._mission.get("bus") == "simulation",
            "outline": [front, rear, half],
            "outline_known": outline is not None,
            "wheelbase": geometry.wheelbase_m,
            "track": geometry.track_m,
            "scrub": geometry.scrub_radius_m,
            "front_wheels": geometry.front_wheels,
            "wheel": max(turn),
            "driven": geometry.driven_axle,
            "limits": [limits.speed_m_s, limits.steering_deg],
            "scanners": {name: [m.x_m, m.y_m, m.heading] for name, m in robot.scanners.items()},
            "drives": [
                {"name": name, "node": drive.node_id, "role": drive.role} for name, drive in robot.drives.items()
            ],
            "steps": self._steps(),
            "acts": self._acts(),
            "series": [*SERIES, *robot.drives],
        }

    def _turn(self, side: str) -> float:
        """Radius of a driven wheel [m]."""
        drive = self._robot.drive_at("traction", side)[1]
        turn = self._robot.metres_per_count(side) * drive.sensor.counts_per_turn * drive.gear_ratio
        return abs(turn) / 6.283185307179586

    def _steps(self) -> Part:
        """The mission as a tree, and the paths in it of the numbered steps."""
        if not self._mission.get("steps"):
            return {"tree": None, "numbered": []}
        paths = [dotted(path) for path, _, _ in self._numbered_steps()]
        return {"tree": _box(boxes_of(self._mission, self._robot)), "numbered": paths}

    def _acts(self) -> Part:
        """What an operator at the page may do in which step, by its number."""
        steps = [
            (number, word, body)
            for number, (_, word, body) in enumerate(self._numbered_steps())
            if isinstance(body, Mapping)
        ]
        inputs = self._mission.get("inputs")
        use = inputs.get(self._input) if isinstance(inputs, Mapping) else None
        return {
            "allow": list((use.get("allow") or ()) if isinstance(use, Mapping) else ()),
            "goals": [
                number for number, word, body in steps if word == "goto" and asked_input(body.get("to")) == self._input
            ],
            "records": [number for number, word, body in steps if word == "teleop" and body.get("record")],
            "questions": {
                number: {"question": body["question"], "answers": list(body["answers"])}
                for number, word, body in steps
                if word == "ask"
            },
        }

    def _numbered_steps(self) -> list[tuple[tuple[str | int, ...], str, Any]]:
        return numbered(self._mission.get("steps") or ())

    # ------------------------------------------------------------------------------------------ each tick

    def see(self, tick: Tick) -> None:
        """Take what is new in a tick."""
        for entry in self._events.observe(tick):
            if is_shown(entry):
                self.log.append(line_of(entry))
        self.show(tick)

    def show(self, tick: Tick) -> None:
        """The same but for the log."""
        snapshot, step = tick.snapshot, self._times.present
        self._times.see(tick)
        if tick.events or self._times.present is not step:
            times = self._times
            self._put("progress", {"marks": times.marks, "counts": times.counts, "before": times.before})
        if snapshot.verdict.faults != self._faults:
            self._faults = snapshot.verdict.faults
            self._put("faults", [_fault(fault) for fault in self._faults])
        for result in snapshot.sensed.results:
            if result.kind is JobKind.PLAN and result.values:
                self._planned[tick.position.step] = result
                self._path_of = None
        self._see_path(tick)
        self._see_presses(tick)
        if snapshot.sensed.scans:
            self._see_scan(snapshot.sensed.scans[-1], snapshot.pose)
        if (shown := self._map()) is not self._shown_map:
            self._shown_map = shown
            self._put("map", None if shown is None else map_part(shown))
        self._see_trail(snapshot.pose)
        if snapshot.time >= self._next_history:
            self._next_history = snapshot.time + HISTORY_EVERY
            self.history.append(self.sample(tick))
            del self.history[:-MOST_HISTORY]

    def sample(self, tick: Tick) -> list[float | None]:
        """A row of the time series."""
        snapshot, tracking = tick.snapshot, tick.wish.tracking
        battery = snapshot.sensed.battery_v
        return [
            round(snapshot.time, 3),
            round(snapshot.odometry.speed, 4),
            round(tick.set_points.speed, 4),
            round(snapshot.odometry.steering, 4),
            None if tracking is None else round(tracking.cross_track, 4),
            None if battery is None else round(battery, 2),
            round(snapshot.sensed.late * 1e3, 2),
            *(None if drive.age is None else round(drive.current, 2) for drive in snapshot.sensed.drives),
        ]

    def state(self, tick: Tick) -> Part:
        """The numbers of a tick."""
        snapshot, position = tick.snapshot, tick.position
        located, drives, free = snapshot.pose, snapshot.sensed.drives, tick.set_points.clearance
        angles = {self._steering[d.name]: d.position for d in drives if d.name in self._steering and d.age is not None}
        if (middle := angles.get("middle")) is not None:  # one motor: all are drawn as the virtual wheel
            angles = dict.fromkeys(("left", "right"), self._car.steering_from_left(middle))
        points = tick.set_points
        tracking = tick.wish.tracking
        return {
            "n": snapshot.sensed.index,
            "mode": tick.mode.value,
            "phase": tick.wish.phase,
            "failed": tick.failed,
            "over": tick.wish.finished,
            "pose": [round(located.pose.x, 4), round(located.pose.y, 4), round(located.pose.heading, 5)],
            "std": _std(located),
            "frame": located.frame,
            "lost": located.lost or (located.source == "odometry" and snapshot.odometry.lost),
            "source": located.source,
            "wheels": [angles.get("left", points.steering_left), angles.get("right", points.steering_right)],
            "wish": [round(points.speed, 4), round(points.steering, 4)],
            "sample": self.sample(tick),
            "step": position.step,
            "done": round(position.done, 2),
            "ran": None if (here := self._times.present) is None else [here.number, round(here.time, 1)],
            "track": None if tracking is None else [round(tracking.arc_length, 2), round(tracking.length, 2)],
            "clear": None
            if free is None
            else [_finite(free.speed), _finite(free.distance), free.blocked, free.no_scan],
            "severity": int(snapshot.verdict.severity),
            "alarm": snapshot.verdict.alarm,
            "distance": round(snapshot.odometry.driven, 2),
            "battery": None if (left := snapshot.battery) is None else [round(left.charge, 3), _finite(left.range_m)],
            "drives": [
                [drive.state.value, drive.state is DriveState.OPERATION_ENABLE, _finite(drive.age), drive.position]
                + ([[round(volts, 3) for volts in drive.potentiometers]] if drive.name in self._read else [])
                for drive in drives
            ],
            "temperatures": [drive.temperature_c for drive in drives],
            "hand": list(by_hand(tick)),
            "presses": self._presses[1] if self._presses[0] == position.step else 0,
            "inputs": [[sample.source, sample.enabled, _finite(sample.age)] for sample in snapshot.sensed.inputs],
        }

    # ------------------------------------------------------------------------------------------ parts

    def _put(self, name: str, content: Any) -> None:  # noqa: ANN401 (JSON)
        version = self.parts[name][0] + 1 if name in self.parts else 1
        self.parts[name] = version, content

    def _see_path(self, tick: Tick) -> None:
        step = tick.position.step
        if step == self._path_of:
            return
        self._path_of = step
        if (planned := self._planned.get(step)) is not None:
            poses = route_poses(planned.values)
        else:
            poses = [] if (route := self._routes.get(step)) is None else list(route.poses(PATH_STEP))
        points = [[round(pose.x, 3), round(pose.y, 3)] for pose in poses]
        self._put("path", {"step": step, "points": points})

    def _see_presses(self, tick: Tick) -> None:
        """Count requests that start or end recording of a path in a step driven by hand."""
        step, (of, presses) = tick.position.step, self._presses
        if tick.mode is Mode.TELEOP:
            asked = sum(Request.RECORD in sample.requests for sample in tick.snapshot.sensed.inputs)
            self._presses = step, presses * (of == step) + asked

    def _see_scan(self, scan: Scan, located: LocatedPose) -> None:
        mounting = self._robot.scanners.get(scan.source)
        if mounting is None or located.lost:
            return
        step = -(-len(scan.millimetres) // MOST_BEAMS)
        ranges = scan.millimetres[::step]
        angles = scan.start_angle + scan.increment * step * np.arange(len(ranges))
        seen = ranges > 0
        turned = angles[seen] + mounting.heading
        x = mounting.x_m + ranges[seen] * 1e-3 * np.cos(turned)
        y = mounting.y_m + ranges[seen] * 1e-3 * np.sin(turned)
        pose = located.pose
        c, s = np.cos(pose.heading), np.sin(pose.heading)
        points = np.stack([pose.x + c * x - s * y, pose.y + s * x + c * y], 1)
        packed = base64.b64encode(np.round(points * 100).astype("<i4").tobytes()).decode()
        self._put("scan", packed)

    def _see_trail(self, located: LocatedPose) -> None:
        if located.lost:
            return
        if located.frame != self._frame:
            self._frame = located.frame
            self.trail.clear()
        pose = located.pose
        if not self.trail or hypot(pose.x - self.trail[-1][0], pose.y - self.trail[-1][1]) >= TRAIL_STEP:
            self.trail.append((round(pose.x, 3), round(pose.y, 3)))
            if len(self.trail) > MOST_TRAIL:
                del self.trail[1 : MOST_TRAIL // 2 : 2]  # the older half at every other point


def asked_input(to: object) -> str:
    """The input that gives the goal of a step `goto`, by its key `to`; empty: none does."""
    return str(to.get("from_input") or "") if isinstance(to, Mapping) else ""


def is_shown(entry: Entry) -> bool:
    """Whether the log of a page has it."""
    return entry.kind != "frames" and (entry.kind not in DETAILS or entry.level > Level.INFO)


def line_of(entry: Entry) -> Part:
    """A line of the log."""
    return {"time": entry.time, "kind": entry.kind, "text": entry.text, "level": entry.level}


def _finite(number: float | None) -> float | None:
    return None if number is None or not abs(number) < 1e6 else round(number, 3)


def _std(located: LocatedPose) -> list[float] | None:
    if not located.covariance:
        return None
    xx, xy, _, yy, _, hh = located.covariance
    return [xx, xy, yy, hh]


def _fault(fault: Fault) -> Part:
    return {
        "id": fault.id,
        "device": fault.device,
        "text": fault.text,
        "severity": int(fault.severity),
        **explained_now(fault),
    }


def _box(box: Box) -> Part:
    told: Part = {"path": box.path, "word": box.word, "text": box.text}
    if box.steps:
        told["steps"] = [_box(step) for step in box.steps]
    if box.beside:
        told["beside"] = [_box(step) for step in box.beside]
    if arrows := [
        {"label": arrow.label, "then": arrow.then, "steps": [_box(step) for step in arrow.steps]}
        for arrow in box.arrows
    ]:
        told["arrows"] = arrows
    return told


def map_part(shown: ShownMap) -> Part:
    """Cells of a map as runs of equal ones, the lowest row first: [value, how many, ...], three values only."""
    content, place = shown.content, shown.odometry
    cells = np.where(content.cells < 0, 2, np.where(content.cells >= 50, 1, 0)).astype(np.uint8).ravel()
    rows, columns = content.cells.shape
    changes = np.flatnonzero(np.diff(cells)) + 1
    starts = np.concatenate([[0], changes])
    runs = np.diff(np.concatenate([starts, [len(cells)]]))
    pairs = np.stack([cells[starts].astype(np.int64), runs], 1).ravel()
    return {
        "resolution": content.resolution,
        "origin": list(content.origin),
        "size": [columns, rows],
        "runs": pairs.tolist(),
        "odometry": None if place is None else [place.x, place.y, place.heading],
    }


def mission_in(json: bytes) -> Mapping[str, Any]:
    """A mission as a run's context has it."""
    found: dict[str, Any] = msgspec.json.decode(json) if json else {}
    return found
