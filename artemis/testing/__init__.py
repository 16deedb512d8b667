"""For tests: of missions, without a robot (`walk`); of plugins, the contract of each, and devices in memory."""

from artemis.mission.walking import MissionWalk, walk

__all__ = ["MissionWalk", "walk"]
