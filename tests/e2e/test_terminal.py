"""A person at a terminal: keys, the changing line, Ctrl-C. The terminal is a pseudo-terminal."""

from __future__ import annotations

import os
import re
import signal
import termios
from pathlib import Path

import pytest
from command_line import PATIENCE, assert_left_at_rest, endless_mission, modes_of, only_run, write_mission
from pseudo_terminal import terminal

REAL_TIME = "simulation: {pace: real_time}\n"
CTRL_C, CTRL_Z = b"\x03", b"\x1a"
WIPE = r"\r\x1b\[2K"


@pytest.mark.realtime
def test_space_stops_r_goes_on_and_q_ends(tmp_path: Path) -> None:
    with terminal(endless_mission(tmp_path, more=REAL_TIME)) as screen:
        assert "keys: space quick stop, a acknowledge, r arm again, q end" in screen.see("listening")
        screen.see_driving()
        screen.press(CTRL_Z)  # must not suspend a process that drives
        screen.press(b" ")
        screen.see("stopped: arm to continue")
        screen.press(b"r")
        screen.see("following")
        screen.press(b"q")
        screen.see("report  ")
        assert screen.end() == 1
        assert termios.tcgetattr(screen.device) == screen.before
    run = only_run(tmp_path)
    assert [mode for mode in modes_of(run) if mode != "ready"][-4:] == ["follow", "quickstop", "follow", "end"]
    assert_left_at_rest(run)


@pytest.mark.sampled(2)
@pytest.mark.realtime
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_a_real_time_run_in_order(tmp_path: Path, number: signal.Signals, status: int) -> None:
    with terminal(endless_mission(tmp_path, more=REAL_TIME)) as screen:
        screen.see_driving()
        screen.process.send_signal(number)
        screen.see(f"ended by {number.name}; drives stopped and released")
        assert screen.end() == status
    assert modes_of(only_run(tmp_path))[-2:] == ["follow", "end"]
    assert_left_at_rest(only_run(tmp_path))


@pytest.mark.realtime
def test_a_terminal_that_is_closed_stops_the_robot(tmp_path: Path) -> None:
    with terminal(endless_mission(tmp_path, more=REAL_TIME)) as screen:
        screen.see_driving()
        os.close(screen.device)
        os.close(screen.host)
        assert screen.process.wait(timeout=PATIENCE) == 128 + signal.SIGHUP
    run = only_run(tmp_path)
    assert modes_of(run)[-3:] == ["follow", "quickstop", "end"]
    assert_left_at_rest(run)


@pytest.mark.slow
@pytest.mark.realtime
def test_a_key_answers_the_question_that_is_asked(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, more=REAL_TIME)
    steps = mission.read_text().partition("  - calibrate")[0], REAL_TIME
    mission.write_text('  - ask: {question: "which way?", answers: [left, right]}\n'.join(steps))
    with terminal(mission) as screen:
        screen.see("1 to 9 answer")
        screen.see("which way?")
        screen.press(b"2")
        screen.see("answer     2")
        assert screen.end() == 0


@pytest.mark.slow
def test_ctrl_c_ends_a_run_on_virtual_time(tmp_path: Path) -> None:
    with terminal(endless_mission(tmp_path)) as screen:
        assert "keys:" not in screen.see("following")
        screen.press(CTRL_C)
        screen.see("report  ")
        assert screen.end() == 128 + signal.SIGINT
    assert_left_at_rest(only_run(tmp_path))


@pytest.mark.slow
def test_the_changing_line_shows_the_way_and_fits_the_terminal(tmp_path: Path) -> None:
    lines: dict[int, list[str]] = {}
    with terminal(endless_mission(tmp_path)) as screen:
        screen.see("following")
        for columns in (110, 60, 10):
            screen.resize(columns)
            screen.see(WIPE)
            while len(screen.see(WIPE)) >= columns:  # still on its way when the terminal became narrower
                pass
            lines[columns] = [screen.see(WIPE) for _ in range(3)]
    for columns, shown in lines.items():
        assert max(map(len, shown)) < columns
    motion = r" +\d+\.\d\d s  follow     [+-]0\.\d\d m/s +[+-]\d+\.\d°"
    distance = r"  cross-track +[+-]\d+ mm +\d+\.\d of \d+\.\d m  [█░]+"
    assert all(re.fullmatch(motion + distance, line) for line in lines[110]), lines


@pytest.mark.slow
def test_a_fault_is_red_unless_colour_is_not_wanted(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, more="simulation: {true_robot: {supply: {battery_v: 7}}}\n")
    with terminal(mission) as screen:
        screen.see(r"\x1b\[31m +\d+\.\d\d s  FAULT      [A-Z]{3}-\d\d ")
        assert screen.end() == 1
    with terminal(mission, no_colour=True) as screen:
        assert not re.search(r"\x1b\[\d+m", screen.see("report  "))
