"""What the composition root and the attendance of a run decide before anything runs."""

from __future__ import annotations

import pytest

from artemis import app
from artemis.attendance import Attendance
from artemis.mission.schema import Operation
from artemis.values import Severity


@pytest.mark.parametrize("at_terminal", [False, True])
@pytest.mark.parametrize("scripted", [False, True])
def test_scripted_operator_is_there_until_a_little_after_its_last_act(scripted: bool, at_terminal: bool) -> None:
    acts = [Operation(at_s=20.0, do="arm"), Operation(at_s=1.0, do="acknowledge")] if scripted else []
    attendance = Attendance(acts, (lambda request, typed: lambda: None) if at_terminal else None)
    there = [time for time in (0.0, 10.0, 25.0, 25.1, 1000.0) if attendance.there(time)[0]]
    assert there == ([0.0, 10.0, 25.0, 25.1, 1000.0] if at_terminal else [0.0, 10.0, 25.0] if scripted else [])
    assert attendance.expected is (scripted or at_terminal)


@pytest.mark.parametrize(("memory", "severity"), [(900, Severity.WARN), (1001, Severity.CONTROLLED_STOP)])
def test_growth_is_a_warning_until_the_memory_runs_out(memory: int, severity: Severity) -> None:
    fault = app.growth("300 MB more memory than at 30 s", memory * 1_000_000)
    assert (fault.id, fault.severity, fault.to_fault) == ("PLG-05", severity, False)
    assert "300 MB more" in fault.text
