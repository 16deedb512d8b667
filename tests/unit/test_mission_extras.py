"""What a mission takes longer for without an extra is said once, before it runs, and only where it counts."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from artemis.build import install
from artemis.cli import app
from artemis.commands.check import facts_of
from artemis.commands.run import _forewarn
from artemis.mission import extras
from artemis.mission.loading import load_mission

MISSIONS = Path(__file__).parents[2] / "missions"


@pytest.fixture
def numba(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """Installed or not."""
    monkeypatch.setattr(extras, "find_spec", lambda name: object() if request.param else None)


@pytest.mark.parametrize("numba", [False], indirect=True)
@pytest.mark.parametrize(
    ("mission", "costs"),
    [
        ("figure_eight", ()),
        ("follow_by_tracker", ()),
        ("map_hall", (extras.MAPPING,)),
        ("patrol_hall", (extras.MATCHING,)),
        ("goto_workshop", (extras.ROUTES,)),
    ],
)
@pytest.mark.usefixtures("numba")
def test_only_what_a_mission_uses_is_named(mission: str, costs: tuple[str, ...]) -> None:
    remarks = extras.slower_without_numba(load_mission(MISSIONS / f"{mission}.yaml"))
    assert remarks == ([f"numba is not installed: {'; '.join(costs)}: {install('slam')}"] if costs else [])


@pytest.mark.parametrize("numba", [True, False], indirect=True, ids=["with numba", "without"])
def test_it_is_said_before_a_run_and_by_both_forms_of_check(
    numba: None, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
) -> None:
    installed = "without" not in request.node.name
    file = MISSIONS / "map_hall.yaml"
    said = CliRunner().invoke(app, ["check", str(file)], catch_exceptions=False).output
    assert ("numba is not installed: mapping" in said) is not installed
    assert any("numba" in remark for remark in facts_of(file, page=False)["remarks"]) is not installed
    _forewarn(load_mission(file), None)
    assert ("remark        numba is not installed: mapping" in capsys.readouterr().out) is not installed
