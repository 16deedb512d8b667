"""The mission file: its schema, and loading it with everything it names, checked before anything moves."""

from artemis.mission.actions import Calibrate, Follow, PluginUse, Stop, Teleop, Until, Wait
from artemis.mission.json_schema import mission_schema, robot_schema
from artemis.mission.loading import LoadedMission, load_mission, plugin_from
from artemis.mission.schema import Mission, Operation
from artemis.mission.words import Step

__all__ = [
    "Calibrate",
    "Follow",
    "LoadedMission",
    "Mission",
    "Operation",
    "PluginUse",
    "Step",
    "Stop",
    "Teleop",
    "Until",
    "Wait",
    "load_mission",
    "mission_schema",
    "plugin_from",
    "robot_schema",
]
