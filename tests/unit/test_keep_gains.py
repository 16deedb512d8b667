"""`artemis calibrate gains`: what it keeps, and what it says when it cannot."""

from __future__ import annotations

import signal
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from gains_rig import LEFT, NEW, RIGHT, ROBOT, SETTLED, mission, robot_file, storing

from artemis import clock
from artemis.commands import calibrate_gains as command
from artemis.commands.gains_trial import Findings, Trial
from artemis.devices.can_bus import Frame
from artemis.drive_schema import Gains
from artemis.errors import ConfigError, DeviceTimeout
from artemis.mission.actions import NewGains
from artemis.mission.loading import load_mission
from artemis.motion.step_response import StepResponse
from artemis.yaml_edit import Keys, edit
from artemis.yaml_file import Data


def decide(
    folder: Path, response: StepResponse = SETTLED, *, yes: bool = True, drives: tuple[str, ...] = (LEFT,)
) -> int:
    loaded = load_mission(mission(folder))
    trial = Trial(drives=drives, role="steering", side="left", step=5.0, new=NewGains(position=(600, 10, 200)))
    found = Findings(traces={}, responses={"now": [SETTLED], "new": [response]})
    return command.decide(loaded, trial, found, yes)


def test_gains_that_are_kept_are_stored_and_written_for_their_drive_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = storing(monkeypatch)
    assert (decide(tmp_path), stored) == (0, [{LEFT: NEW.numbers}])
    loaded = load_mission(tmp_path / "mission.yaml")
    assert loaded.robot.drives[LEFT].gains == NEW
    assert loaded.robot.drives[RIGHT].gains == Gains(current=(500, 150), velocity=(1000, 100), position=(150, 10, 200))
    assert "# half" not in robot_file(tmp_path)
    assert robot_file(tmp_path).startswith(ROBOT.read_text()[:200])


@pytest.mark.parametrize(("after", "kept"), [(0, "nothing"), (1, "not all")])
def test_what_is_not_stored_is_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], after: int, kept: str
) -> None:
    storing(monkeypatch, DeviceTimeout(RIGHT, "no answer"), after)
    assert decide(tmp_path, drives=(LEFT, RIGHT)) == 1
    out = capsys.readouterr().out
    assert f"kept        {kept}: steer-right: no answer\n" in out
    assert ("            steer-left: stored\n" in out) is bool(after)
    assert ("artemis.yaml: has the old gains still" in out) is bool(after)
    assert robot_file(tmp_path) == ROBOT.read_text()


def test_a_file_that_cannot_be_written_after_storing_is_told_with_what_is_where(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object) -> None:
        raise ConfigError("artemis.yaml: cannot be written: read-only")

    storing(monkeypatch)
    monkeypatch.setattr(command, "edit", refuse)
    assert decide(tmp_path) == 1
    out = capsys.readouterr().out
    assert "kept        not all: artemis.yaml: cannot be written: read-only" in out
    assert "            steer-left: stored\n" in out
    assert robot_file(tmp_path) == ROBOT.read_text()


@pytest.mark.parametrize("after", [0, 1])
def test_ctrl_c_while_it_stores_tells_what_is_where(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], after: int
) -> None:
    storing(monkeypatch, KeyboardInterrupt(), after)
    assert decide(tmp_path, drives=(LEFT, RIGHT)) == 130
    told = capsys.readouterr().out.splitlines()
    file = tmp_path / "robots" / "artemis.yaml"
    last = f"            {file}: has the old gains still, and each run writes those"
    assert told == (
        [
            "kept        not all: interrupted",
            "            steer-left: stored",
            "            steer-right: may have stored them, it was about to",
            last,
        ]
        if after
        else ["kept        nothing: interrupted", "            steer-left: may have stored them, it was about to", last]
    )
    assert file.read_text() == ROBOT.read_text()


def test_ctrl_c_does_not_come_between_the_file_and_the_word_that_it_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(path: Path, changes: Mapping[Keys, Data]) -> None:
        edit(path, changes)
        signal.raise_signal(signal.SIGINT)

    storing(monkeypatch)
    monkeypatch.setattr(command, "edit", interrupted)
    assert decide(tmp_path) == 130
    assert f"kept        steer-left: stored, and in {tmp_path}" in capsys.readouterr().out
    assert load_mission(tmp_path / "mission.yaml").robot.drives[LEFT].gains == NEW


def test_a_robot_file_that_somebody_changed_meanwhile_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stored = storing(monkeypatch)
    loaded, file = load_mission(mission(tmp_path)), tmp_path / "robots" / "artemis.yaml"
    other = robot_file(tmp_path).replace("position: [150, 10, 200]", "position: [160, 10, 200]")
    file.write_text(other)
    assert command._keep(loaded, file, {LEFT: NEW}) == 1
    assert f"kept        nothing: {file}: was changed meanwhile, run again" in capsys.readouterr().out
    assert (stored, robot_file(tmp_path)) == ([], other)
    file.unlink()
    assert command._keep(loaded, file, {LEFT: NEW}) == 1
    assert stored == []


def test_nothing_is_stored_while_another_artemis_is_on_the_bus(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    closed: list[bool] = []

    class Busy:
        """A bus on which somebody else's heartbeat is heard."""

        error_frames = 0

        def send(self, frame: Frame) -> None:
            raise AssertionError(frame)

        def receive(self) -> list[Frame]:
            return [Frame(0x77F, b"\x05")]

        def listen(self, wake: Callable[[], None]) -> None:
            pass

        def close(self) -> None:
            closed.append(True)

    real_time = clock.run
    monkeypatch.setattr(clock, "run", lambda main, simulated: real_time(main, simulated=True))
    monkeypatch.setattr(command, "open_bus", lambda *_, **__: Busy())
    assert decide(tmp_path) == 1
    out = capsys.readouterr().out
    assert "kept        nothing: steer-left: was sent nothing: another artemis uses this bus (COM-18)" in out
    assert (closed, robot_file(tmp_path)) == ([True], ROBOT.read_text())


def test_gains_that_do_not_settle_are_not_kept_without_a_person(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored = storing(monkeypatch)
    assert decide(tmp_path, replace(SETTLED, settled_5=None)) == 1
    assert (stored, robot_file(tmp_path)) == ([], ROBOT.read_text())


@pytest.mark.parametrize(
    ("answer", "kept"), [("yes\n", True), ("y\n", True), ("no\n", False), ("\n", False), ("", False), ("^C", False)]
)
def test_a_person_decides(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: str, kept: bool) -> None:
    class Keyboard:
        def isatty(self) -> bool:
            return True

        def readline(self) -> str:
            if answer == "^C":
                raise KeyboardInterrupt
            return answer

    stored = storing(monkeypatch)
    monkeypatch.setattr("sys.stdin", Keyboard())
    assert (decide(tmp_path, yes=False), bool(stored)) == (0, kept)
