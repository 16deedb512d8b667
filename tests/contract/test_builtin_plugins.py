"""The contract suites for plugin authors, held against every plugin that comes with artemis."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from artemis.plugins.behaviours.approach import ApproachBehaviour
from artemis.plugins.followers.indiveri import IndiveriFollower
from artemis.plugins.inputs.scripted import ScriptedInput
from artemis.plugins.observers.csv import CsvObserver
from artemis.plugins.registry import CONTRACTS, listing
from artemis.testing import contracts
from artemis.testing.behaviours import BehaviourContract
from artemis.testing.contracts import FollowerContract, InputContract
from artemis.testing.observers import ObserverContract

MISSIONS = Path(__file__).parents[2] / "missions"


class TestScripted(InputContract):
    plugin = ScriptedInput
    options: Mapping[str, object] = {"file": "inputs/loop.csv"}
    files: Mapping[str, bytes] = {"inputs/loop.csv": (MISSIONS / "inputs/loop.csv").read_bytes()}


class TestScriptedThatFallsSilent(InputContract):
    plugin = ScriptedInput
    options: Mapping[str, object] = {"file": "stick", "done_at_end": False, "gate": "round"}
    files: Mapping[str, bytes] = {
        "stick": b"time_s, x, y, enable, quickstop\n1, 0, 0, 0, 0\n2, 0.7, 0.7, 1, 0\n3, 0, 0, 0, 1\n"
    }


class TestIndiveri(FollowerContract):
    plugin = IndiveriFollower
    options: Mapping[str, object] = {"speed_m_s": 0.4}


class TestApproach(BehaviourContract):
    plugin = ApproachBehaviour
    options: Mapping[str, object] = {"until": "run_s > 1000", "at_most_m": 1.5, "speed_m_s": 0.3}
    ends = "too-far"


class TestCsv(ObserverContract):
    plugin = CsvObserver
    options: Mapping[str, object] = {"signals": ["mode", "cross_track_m"], "every_s": 0.1}


class TestCsvOfEverything(ObserverContract):
    plugin = CsvObserver


def test_every_built_in_plugin_is_tried() -> None:
    """Here, or beside the tests of its own."""
    text = "\n".join(path.read_text() for path in Path(__file__).parents[1].rglob("test_*.py"))
    tried = set(
        re.findall(
            r"^class \w+\((?:Input|Follower|Localizer|Scanner|Observer|Behaviour)Contract\):\n    plugin = (\w+)$",
            text,
            re.MULTILINE,
        )
    )
    built_in = [found for group in CONTRACTS for found in listing(group) if found.distribution == "artemis-robot"]
    assert {found.target.partition(":")[2] for found in built_in} <= tried


def test_robot_of_the_suites_is_the_shipped_one() -> None:
    copy = Path(contracts.__file__).with_name("artemis.yaml")
    assert copy.read_bytes() == (MISSIONS / "robots/artemis.yaml").read_bytes()
