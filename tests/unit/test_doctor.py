"""`artemis doctor`: what it finds on computers of all kinds."""

from __future__ import annotations

import asyncio
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest
from evdev_devices import EventDevice, FakeEvdev

from artemis import clock
from artemis.build import install
from artemis.commands import doctor
from artemis.commands.doctor import can_links, examine
from artemis.commands.findings import FAILURE, NOTE, OK, WARNING, Finding, Grade
from artemis.devices.evdev.nodes import event_nodes
from artemis.recording.disk import Disk

MISSIONS = Path(__file__).parents[2] / "missions"


MEASURED = doctor._lateness


@pytest.fixture(autouse=True)
def _on_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """How busy this computer is decides no test."""

    async def lateness() -> list[float]:
        return [0.0] * 100

    monkeypatch.setattr(doctor, "_lateness", lateness)


def links(tmp_path: Path, **details: Any) -> list[Finding]:  # noqa: ANN401 (JSON of `ip`)
    """A computer with the interfaces lo (Ethernet-like), and can0."""
    for name, kind in (("lo", "772"), ("can0", "280")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "type").write_text(kind + "\n")
    return list(can_links(tmp_path, {"can0": details} if details else {}))


def can(state: str = "ERROR-ACTIVE", **more: Any) -> dict[str, Any]:  # noqa: ANN401
    info = {"info_kind": "can", "info_data": {"state": state, "bittiming": {"bitrate": 1000000}}}
    return {"flags": ["NOARP", "UP", "LOWER_UP"], "txqlen": 1000, "linkinfo": info} | more


@pytest.mark.parametrize(
    ("details", "grade", "words", "remedy"),
    [
        ({}, NOTE, "its state is not known", ""),
        (can(flags=["NOARP"]), WARNING, "can0 is down", "ip link set can0 up type can bitrate 1000000"),
        ({"flags": [], "linkinfo": {"info_kind": "vcan"}}, WARNING, "can0 is down", "ip link set can0 up"),
        ({"flags": ["UP"], "linkinfo": {"info_kind": "vcan"}}, OK, "can0 is up (vcan)", ""),
        (can("BUS-OFF"), WARNING, "1000000 bit/s, but BUS-OFF", "termination"),
        (can(txqlen=10), WARNING, "its queue is short", "txqueuelen 1000"),
        (can(), OK, "can0 is up, 1000000 bit/s, ERROR-ACTIVE", ""),
    ],
)
def test_can_interfaces(tmp_path: Path, details: dict[str, Any], grade: Grade, words: str, remedy: str) -> None:
    (found,) = links(tmp_path, **details)
    assert found.grade is grade
    assert words in found.what
    assert remedy in found.remedy


def test_a_computer_without_network_folder_has_no_interface(tmp_path: Path) -> None:
    assert list(can_links(tmp_path / "none", {})) == []


def test_this_computer_can_run_a_simulated_mission(capsys: pytest.CaptureFixture[str]) -> None:
    assert examine(MISSIONS / "figure_eight.yaml", report=True) == 0
    shown = capsys.readouterr().out
    assert "mission" in shown
    assert "numpy" in shown
    assert "FAILURE" not in shown


def test_a_broken_mission_is_a_failure_with_its_place(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "m.yaml").write_text("mission: x\nrobot: none.yaml\nbus: simulation\nsteps: []\n")
    assert examine(tmp_path / "m.yaml", report=False) == 1
    assert f"FAILURE   {tmp_path}/m.yaml:" in capsys.readouterr().out


def test_drives_that_do_not_answer_are_failures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "robot.yaml").write_bytes((MISSIONS / "robots/artemis.yaml").read_bytes())
    bus = "{interface: virtual, channel: nobody-there}"
    (tmp_path / "m.yaml").write_text(f"mission: x\nrobot: robot.yaml\nbus: {bus}\nsteps: [{{wait: {{seconds: 1}}}}]\n")
    assert examine(tmp_path / "m.yaml", report=False) == 1
    shown = capsys.readouterr().out
    assert shown.count("no answer") == 4
    assert "FAILURE   steer-left, node 3" in shown


@pytest.mark.parametrize(
    ("late", "grade"), [([0.001] * 99 + [0.01], OK), ([0.0] * 99 + [0.03], WARNING), ([0.0] * 99 + [0.2], FAILURE)]
)
def test_ticks_that_come_late(monkeypatch: pytest.MonkeyPatch, late: list[float], grade: Grade) -> None:
    async def measured() -> list[float]:
        return late

    monkeypatch.setattr(doctor, "_lateness", measured)
    (found,) = doctor._timing()
    assert found.grade is grade


def test_a_computer_that_is_held_up_for_100_ms_is_so_late() -> None:
    async def measured() -> list[float]:
        loop = asyncio.get_running_loop()
        loop.call_at(1.01, clock.stall, 0.1)  # 10 ms after a tick, 10 ms before the next
        return await MEASURED()

    late = clock.run(measured(), simulated=True)
    assert len(late) == 250
    assert [round(each, 9) for each in late if each > 1e-9] == [0.09, 0.07, 0.05, 0.03, 0.01]


