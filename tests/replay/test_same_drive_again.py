"""A drive by hand happens again: what an input gave in one run is the operator of the next."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace
from rig import CALIBRATE, STICK, TELEOP, Rig, Run, run, stick, write_mission
from test_gamepad_drives import DONE, DRIVE, ENABLE, Desk

from artemis.commands.replay import replay_run
from artemis.errors import ConfigError
from artemis.mission.loading import load_mission
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.keyboard import KeyboardConfig, KeyboardInput
from artemis.recording.mcap_reader import Recording
from artemis.recording.schemas import TickRecord
from artemis.values import Mode

pytestmark = pytest.mark.short_alignment

STEPS: list[dict[str, Any]] = [CALIBRATE, TELEOP]
TABLE = stick((0.0, 0.0, 0.0, 0), (5.9, 0.2, 0.6, 1), (7.4, -0.4, -0.5, 1), (8.9, 0.0, 0.0, 0))
UP, LEFT, THERE, TELLS_RELEASE = b"\x1b[A", b"\x1b[D", b"\x1b[0n", b"\x1b[?2u"
LET_GO = (b"\x1b[1;1:3A", b"\x1b[1;1:3D")


def by_table(folder: Path) -> Run:
    return run(write_mission(folder, STEPS, {"stick.csv": TABLE}, inputs=STICK))


def by_joystick(folder: Path) -> Run:
    desk = Desk(folder)
    desk.at(DRIVE, buttons=ENABLE)
    for index in range(10):
        desk.at(DRIVE + 0.507 + index * 0.2, x=-0.4 - 0.01 * (index % 2), y=0.8, buttons=ENABLE)
    desk.at(DRIVE + 3.0, buttons=ENABLE)
    desk.at(DRIVE + 4.013)
    desk.at(DRIVE + 4.5, buttons=DONE)
    return desk.rig.run()


def by_unplugged_joystick(folder: Path) -> Run:
    desk = Desk(folder)
    desk.at(DRIVE, buttons=ENABLE)
    desk.at(DRIVE + 0.507, y=0.8, buttons=ENABLE)
    desk.rig.at(DRIVE + 2.0, desk.hid.unplug)
    return desk.rig.run()


def by_keys(folder: Path) -> Run:
    mission = write_mission(folder, STEPS, {"stick.csv": TABLE}, inputs=STICK)
    listeners: list[Callable[[bytes], None]] = []

    def listen(listener: Callable[[bytes], None]) -> bool:
        listeners.append(listener)
        return True

    context = PluginContext(
        name="stick",
        robot=load_mission(mission).robot,
        folder=folder,
        typed=listen,
    )
    rig = Rig(mission, input=KeyboardInput(KeyboardConfig(), context))
    for index in range(500):
        rig.at(index * 0.04 + 0.003, lambda: listeners[0](THERE))
    typed = ((0.5, TELLS_RELEASE), (6.4, UP), (7.4, LEFT), (8.4, LET_GO[1]), (9.4, LET_GO[0]), (11.4, b"d"))
    for time, keys in typed:
        rig.at(time, partial(lambda data: listeners[0](data), keys))
    return rig.run()


def again(first: Run, **keys: object) -> Path:
    """The same mission with the first run as its operator."""
    assert first.outcome is not None
    folder: Path = first.mission.parent
    mission = json.loads(first.mission.read_text())
    name = first.outcome.run.path.relative_to(folder).as_posix()
    mission["inputs"] = {"stick": {"plugin": "scripted", "file": name, **keys}}
    path = folder / "again.yaml"
    path.write_text(json.dumps(mission, indent=1))
    return path


def commands(seen: Run) -> list[tuple[object, ...]]:
    """What artemis made of every tick, but for the words of faults, and the last digits of times: acts are timers."""
    assert seen.outcome is not None
    return [_command(tick) for tick in Recording(seen.outcome.run.path).ticks()]


def _command(tick: TickRecord) -> tuple[object, ...]:
    snapshot, verdict = tick.snapshot, tick.snapshot.verdict
    faults = tuple(replace(fault, text="") for fault in verdict.faults)
    times = round(snapshot.time, 9), round(snapshot.dt, 9)
    return times, snapshot.odometry, replace(verdict, faults=faults), tick.mode, tick.wish, tick.set_points


@pytest.mark.sampled(2)
@pytest.mark.parametrize("drive", [by_table, by_joystick, by_keys, by_unplugged_joystick])
def test_the_same_drive_gives_the_same_commands(tmp_path: Path, drive: Callable[[Path], Run]) -> None:
    first = drive(tmp_path)
    second = run(again(first))
    assert Mode.TELEOP in first.modes
    assert max(abs(truth.speed) for truth in first.world.history) > 0.2
    assert commands(second) == commands(first)
    assert (second.status, second.fault_ids) == (first.status, first.fault_ids)
    frames = [[(frame.id, frame.data) for seen in one.seen for frame in seen.sent] for one in (first, second)]
    assert frames[0] == frames[1]


@pytest.mark.slow
def test_the_second_run_holds_what_it_took_from_the_first(tmp_path: Path) -> None:
    second = run(again(by_table(tmp_path)))
    assert second.outcome is not None
    assert replay_run(second.outcome.run.path) == 0
    alone = Rig(second.outcome.run.files / "again.yaml").run()  # the copies are a mission of their own
    assert commands(alone) == commands(second)
    third = run(again(second))
    assert commands(third) == commands(second)


@pytest.mark.slow
def test_the_recording_itself_does_as_well_as_its_folder(tmp_path: Path) -> None:
    first = by_table(tmp_path)
    path = again(first)
    assert first.outcome is not None
    name = first.outcome.run.path.relative_to(tmp_path).as_posix()
    path.write_text(path.read_text().replace(name, f"{name}/recording.mcap"))
    assert commands(run(path)) == commands(first)


def problems_of(mission: Path) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        load_mission(mission)
    return [problem.replace(str(mission.parent), "@") for problem in caught.value.problems]


def test_what_cannot_be_driven_again_is_refused_before_anything_moves(tmp_path: Path) -> None:
    first = by_table(tmp_path)
    (problem,) = problems_of(again(first, input="stik"))
    assert problem.startswith("@/again.yaml:24:4: inputs.stick.input: no input stik gave anything in the run runs/")
    (problem,) = problems_of(again(first, deadzone=0.1))
    assert problem.endswith("inputs.stick.deadzone: not used with an earlier run; leave it out")
    (problem,) = problems_of(again(first, max_speed_m_s=0.1))
    assert problem.endswith("m/s; 0.1 are allowed")


@pytest.mark.parametrize(
    ("damage", "expected"),
    [
        (
            lambda raw: raw[: len(raw) // 2],
            "the recording is not whole: the file is cut off; its last readable tick is",
        ),
        (lambda raw: raw[: len(raw) // 2] + b"?" + raw[len(raw) // 2 + 1 :], "the file is damaged"),
        (lambda raw: raw[:200], "nothing of a run can be read"),
    ],
)
def test_a_damaged_recording_is_refused_at_its_place(
    tmp_path: Path, damage: Callable[[bytes], bytes], expected: str
) -> None:
    first = by_table(tmp_path)
    assert first.outcome is not None
    file = first.outcome.run.recording
    file.write_bytes(damage(file.read_bytes()))
    (problem,) = problems_of(again(first))
    assert problem.startswith("@/again.yaml:23:4: inputs.stick.file: ")
    assert expected in problem


def test_a_folder_that_is_no_run_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    inputs = {"stick": {"plugin": "scripted", "file": "empty"}}
    (problem,) = problems_of(write_mission(tmp_path, STEPS, inputs=inputs))
    assert problem.endswith("inputs.stick.file: is a directory, expected a file: empty")


def test_a_broken_table_is_found_without_a_run(tmp_path: Path) -> None:
    rows = "- {time_s: 0, x: 0, y: 7}\n"
    inputs = {"stick": {"plugin": "scripted", "file": "stick.yaml"}}
    mission = write_mission(tmp_path, STEPS, {"stick.yaml": rows}, inputs=inputs)
    assert problems_of(mission) == ["stick.yaml:1:21: [0].y: expected -1 to 1, found 7"]
