"""What a step `goto` names: its map, zones and places, read once; and whether the robot can stand where it leads."""

from __future__ import annotations

import os
from collections.abc import Mapping
from math import radians
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from artemis.bridges.poses import GOAL_POSE
from artemis.errors import ConfigError
from artemis.mission.files import read_data
from artemis.mission.goto import AskedGoal, Goto, goto_rules, known_behind, route_margin
from artemis.mission.obstacles import Obstacles
from artemis.mission.problems import nearest
from artemis.mission.reading import Configs, MissionReading
from artemis.plugins.contracts import AllowsRequests
from artemis.plugins.stated import NamesMap, allowed
from artemis.plugins.used import localizer_used
from artemis.values import Pose
from artemis.vehicle import RobotFile
from artemis.yaml_file import KeyPath, read

if TYPE_CHECKING:
    from artemis.route_planning.floor import Floor, ZonedMap
    from artemis.route_planning.zones import MapZones


class GotoChecks(MissionReading):
    """Notes what is wrong in these steps."""

    def __init__(self, path: Path, simulate: bool = False, page: Mapping[str, Any] | None = None) -> None:
        super().__init__(path, simulate, page)
        self._floors: dict[str, tuple[Floor, MapZones, ZonedMap] | None] = {}

    def _check_goto(self, number: int, at: KeyPath, goto: Goto, robot: RobotFile | None, inputs: Configs) -> None:
        if localizer_used(self._data, simulated=self._simulated) is None:
            self._complain(
                at,
                "the pose on the map has to come from a localizer: add `localizer:`"
                " (in a simulation `simulation: {localizer: {plugin: simulated_tracker}}`)",
            )
        if robot is not None and robot.outline is None:
            self._complain(at, f"routes are planned for the robot's outline: write it in {self._robot_source}")
        if "speed_m_s" in goto.follower.options:
            self._complain((*at, "follower", "speed_m_s"), "is a key of the step itself: goto: {speed_m_s: ...}")
        self._used("artemis.followers", goto.follower.plugin, (*at, "follower"), goto.follower_options)
        self._check_same_map((*at, "map"), goto.map)
        self._check_asked((*at, "to", "from_input"), goto.asks, inputs)
        found = self._floor((*at, "map"), goto.map)
        pose = None if goto.asks else found and self._goal(at, goto, found[1])
        if found is None or (pose is None and not goto.asks) or robot is None or robot.outline is None:
            return
        from artemis.route_planning.floor import Destination, goal_problem

        rules = goto_rules(goto, self._part(Obstacles, "obstacles") if "obstacles" in self._data else None, robot)
        margin = route_margin(rules)
        problem = None if pose is None else goal_problem(found[0], robot, pose, margin)
        if problem is not None:
            self._complain((*at, "to"), f"{goto.place}: {problem}")
            return
        self._destinations[number] = Destination(
            made_of=found[2],
            goal=pose,
            speed=goto.speed_m_s,
            margin=margin,
            known_behind=known_behind(rules),
        )

    def _check_same_map(self, at: KeyPath, name: str) -> None:
        """Poses on another map than the localizer's would be poses in another frame, among other walls."""
        places: list[KeyPath] = [("simulation", "localizer")] if self._simulated else []
        used = [self._plugins[place] for place in [*places, ("localizer",)] if place in self._plugins]
        config = used[0][1] if used else None
        if isinstance(config, NamesMap) and os.path.normpath(config.map) != os.path.normpath(name):
            self._complain(
                at,
                f"the localizer finds the robot on {config.map}, and routes on another map would lead elsewhere: use "
                "one map for both (`artemis map edit --zone` closes areas of it for routes alone)",
            )

    def _check_asked(self, at: KeyPath, name: str, inputs: Configs) -> None:
        """The input that gives the goal; none if that is stated."""
        if name and name not in inputs:
            self._complain(at, f"no such input: {name}{nearest(name, inputs, 'inputs')}")
        elif name and (config := inputs[name]) is not None and GOAL_POSE not in allowed(config):
            where = f"add `allow: [{GOAL_POSE}]` to it" if isinstance(config, AllowsRequests) else "its plugin has none"
            self._complain(at, f"{name} gives no goals: {where}")

    def _goal(self, at: KeyPath, goto: Goto, zones: MapZones) -> Pose | None:
        """Where it leads, in the frame of the map."""
        place = zones.places.get(goto.to) if isinstance(goto.to, str) else goto.to
        if place is None or isinstance(place, AskedGoal):
            self._complain(
                (*at, "to"), f"no such place on {goto.map}: {goto.to}{nearest(str(goto.to), zones.places, 'places')}"
            )
            return None
        return Pose(x=place.x_m, y=place.y_m, heading=radians(place.heading_deg))

    def _floor(self, at: KeyPath, name: str) -> tuple[Floor, MapZones, ZonedMap] | None:
        """The floor of a map's YAML file, and what stands in the file of its zones; each map is read once."""
        if name not in self._floors:
            self._floors[name] = self._read_floor(at, name)
        return self._floors[name]

    def _read_floor(self, at: KeyPath, name: str) -> tuple[Floor, MapZones, ZonedMap] | None:
        from artemis.mapping.map_file import map_from
        from artemis.route_planning.floor import ZonedMap, floor_from, outside, packed_map
        from artemis.route_planning.zones import MapZones, zones_file

        def image(image: str) -> bytes:
            content = self._file(at, str(PurePosixPath(name).parent / image), read_data)
            if content is None:
                raise ConfigError([])
            return content

        raw = self._file(at, name, read)
        if raw is None:
            return None
        problems = len(self._problems)
        zones: MapZones | None = MapZones()
        found, beside = None, zones_file(name)
        try:
            content = map_from(self._survey(raw, str(self._folder / name)), (self._folder / name).parent, image)
            if (self._folder / beside).exists() and (found := self._file(at, beside, read)) is not None:
                zones = self._validated(MapZones, self._survey(found, str(self._folder / beside)))
        except ConfigError as error:
            self._problems += error.problems
            return None
        if zones is None or len(self._problems) > problems:
            return None
        try:
            floor = floor_from(content, zones.zones)
        except ConfigError as error:
            self._complain(at, f"{name}: {error}")
            return None
        self._remarks += [f"{beside}: {remark}" for remark in outside(content, zones)]
        return floor, zones, ZonedMap(packed_map(content), self._folder / beside, found or b"")
