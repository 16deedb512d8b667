"""Driving by the keys of a terminal, the whole command in a pseudo-terminal."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from command_line import MISSIONS, ROBOT, assert_left_at_rest, modes_of, only_run
from pseudo_terminal import Terminal, terminal

UP, UP_RELEASED, FOCUS_LOST = b"\x1b[1;1:1A", b"\x1b[1;1:3A", b"\x1b[O"
TELLS_RELEASE, THERE = b"\x1b[?2u", b"\x1b[0n"
FASTER_THAN_ROLLING = r"teleop +\+0\.(0[5-9]|[1-9])"
DRIVES = r" s  teleop +driving"
AT_REST, STANDS = r"teleop +[+-]0\.00 m/s", 5
"""A line of the live view, and how many of them have come when the robot certainly stands."""
LET_GO = "hold an arrow key to drive"


def answer(screen: Terminal, seen: str) -> None:
    for _ in range(seen.count("\x1b[5n")):
        screen.press(THERE)


def mission(folder: Path) -> Path:
    (folder / "robots").mkdir()
    shutil.copy(ROBOT, folder / "robots")
    return Path(shutil.copy(MISSIONS / "teleop_keyboard.yaml", folder))


@pytest.mark.slow
@pytest.mark.realtime
def test_arrows_drive_while_they_are_held(tmp_path: Path) -> None:
    with terminal(mission(tmp_path)) as screen:
        screen.hear = answer
        assert "arrow keys drive while held" in screen.see("listening")
        screen.see(LET_GO)
        screen.press(TELLS_RELEASE + UP)
        screen.see(DRIVES)
        screen.see(FASTER_THAN_ROLLING)
        screen.press(UP_RELEASED)
        screen.see(LET_GO)
        for _ in range(STANDS):
            screen.see(AT_REST)
        screen.press(UP)
        screen.see(DRIVES)
        screen.see(FASTER_THAN_ROLLING)
        screen.press(FOCUS_LOST)
        screen.see(LET_GO)
        screen.press(b"d")
        screen.see("report  ")
        assert screen.end() == 0
        assert "\x1b[?1004l\x1b[<u" in screen.everything, "the terminal is left as it was"
    run = only_run(tmp_path)
    assert_left_at_rest(run)
    assert (run / "paths/driven.csv").read_text().startswith("x,y,heading\n")


@pytest.mark.slow
@pytest.mark.realtime
def test_terminal_that_answers_no_more_stops_the_robot(tmp_path: Path) -> None:
    with terminal(mission(tmp_path)) as screen:
        screen.hear = answer
        screen.see(LET_GO)
        screen.press(TELLS_RELEASE + UP)
        screen.see(DRIVES)
        screen.see(FASTER_THAN_ROLLING)
        screen.hear = None
        screen.see("INP-03 keys")
        screen.see("stopped|release the controls")
        screen.hear = answer
        screen.press(b"q")
        screen.see("report  ")
        assert screen.end() == 1
    run = only_run(tmp_path)
    assert [mode for mode in modes_of(run) if mode != "ready"][-3:] == ["teleop", "quickstop", "end"]
    assert_left_at_rest(run)
