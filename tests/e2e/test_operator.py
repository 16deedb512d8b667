"""`artemis operator` and a robot's run, two processes on one computer."""

from __future__ import annotations

import shutil
import signal
import stat
import subprocess
from io import StringIO
from pathlib import Path
from unittest.mock import patch

import pytest
from command_line import (
    MISSIONS,
    ROBOT,
    artemis,
    artemis_here,
    assert_left_at_rest,
    only_run,
    read_until,
    started,
    stream,
)
from pseudo_terminal import Terminal, terminal

from artemis_lab.bench.ports import free_port

UP, UP_RELEASED, TELLS_RELEASE, THERE = b"\x1b[1;1:1A", b"\x1b[1;1:3A", b"\x1b[?2u", b"\x1b[0n"


def answer(screen: Terminal, seen: str) -> None:
    for _ in range(seen.count("\x1b[5n")):
        screen.press(THERE)


def pair(typed: str, *options: str) -> subprocess.CompletedProcess[str]:
    with patch("sys.stdin", StringIO(typed)):
        return artemis_here("operator", "pair", *options)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    return tmp_path


def mission(folder: Path) -> tuple[Path, int]:
    """That of the docs, without its calibration, on a port of its own."""
    port = free_port()
    (folder / "robots").mkdir()
    shutil.copy(ROBOT, folder / "robots")
    text = (MISSIONS / "network_teleop.yaml").read_text()
    text = text.replace("  - calibrate: {steering: from_potentiometers}\n", "")
    path = folder / "network_teleop.yaml"
    path.write_text(text.replace("plugin: network\n", f"plugin: network\n    port: {port}\n"))
    return path, port


def test_pairing_both_sides(folder: Path) -> None:
    one = pair("\n")
    place = folder / "config/artemis/operator.secret"
    assert (one.returncode, stat.S_IMODE(place.stat().st_mode)) == (0, 0o600)
    phrase = one.stdout.splitlines()[1].strip()
    again = pair("\n")
    assert (again.returncode, "there is a secret already; --force" in again.stderr) == (2, True)
    other = pair(f"{phrase.upper()}\n", "--secret", str(folder / "there"))
    assert (other.returncode, (folder / "there").read_bytes()) == (0, place.read_bytes())
    wrong = pair("abcd-efgh-jkmn-pqrs\n", "--secret", str(folder / "third"))
    assert (wrong.returncode, wrong.stderr) == (2, "phrase: a letter is wrong: compare it with the other side's\n")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["robot:0"], "robot:0: expected HOST, HOST:PORT or [IPV6]:PORT"),
        ([":7482"], "expected HOST"),
        (["127.0.0.1", "--input", "nothing"], "no plugin 'nothing'"),
        (["127.0.0.1", "--input", "network"], "`network` is the robot's side"),
        (["127.0.0.1", "--input", "keyboard", "--option", "speed"], "--option speed: write a key of the input"),
        (
            ["127.0.0.1", "--input", "keyboard", "--option", "sped=1"],
            "keyboard: sped: unknown key; known keys: max_speed_m_s, ",
        ),
        (["127.0.0.1", "--mission", str(MISSIONS / "teleop_joystick.yaml"), "--input", "x"], "there are: stick"),
        (["127.0.0.1", "--tls", "none.pem"], "--tls none.pem: No such file"),
        (["127.0.0.1", "--secret", "none"], "none: there is no secret yet: artemis operator pair"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_sent(folder: Path, arguments: list[str], words: str) -> None:
    if "--secret" not in arguments:
        from artemis.bridges.operator.pairing import default_place, write_secret

        write_secret(default_place(), bytes(32))
    done = artemis_here("operator", *arguments)
    assert done.returncode == 2
    assert words in done.stderr


def test_a_robot_that_is_not_there(folder: Path) -> None:
    from artemis.bridges.operator.pairing import default_place, write_secret

    write_secret(default_place(), bytes(32))
    _, port = mission(folder)
    done = artemis("operator", f"127.0.0.1:{port}", "--input", "keyboard")
    assert done.returncode == 1
    assert done.stderr == (
        f"artemis: 127.0.0.1 port {port}: Connection refused; does the run of the robot listen there?\n"
    )


@pytest.mark.exhaustive
@pytest.mark.realtime
def test_an_operator_drives_loses_the_link_and_goes_on(folder: Path) -> None:
    pair("\n")
    path, port = mission(folder)
    address = f"127.0.0.1:{port}"
    with started("run", path) as robot:
        read_until(robot, "remote was not heard yet")
        with terminal(
            Path(address),
            160,
            command=("operator", "--input", "keyboard", "--name", "alice", "--option", "speed_range=1"),
        ) as screen:
            screen.hear = answer
            screen.see("ARTEMIS at .*: you have it, up to 0.5 m/s; it lets you acknowledge, arm, end")
            screen.press(TELLS_RELEASE)
            with started("operator", address, "--input", "keyboard", "--name", "bob") as second:
                screen.see("teleop: hold the operator's enable button")  # a terminal answers all the time
                assert second.wait(timeout=60) == 2
                assert "refused: alice at 127.0.0.1 has the robot" in stream(second.stderr).read()
            screen.press_until(UP, r"teleop: driving \(your commands count\)")  # it was not answered for a while
            screen.press_until(UP, r"\+0\.[1-5]\d m/s .* DRIVING +age +\d+ ms +round trip")
            screen.process.send_signal(signal.SIGSTOP)  # as a computer that is put to sleep
            assert "INP-" not in read_until(robot, "NET-01")
            screen.press(UP_RELEASED)
            screen.process.send_signal(signal.SIGCONT)
            screen.see("quickstop: stopped: arm to continue")
            screen.press_until(b"r", "teleop: hold the operator's enable button")
            with started("operator", address, "--stop") as visitor:
                screen.see("quickstop: stopped: arm to continue")
                assert visitor.wait(timeout=60) == 0
                assert stream(visitor.stdout).read().split() == "stop a quick stop was asked for".split()
            screen.press_until(b"e", "the run has ended")  # a request that is older than 0.25 s has no effect
            assert screen.end() == 0
        assert robot.wait(timeout=60) == 1, "ended before its last step"
    run = only_run(folder)
    assert_left_at_rest(run)
    assert artemis("replay", run).returncode == 0


@pytest.mark.exhaustive
@pytest.mark.realtime
def test_a_script_drives_to_the_end_and_ctrl_c_releases(folder: Path) -> None:
    pair("\n")
    path, port = mission(folder)
    (folder / "idle.csv").write_text("time_s,x,y,enable\n0,0,0,0\n100,0,0,0\n")
    (folder / "done.csv").write_text("time_s,x,y,enable,done\n0,0,0,0,0\n4,0,0,0,0\n4.1,0,0,0,1\n100,0,0,0,0\n")
    address = f"127.0.0.1:{port}"
    with started("run", path) as robot:
        read_until(robot, "remote was not heard yet")
        with started("operator", address, "--input", "scripted", "--option", f"file={folder / 'idle.csv'}") as first:
            read_until(first, "you have it")
            read_until(first, "teleop")
            first.send_signal(signal.SIGINT)
            assert first.wait(timeout=60) == 130
        with started("operator", address, "--input", "scripted", "--option", f"file={folder / 'done.csv'}") as second:
            read_until(second, "the run has ended")
            assert second.wait(timeout=60) == 0
        assert robot.wait(timeout=60) == 0
