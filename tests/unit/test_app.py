"""What the composition root decides before anything runs."""

from __future__ import annotations

import json
from pathlib import Path
from shutil import copy

import pytest

from artemis import app
from artemis.mission.loading import load_mission
from artemis.values import Severity
from artemis_lab.injections.failing_disk import FailingDisk

MISSIONS = Path(__file__).parents[2] / "missions"
REAL = {"interface": "udp_multicast", "channel": "239.0.0.1", "port": 45455, "hop_limit": 0}


@pytest.mark.parametrize(("bus", "simulated"), [(REAL, False), (REAL, True), ("simulation", True)])
def test_scripted_operator_is_somebody_in_a_simulation_only(tmp_path: Path, bus: object, simulated: bool) -> None:
    copy(MISSIONS / "robots" / "artemis.yaml", tmp_path)
    mission = {
        "mission": "operated",
        "robot": "artemis.yaml",
        "bus": bus,
        "steps": [{"wait": {"seconds": 1.0}}],
        "simulation": {"operator": [{"at_s": 20.0, "do": "arm"}, {"at_s": 1.0, "do": "acknowledge"}]},
    }
    source = tmp_path / "mission.yaml"
    source.write_text(json.dumps(mission))
    run = app._Run(
        load_mission(source),
        source,
        simulated=simulated,
        watch=lambda tick, traffic: None,
        operator=None,
        witness=lambda world: world,
        start=None,
        resumption=None,
        disk=FailingDisk(),
    )
    run._recorder.close()
    there = [time for time in (0.0, 10.0, 25.0, 25.1, 1000.0) if run._attended(time)]
    assert there == ([0.0, 10.0, 25.0] if simulated else [])


@pytest.mark.parametrize(("memory", "severity"), [(900, Severity.WARN), (1001, Severity.CONTROLLED_STOP)])
def test_growth_is_a_warning_until_the_memory_runs_out(
    monkeypatch: pytest.MonkeyPatch, memory: int, severity: Severity
) -> None:
    monkeypatch.setattr(app, "usage", lambda: (memory * 1_000_000, 10, 20))
    fault = app._growth("300 MB more memory than at 30 s")
    assert (fault.id, fault.severity, fault.to_fault) == ("PLG-05", severity, False)
    assert "300 MB more" in fault.text
