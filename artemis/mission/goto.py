"""The step `goto` of a mission: its keys, and the map, zones and place that it names."""

from __future__ import annotations

from typing import Annotated, Self

from msgspec.structs import replace
from pydantic import Discriminator, Field, Tag, model_validator

from artemis.config import Config
from artemis.mission.actions import FileName, FollowerUse
from artemis.mission.keys import Positive
from artemis.mission.obstacles import Obstacles, rules_for
from artemis.route_planning.zones import MapPose
from artemis.scan import ObstacleRules
from artemis.states.step_names import destination
from artemis.vehicle import RobotFile

NARROW = 0.03
"""Around the outline the robot stops for what comes so near [m], where a mission says nothing: it drives near walls."""
BEYOND = 0.07
"""Routes are free by so much more than that [m]: the robot is not exactly on them, and a scanner measures some cm too
little, by its noise and its systematic error."""
TO_STOP = 0.10
"""The obstacle stop keeps its distance and a cell from ground that was not seen, and stops within the rest [m]."""
MOST_OFF = 0.3
"""Farther from its route the robot is lost [m]."""


class AskedGoal(Config):
    """A goal that an input gives while the step runs."""

    from_input: Annotated[str, Field(min_length=1)]
    """One of the mission's `inputs`, which allows it: `allow: [goal_pose]`. The robot stands until the goal comes;
    a new one during the drive replaces it, once the robot stands."""


def _kind_of(to: object) -> str:
    if isinstance(to, AskedGoal) or (isinstance(to, dict) and "from_input" in to):
        return "<input>"
    return "<pose>" if isinstance(to, dict | MapPose) else "<place>"


class Goto(Config):
    """Drive to a place on a map, on a route that is planned for it; replan where an obstacle blocks it."""

    map: FileName
    """A map's YAML file, as of map_server. Zones and places stand beside it: of `hall.yaml` in `hall.zones.yaml`."""
    to: Annotated[
        Annotated[Annotated[str, Field(min_length=1)], Tag("<place>")]
        | Annotated[MapPose, Tag("<pose>")]
        | Annotated[AskedGoal, Tag("<input>")],
        Discriminator(_kind_of),
    ]
    """A place by its name, where the centre of the rear axle is to be on the map, or an input that gives the goal."""
    speed_m_s: Positive = 0.4
    """Highest speed of the virtual front wheel."""
    follower: FollowerUse = FollowerUse()
    """What steers and drives along the route; all keys but `speed_m_s` are those of the plugin."""
    blocked_after_s: Positive | None = None
    """If the robot stands for an obstacle for longer, and no further route is planned, the step ends with the outcome
    `blocked`; if left out, as in `obstacles`."""
    replans: Annotated[int, Field(ge=0, le=100)] = 3
    """How many times another route is planned when something stands on the present one."""
    obstacles: Obstacles | None = None
    """In this step; if left out, as in the mission. `margin_m` and `clear_m` are 3 cm where neither states them."""

    @model_validator(mode="after")
    def _one_patience(self) -> Self:
        own = self.obstacles
        if own is not None and self.blocked_after_s is not None and "blocked_after_s" in own.model_fields_set:
            raise ValueError("blocked_after_s stands here and in `obstacles`: leave one of them out")
        return self

    @property
    def place(self) -> str:
        """Where it leads, for people."""
        return destination(self.to if isinstance(self.to, str) else self.to.model_dump())

    @property
    def asks(self) -> str:
        """The input that gives the goal; empty: it is stated."""
        return self.to.from_input if isinstance(self.to, AskedGoal) else ""

    @property
    def follower_options(self) -> dict[str, object]:
        """The keys of the follower's plugin."""
        return {**self.follower.options, "speed_m_s": self.speed_m_s}


def goto_rules(goto: Goto, mission: Obstacles | None, robot: RobotFile) -> ObstacleRules | None:
    """What the robot does about obstacles on its way; None: it has no scanner."""
    said = goto.obstacles or mission or Obstacles()
    narrow = {key: NARROW for key in ("margin_m", "clear_m") if key not in said.model_fields_set}
    rules = rules_for(said.model_copy(update=narrow), robot)
    if rules is None or goto.blocked_after_s is None:
        return rules
    return replace(rules, blocked_after=goto.blocked_after_s)


def route_margin(rules: ObstacleRules | None) -> float:
    """How much room a route keeps around the outline [m], by what `goto_rules` says."""
    from artemis.route_planning.floor import MARGIN

    return max(MARGIN, 0.0 if rules is None or rules.mode == "off" else rules.margin + BEYOND)


def known_behind(rules: ObstacleRules | None) -> float | None:
    """How far behind the outline ground has to be known for the obstacle stop to let the robot reverse [m].

    None: it lets it reverse anywhere.
    """
    return None if rules is None or rules.mode == "off" or rules.unseen_reverse else rules.clear + TO_STOP