def test_a_missing_package_is_a_failure_and_a_missing_extra_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    needs = ["not-there-at-all>=1.0", 'nor-this>=2; extra == "ros"', "numpy>=999", 'nor-that; extra == "dev"']
    needs.append('nor-a-browser; extra == "web-tests"')
    monkeypatch.setattr(doctor, "requires", lambda name: needs)
    found = {each.what.split()[0]: each for each in doctor._software(everything=False)}
    assert found["not-there-at-all"].grade is FAILURE
    assert (found["extra"].grade, found["extra"].remedy) == (NOTE, install("ros"))
    assert found["numpy"].grade is FAILURE
    assert len(found) == 4  # and artemis itself


def test_an_extra_is_missing_once_and_what_only_developers_need_is_no_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    needs = ['nor-this; extra == "ros2"', 'nor-that; extra == "ros2"', 'numpy>=999; extra == "dev"']
    monkeypatch.setattr(doctor, "requires", lambda name: needs)
    _, *found = doctor._software(everything=False)
    assert [each.what for each in found] == ["extra ros2 is not installed"]


def test_what_takes_longer_without_the_extra_slam_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "requires", lambda name: ['not-there>=1; extra == "slam"'])
    _, found = doctor._software(everything=False)
    assert found.grade is NOTE
    assert found.what.startswith("extra slam is not installed: mapping takes ")
    assert "planning a route" in found.what
    assert found.remedy == install("slam")


def test_a_full_disk_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Disk, "free", lambda self, folder: 1000)
    (found,) = doctor._disk(None, None)
    assert found.grade is FAILURE


def boom() -> list[Finding]:
    raise ValueError("no sensor")


def fine() -> list[Finding]:
    return [Finding(OK, "all five sensors")]


def test_checks_of_other_packages_are_asked_and_may_break(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    points = [
        EntryPoint(name, f"{__name__}:{function}", doctor.CHECKS) for name, function in (("a", "boom"), ("b", "fine"))
    ]
    monkeypatch.setattr(doctor, "entry_points", lambda group: points if group == doctor.CHECKS else [])
    assert examine(None, report=False) == 0
    shown = capsys.readouterr().out
    assert "the check is broken: ValueError: no sensor" in shown
    assert "all five sensors" in shown


def test_a_program_of_the_system_that_does_not_answer_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("ip", "timedatectl"):
        (tmp_path / name).write_text("#!/bin/sh\nread never < /dev/zero\n")
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(doctor, "PATIENCE", 0.1)
    examine(None, report=False)
    assert "whether a time server keeps the date is not known: timedatectl does not answer" in capsys.readouterr().out


# ---------------------------------------------------------------------------------------------- event nodes


def event_findings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, **facts: Any) -> list[tuple[Grade, str, str]]:  # noqa: ANN401
    """What is said of one gamepad; `permitted` and `installed` as the test says."""
    permitted, installed = facts.pop("permitted", True), facts.pop("installed", True)
    FakeEvdev(tmp_path).plug(EventDevice(**facts))
    monkeypatch.setattr("os.access", lambda path, mode: permitted)
    monkeypatch.setattr("artemis.devices.evdev.port.find_spec", lambda name: object() if installed else None)
    return [(found.grade, found.what, found.remedy) for found in doctor.event_inputs(event_nodes(tmp_path))]


PAD = "Microsoft X-Box 360 pad (usb 045e:028e, /dev/input/event0)"


def test_a_pad_of_evdev_that_can_be_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert event_findings(tmp_path, monkeypatch) == [(OK, f"{PAD}: this user may open it", "")]


def test_a_pad_of_evdev_without_the_extra_and_without_permission(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    extra, permission = event_findings(tmp_path, monkeypatch, permitted=False, installed=False, forces=(0x50,))
    assert extra == (
        NOTE,
        f"{PAD}: is read by the extra evdev, which is missing",
        install("evdev"),
    )
    assert permission[:2] == (NOTE, f"{PAD}: this user may not open it")
    assert permission[2].startswith('if it is to drive: write KERNEL=="event*", ATTRS{id/vendor}=="045e"')


def test_motors_of_a_hid_pad_that_may_not_be_driven(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    facts = {"permitted": False, "installed": False, "forces": (0x50,), "hidraw": "hidraw0"}
    (found,) = event_findings(tmp_path, monkeypatch, **facts)
    assert found[:2] == (NOTE, f"{PAD}: this user may not drive its motors")
    assert found[2].startswith("for rumble or force: write KERNEL")


def test_event_nodes_that_nobody_drives_with_are_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert event_findings(tmp_path, monkeypatch, keys=(30,), permitted=False) == []
