"""Missions that words compose, drawn at random: sound and undisturbed each of them ends with `done`.

What happens in one does not depend on how long the bring-up takes, and not on a millimetre either: a run that is killed
and resumed does the same. So distances are compared far from where the robot may stand, and times with never.
"""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from typing import Any

from artemis.axles import OWN_SIDES
from artemis.vehicle import RobotFile

Steps = list[dict[str, Any]]
ALIGN: dict[str, Any] = {"calibrate": {"steering": "from_potentiometers"}}
NEVER = "run_s > 1000"
LENGTH = 1.0
"""Of the path that is driven forth and back [m]."""
CAUGHT = ("fault",)
ANSWERS = ["left", "right"]
PARTS: Mapping[str, Any] = {"pause": {"takes": {"for": 0.2}, "steps": [{"wait": {"seconds": "$for"}}]}}
LONG = 60.0
"""Within this time every step of such a mission is done [s]."""
_ALONE = 0.8
"""Steps beside others are over sooner [s]."""


class TreeDice:
    """Draws the steps of one mission.

    Attributes:
        seconds: About how long they take.
        asks: One of them is a question.
    """

    def __init__(self, dice: random.Random, robot: RobotFile, speed: float, faults: Sequence[str]) -> None:
        """`faults` will happen, by their ids: a `try` may name one."""
        self._robot = robot
        self._dice, self._speed, self._faults = dice, speed, faults
        self._drives, self._times, self._watched = 0, 1, False
        self.seconds, self.asks = 0.0, False

    def mission(self) -> Steps:
        """All of them; at least one drives."""
        steps = [ALIGN, *self._steps(2)]
        if not self._drives or self._dice.uniform(0, 1) < 0.3:
            steps.append(self._approach() if self._dice.uniform(0, 1) < 0.7 else self._follow())
        ending = self._dice.uniform(0, 1)
        if ending < 0.1:
            steps.append({"end": {"say": "that is all"}})
        elif ending < 0.2:
            steps.append({"stop": {}})
        return steps

    def _steps(self, depth: int) -> Steps:
        return [self._step(depth) for _ in range(self._dice.choice((1, 1, 2)))]

    def _step(self, depth: int) -> dict[str, Any]:
        words = (self._repeat, self._try, self._try, self._during, self._during, self._choose, self._together)
        if depth and self._dice.uniform(0, 1) < 0.75:
            return self._dice.choice(words)(depth - 1)
        step: dict[str, Any] = self._dice.choice((self._drive, self._drive, self._wait, self._ask, self._rare))()
        return step

    # ------------------------------------------------------------------------------------------ steps

    def _wait(self, most: float = 0.6) -> dict[str, Any]:
        seconds = round(self._dice.uniform(0.1, most), 2)
        self.seconds += self._times * seconds
        return {"wait": {"seconds": seconds}}

    def _rare(self) -> dict[str, Any]:
        kind = self._dice.choice(("say", "call", "call", "turn", "gains", "align"))
        if kind == "say":
            return {"say": "so far"}
        if kind == "call":
            return {"call": {"part": "pause", "with": {"for": self._wait()["wait"]["seconds"]}}}
        if self._times > 1 or kind == "align":
            return ALIGN
        self.seconds += 4.0
        name, _ = self._robot.drive_at("steering", self._dice.choice(OWN_SIDES))
        if kind == "gains" and self._robot.drives[name].gains is not None:  # of others none are tried
            return {"calibrate": {"gains": {name: {"position": [160, 10, 210]}}}}
        _, drive = self._robot.drive_at("steering", self._dice.choice(OWN_SIDES))
        return {"calibrate": {"turn": {"side": drive.side, "angle_deg": 2.0}}}

    def _drive(self) -> dict[str, Any]:
        return self._follow() if self._drives + self._times <= 3 else self._wait()

    def _follow(self) -> dict[str, Any]:
        """The path forwards, or backwards from its end; nothing is left to do where it was driven before."""
        self._drives += self._times
        self.seconds += self._times * (LENGTH / self._speed + 1.0)
        plugin = {"plugin": "indiveri"} if self._dice.uniform(0, 1) < 0.5 else {}
        follow = {"path": "path.csv", "start": "nearest", "follower": {**plugin, "speed_m_s": self._speed}}
        return {"follow": {**follow, "from_end": True} if self._dice.uniform(0, 1) < 0.4 else follow}

    def _approach(self) -> dict[str, Any]:
        """Ahead until it is far enough, or too far."""
        self._drives += self._times
        self.seconds += self._times * (0.5 / self._speed + 1.0)
        until = NEVER if self._dice.uniform(0, 1) < 0.5 else f"approached_m > {self._dice.uniform(0.2, 0.4):.2f}"
        steps = [{"approach": {"until": until, "at_most_m": 0.5, "speed_m_s": self._speed}}]
        return {"try": {"steps": steps, "catch": {"too-far": [{"say": "too far"}]}}}

    def _ask(self) -> dict[str, Any]:
        self.asks = True
        self.seconds += 0.5 * self._times
        ask = {"ask": {"question": "which way?", "answers": ANSWERS, "at_most_s": 2.0}}
        return {"try": {"steps": [ask], "catch": {"timeout": [{"say": "nobody"}]}}}

    # ------------------------------------------------------------------------------------------ words

    def _repeat(self, depth: int) -> dict[str, Any]:
        times = self._times
        self._times *= 2
        steps = [*self._steps(depth), self._wait(0.2)]
        self._times = times
        until = {"until": "round >= 2"} if self._dice.uniform(0, 1) < 0.5 else {}
        return {"repeat": {"times": 3 if until else 2, **until, "steps": steps}}

    def _try(self, depth: int) -> dict[str, Any]:
        if self._dice.uniform(0, 1) < 0.4:
            self.seconds += 0.6 * self._times
            late = [{"wait": {"for": NEVER, "at_most_s": 0.2}}]
            caught = {self._dice.choice(("timeout", "any")): self._steps(depth)}
            return {
                "try": {"retries": 1, "between": [{"say": "again"}, self._wait(0.2)], "steps": late, "catch": caught}
            }
        steps = self._steps(depth)
        names = [self._dice.choice((*CAUGHT, *(f"fault:{id}" for id in self._faults)))]
        if self._dice.uniform(0, 1) < 0.5:
            return {"try": {"retries": 1, "again_on": names, "between": [self._wait(0.2)], "steps": steps}}
        return {"try": {"steps": steps, "catch": {names[0]: [{"say": "caught"}, self._wait(0.2)]}}}

    def _during(self, depth: int) -> dict[str, Any]:
        if self._watched or self._dice.uniform(0, 1) < 0.3:  # two distances might be met in any order
            self.seconds += 0.4 * self._times
            late = {"during": {"steps": [{"wait": {"for": NEVER}}], "at_most_s": 0.4}}
            return {"try": {"steps": [late], "catch": {"timeout": [{"say": "late"}]}}}
        self._watched = True
        far = f"driven_m > {self._dice.choice((0.0, 1.0)) + self._dice.uniform(0.3, 0.7) * LENGTH:.2f}"
        watch: dict[str, Any] = {"if": far, "steps": [{"say": "far"}, self._wait()]}
        steps, then = [*self._steps(depth), self._wait(0.2)], self._dice.choice(("resume", "resume", "restart", "far"))
        during = {"during": {"steps": steps, "at_most_s": LONG, "when": [{**watch, "then": then}]}}
        if then != "far":
            return during
        return {"try": {"steps": [during], "catch": {"far": [self._wait(0.2)]}}}

    def _choose(self, depth: int) -> dict[str, Any]:
        condition = self._dice.choice(("driven_m > 0.1", NEVER, *(["answer == 'left'"] if self.asks else [])))
        other = [] if self._dice.uniform(0, 1) < 0.4 else [{"steps": self._steps(depth)}]
        return {"choose": [{"if": condition, "steps": self._steps(depth)}, *other]}

    def _together(self, depth: int) -> dict[str, Any]:
        if self._dice.uniform(0, 1) < 0.5:
            return {"together": {"steps": self._steps(depth), "beside": [{"wait": {"for": NEVER}}]}}
        self.seconds += _ALONE * self._times
        beside = [{"repeat": {"times": 2, "steps": [{"wait": {"seconds": 0.2}}]}}, {"wait": {"seconds": 0.3}}]
        return {"together": {"steps": [{"wait": {"seconds": _ALONE}}], "beside": beside}}
