"""What `artemis doctor` says of the page for operators, and of a service's or a container's rights."""

from __future__ import annotations

import os
import resource
import shutil
import socket
from datetime import datetime, timedelta
from pathlib import Path

import pytest

from artemis.clock import wall_date
from artemis.commands import doctor_page
from artemis.commands.doctor_page import page_findings, priority
from artemis.commands.findings import FAILURE, NOTE, OK, WARNING, Grade
from artemis.page import certificates
from artemis.page.access import key_place, read_key
from artemis_lab.bench.ports import free_port


@pytest.fixture(autouse=True)
def own_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.setattr(doctor_page, "PAGE_PORT", free_port())


def found() -> dict[Grade, list[str]]:
    by_grade: dict[Grade, list[str]] = {OK: [], NOTE: [], WARNING: [], FAILURE: []}
    for finding in page_findings():
        by_grade[finding.grade].append(f"{finding.what}: {finding.remedy}")
    return by_grade


def test_all_is_well_and_without_the_extra_nothing_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    assert [len(lines) for lines in found().values()] == [2, 0, 0, 0]
    monkeypatch.setattr(doctor_page, "find_spec", lambda name: None)
    assert [len(lines) for lines in found().values()] == [0, 1, 0, 0]


def test_a_key_that_others_read_or_nobody_keeps_or_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read_key(key_place())
    key_place().chmod(0o644)
    assert f"chmod 600 {key_place()}" in found()[FAILURE][0]
    key_place().chmod(0o600)
    key_place().write_text("half a k")
    assert "is no key of a page: remove it" in found()[FAILURE][0]
    monkeypatch.setattr(os, "access", lambda place, mode: False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "other"))
    assert "XDG_CONFIG_HOME" in found()[FAILURE][0]


def test_a_port_that_is_taken() -> None:
    with socket.create_server(("127.0.0.1", doctor_page.PAGE_PORT)):
        (line,) = found()[NOTE]
    assert "--page-port" in line


@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs the program openssl")
@pytest.mark.parametrize(
    ("days", "grade"), [(0, OK), (certificates.DAYS - 10, WARNING), (certificates.DAYS + 1, FAILURE)]
)
def test_a_certificate_that_ends(days: int, grade: Grade, monkeypatch: pytest.MonkeyPatch) -> None:
    certificates.make([])

    def later() -> datetime:
        return wall_date() + timedelta(days=days)

    monkeypatch.setattr(doctor_page, "wall_date", later)
    assert any("robot.pem" in line for line in found()[grade])


def test_a_certificate_that_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    place = certificates.place()
    place.mkdir(parents=True)
    for name in ("robot.pem", "robot.key"):
        (place / name).write_text("nothing")
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert "openssl is missing" in found()[NOTE][0]
    monkeypatch.undo()


@pytest.mark.parametrize(
    ("nice", "limit", "user", "words"),
    [
        (-15, 0, 1000, "its priority is raised (nice -15)"),
        (0, 40, 1000, "is not raised"),
        (0, 0, 0, "is not raised"),
        (0, 0, 1000, "may not raise its priority"),
    ],
)
def test_priority(nice: int, limit: int, user: int, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "getpriority", lambda which, who: nice)
    monkeypatch.setattr(os, "geteuid", lambda: user)
    monkeypatch.setattr(resource, "getrlimit", lambda which: (limit, limit))
    (finding,) = priority()
    assert words in finding.what
    assert finding.grade is (OK if nice < 0 else NOTE)
