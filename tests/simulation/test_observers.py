"""Observers of a mission: what they see of a run, and that none of them stops one."""

from __future__ import annotations

import csv
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import ClassVar

import pytest
from rig import CALIBRATE, follow, write_mission

from artemis import app
from artemis.config import Config
from artemis.devices.can_bus import Traffic
from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.plugins import registry
from artemis.plugins.contracts import PluginContext
from artemis.recording.journal import read_journal
from artemis.recording.mcap_reader import Recording
from artemis.values import Severity, Tick

pytestmark = pytest.mark.short_alignment

STEPS = [CALIBRATE, follow(0.4)]


class Witness:
    """Keeps what it sees."""

    Config: ClassVar[type[Config]] = Config
    made: ClassVar[list[Witness]] = []

    def __init__(self, config: object, context: PluginContext) -> None:
        self.ticks: list[Tick] = []
        self.frames = self.closed = 0
        self.run, self.name = context.run, context.name
        self.made.append(self)

    def see(self, tick: Tick, traffic: Traffic, now: float) -> None:
        self.ticks.append(tick)
        self.frames += len(traffic)

    def take_problems(self) -> list[tuple[str, str, str]]:
        return []

    def close(self) -> None:
        self.closed += 1


class Raising(Witness):
    def see(self, tick: Tick, traffic: Traffic, now: float) -> None:
        super().see(tick, traffic, now)
        if len(self.ticks) == 100:
            raise ValueError("enough")


class Lying(Witness):
    def take_problems(self) -> list[tuple[str, str, str]]:
        return [("NONE-1", self.name, "no such row")] if len(self.ticks) == 50 else []


class Clinging(Witness):
    def close(self) -> None:
        super().close()
        raise OSError("no")


@pytest.fixture
def _installed(monkeypatch: pytest.MonkeyPatch) -> None:
    Witness.made.clear()
    found = registry._found
    added = [
        EntryPoint(kind.__name__.lower(), f"{__name__}:{kind.__name__}", "artemis.observers")
        for kind in (Witness, Raising, Lying, Clinging)
    ]
    monkeypatch.setattr(registry, "_found", lambda group: found(group) + [p for p in added if p.group == group])
    monkeypatch.setattr(EntryPoint, "load", _load)


_loads = EntryPoint.load


def _load(point: EntryPoint) -> object:
    return globals()[point.attr] if point.module == __name__ else _loads(point)


def run(folder: Path, plugin: str, **options: object) -> app.Outcome:
    mission = write_mission(folder, STEPS, observers={"seen": {"plugin": plugin, **options}})
    return app.run_mission(load_mission(mission), mission)


def warnings(outcome: app.Outcome) -> set[tuple[str, str, Severity]]:
    return {
        (fault.id, fault.device, fault.severity)
        for tick in Recording(outcome.run.path).ticks()
        for fault in tick.snapshot.verdict.faults
    }


@pytest.mark.usefixtures("_installed")
def test_on_virtual_time_an_observer_sees_what_is_recorded(tmp_path: Path) -> None:
    outcome = run(tmp_path, "witness")
    (seen,), recording = Witness.made, Recording(outcome.run.path)
    assert [tick.snapshot.sensed.index for tick in seen.ticks] == [
        tick.snapshot.sensed.index for tick in recording.ticks()
    ]
    assert seen.frames > 10 * len(seen.ticks)
    assert (seen.run, seen.name, seen.closed) == (outcome.run.path, "seen", 1)
    assert (outcome.exit_status, warnings(outcome)) == (0, set())


@pytest.mark.usefixtures("_installed")
@pytest.mark.parametrize(("plugin", "id"), [("raising", "PLG-02"), ("lying", "PLG-06")])
def test_one_that_fails_is_a_warning_and_the_run_goes_on(tmp_path: Path, plugin: str, id: str) -> None:
    outcome = run(tmp_path, plugin)
    assert (outcome.exit_status, warnings(outcome)) == (0, {(id, "seen", Severity.WARN)})
    told = [entry.text for entry in read_journal(outcome.run.journal).entries if entry.kind == "fault"]
    assert len(told) == 1
    assert [seen.closed for seen in Witness.made] == [1]


@pytest.mark.usefixtures("_installed")
def test_one_that_cannot_be_closed_is_told_in_the_journal(tmp_path: Path) -> None:
    outcome = run(tmp_path, "clinging")
    told = [entry.text for entry in read_journal(outcome.run.journal).entries if entry.kind == "warning"]
    (line,) = told
    assert line.startswith("PLG-02 seen: OSError('no') at test_observers.py:")
    assert line.endswith(", when it was closed")
    assert outcome.exit_status == 0


@pytest.mark.usefixtures("_installed")
def test_observers_are_closed_when_the_run_breaks_off(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, STEPS, observers={"one": {"plugin": "witness"}})
    loaded = load_mission(mission)
    given = Witness(Config(), PluginContext(name="given", robot=loaded.robot, folder=tmp_path))

    def watch(tick: Tick, traffic: Traffic) -> None:
        if tick.snapshot.sensed.index == 20:
            raise RuntimeError("broken")

    with pytest.raises(ExceptionGroup):  # of the tasks that it ran in
        app.run_mission(loaded, mission, watch=watch, observers={"given": given})
    assert [(seen.name, seen.closed) for seen in Witness.made] == [("given", 1), ("one", 1)]


def test_a_table_of_chosen_signals(tmp_path: Path) -> None:
    outcome = run(tmp_path, "csv", signals=["mode", "x_m", "cross_track_m"], every_s=0.1)
    with (outcome.run.path / "seen.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    last = list(Recording(outcome.run.path).ticks())[-1]
    assert list(rows[0]) == ["time_s", "mode", "x_m", "cross_track_m"]
    assert [row["time_s"] for row in rows[:3]] == ["0.000", "0.100", "0.200"]
    assert float(rows[-1]["x_m"]) == pytest.approx(last.snapshot.odometry.pose.x, abs=1e-3)
    assert {row["mode"] for row in rows if row["cross_track_m"]} == {"follow"}


@pytest.mark.parametrize(
    ("name", "use", "problem"),
    [
        ("seen", {"plugin": "cvs"}, "artemis.observers: no plugin 'cvs'; nearest is 'csv'"),
        ("seen", {"plugin": "csv", "signal": ["x_m"]}, "signal"),
        ("seen", {"plugin": "csv", "signals": ["xm"]}, "x_m"),
        ("a/b", {"plugin": "csv"}, "the name becomes that of a file"),
    ],
)
def test_what_is_wrong_is_found_before_the_run(tmp_path: Path, name: str, use: object, problem: str) -> None:
    mission = write_mission(tmp_path, STEPS, observers={name: use})
    with pytest.raises(ConfigError) as caught:
        load_mission(mission)
    (found, *others) = caught.value.problems
    assert problem in found
    assert "mission.yaml:" in found
    assert not others
