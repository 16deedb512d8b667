"""`artemis doctor`: what of this computer would keep a robot from driving, and for each finding what repairs it."""

from __future__ import annotations

import asyncio
import json
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import PackageNotFoundError, entry_points, requires, version
from pathlib import Path
from typing import TYPE_CHECKING

from packaging.requirements import Requirement

from artemis import clock
from artemis.build import described, install
from artemis.commands.doctor_page import page_findings, priority
from artemis.commands.findings import FAILURE, NOTE, OK, WARNING, Finding
from artemis.errors import ConfigError, DeviceLost
from artemis.mission.extras import SLOWER
from artemis.mission.loading import LoadedMission, load_mission
from artemis.planning import is_simulated
from artemis.plugins.registry import CONTRACTS, listing
from artemis.recording.disk import MIN_FREE, Disk
from artemis.supervision.catalogue import ROWS

if TYPE_CHECKING:
    from artemis.devices.evdev.nodes import EventNode

CHECKS = "artemis.checks"
"""Entry points of packages that add checks: functions without arguments that give an iterable of `Finding`."""
DEVELOPERS = ("dev", "web-tests")
"""Extras that nobody needs to drive a robot."""
CAN_LINK = 280
"""Type of a CAN interface in Linux (ARPHRD_CAN, linux/if_arp.h)."""
PERIOD, SECONDS = 0.02, 5.0
"""Ticks of the timing check [s], and how long it lasts [s]."""
PATIENCE = 10.0
"""A program of the system has this long to answer [s]."""
NETWORK = Path("/sys/class/net")


def examine(mission: Path | None, *, report: bool) -> int:
    """Print the findings; the exit status: 1 if one is a failure.

    Args:
        mission: Also what it needs: its files, its bus, its drives, room where it records.
        report: All versions as well, and what is as it should be.
    """
    loaded, problems = None, list[Finding]()
    if mission is not None:
        try:
            loaded = load_mission(mission)
            problems.append(Finding(OK, f"mission {mission}"))
        except ConfigError as error:
            problems += [Finding(FAILURE, problem) for problem in error.problems]
    failed = _show("artemis", _software(report), report)
    failed |= _show("plugins", _plugins(), report)
    if mission is not None:
        failed |= _show("mission", problems, report)
    failed |= _show("CAN", _can(loaded), report)
    failed |= _show("input devices", _inputs(), report)
    failed |= _show("disk", _disk(loaded, mission), report)
    failed |= _show("page for operators", page_findings(), report)
    failed |= _show("clock", _clock(), report)
    failed |= _show("priority", priority(), report)
    failed |= _show(f"timing: {SECONDS:g} s of {1 / PERIOD:g} ticks a second", _timing(), report)
    for point in sorted(entry_points(group=CHECKS)):
        failed |= _show(point.name, _of_others(point.load), report)
    return int(failed)


def _show(title: str, findings: Iterable[Finding], everything: bool) -> bool:
    """Print one part as its checks end; whether anything failed."""
    sys.stdout.write(f"{title}\n")
    failed, quiet = False, True
    for found in findings:
        failed |= found.grade is FAILURE
        if found.grade is OK and not everything and not quiet:
            continue
        quiet = False
        sys.stdout.write(f"  {found.grade.value:8}  {found.what}\n")
        for line in found.remedy.splitlines():
            sys.stdout.write(f"            {line}\n")
        sys.stdout.flush()
    return failed


def _software(everything: bool) -> Iterator[Finding]:
    yield Finding(OK, f"{described()}, {platform.platform()}")
    missing = set[str]()
    for text in requires("artemis-robot") or ():
        need = Requirement(text)
        extra = _extra(need)
        if need.name == "artemis-robot" or extra in DEVELOPERS:
            continue  # the extra `all` names the others
        try:
            found = version(need.name)
        except PackageNotFoundError:
            if extra is None:
                yield Finding(FAILURE, f"{need.name} is not installed", f"pip install '{need.name}{need.specifier}'")
            elif extra not in missing:
                missing.add(extra)
                costs = f": {'; '.join(SLOWER)}" if extra == "slam" else ""
                yield Finding(NOTE, f"extra {extra} is not installed{costs}", install(extra))
            continue
        if not need.specifier.contains(found, prereleases=True):
            grade = FAILURE if extra is None else WARNING
            yield Finding(
                grade, f"{need.name} {found}: too old or too new", f"pip install '{need.name}{need.specifier}'"
            )
        elif everything:
            yield Finding(OK, f"{need.name} {found}")


def _extra(need: Requirement) -> str | None:
    """The extra that a requirement belongs to; None: every installation has it."""
    _, _, extra = str(need.marker or "").partition("extra == ")
    return extra.strip("\"'") or None


def _plugins() -> Iterator[Finding]:
    count = 0
    for group in CONTRACTS:
        for found in listing(group, check=True):
            count += 1
            if found.error:
                repair = f"repair it, or: pip uninstall {found.distribution}" if found.distribution else ""
                yield Finding(WARNING, found.error, repair)
    yield Finding(OK, f"{count} plugins")


# ------------------------------------------------------------------------------------------------------------- CAN


def _can(loaded: LoadedMission | None) -> Iterator[Finding]:
    links = list(can_links(NETWORK, _link_details()))
    yield from links
    if not links:
        known = "this computer has no CAN interface of the Linux kernel"
        yield Finding(NOTE, known, "`artemis devices` also looks for adapters with drivers of their makers")
    if loaded is None or is_simulated(loaded):
        return
    from artemis.commands.devices import open_bus
    from artemis.devices.inventory import ask_nodes

    async def ask() -> list[Finding]:
        bus = open_bus(loaded, False)
        try:
            return [
                Finding(
                    FAILURE if node.problem else OK, f"{node.name}, node {node.node_id}: {node.problem or 'answers'}"
                )
                for node in await ask_nodes(loaded.robot, bus)
            ]
        finally:
            bus.close()

    try:
        yield from clock.run(ask(), simulated=False)
    except DeviceLost as error:
        yield Finding(FAILURE, str(error))


def can_links(network: Path, details: dict[str, dict[str, object]]) -> Iterator[Finding]:
    """CAN interfaces of the kernel, from `/sys/class/net` and what `ip -details -json link show` says of each."""
    for place in sorted(network.iterdir()) if network.is_dir() else ():
        try:
            if int((place / "type").read_text()) != CAN_LINK:
                continue
        except (OSError, ValueError):
            continue  # gone meanwhile, or no interface
        yield _link(place.name, details.get(place.name, {}))


def _link(name: str, details: dict[str, object]) -> Finding:
    info = details.get("linkinfo")
    info = info if isinstance(info, dict) else {}
    data = info.get("info_data", {})
    up = f"sudo ip link set {name} up type can bitrate 1000000"
    flags = details.get("flags")
    if not isinstance(flags, list):
        return Finding(NOTE, f"{name}: its state is not known: the command `ip` is missing or failed")
    if "UP" not in flags:
        return Finding(
            WARNING, f"{name} is down", f"sudo ip link set {name} up" if info.get("info_kind") == "vcan" else up
        )
    if info.get("info_kind") != "can":
        return Finding(OK, f"{name} is up ({info.get('info_kind', 'unknown kind')})")
    rate = data.get("bittiming", {}).get("bitrate")
    state = data.get("state", "unknown")
    if state != "ERROR-ACTIVE":
        again = f"sudo ip link set {name} down && {up}"
        return Finding(
            WARNING, f"{name} is up, {rate} bit/s, but {state}", f"look at cable, termination, bit rate; then: {again}"
        )
    if int(details.get("txqlen") or 0) < 100:  # type: ignore[call-overload]
        longer = f"sudo ip link set {name} txqueuelen 1000"
        return Finding(WARNING, f"{name} is up, {rate} bit/s; its queue is short: frames may be refused", longer)
    return Finding(OK, f"{name} is up, {rate} bit/s, {state}")


def _link_details() -> dict[str, dict[str, object]]:
    """What `ip` says of every interface, by name; empty where it cannot be asked."""
    if (ip := shutil.which("ip")) is None:
        return {}
    answer, _ = _asked(ip, "-details", "-json", "link", "show")
    try:
        return {link["ifname"]: link for link in json.loads(answer or "[]")}
    except (json.JSONDecodeError, KeyError):
        return {}


def _asked(*command: str) -> tuple[str, str]:
    """What a program of the system writes to its output, and to its errors; it has `PATIENCE`."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        return "", f"{Path(command[0]).name} does not answer"
    return done.stdout, done.stderr


# ---------------------------------------------------------------------------------------------------- the rest of it


def _inputs() -> Iterator[Finding]:
    from artemis.devices.evdev.nodes import event_nodes
    from artemis.devices.hid.port import Hidraw, udev_rule

    yield from event_inputs(event_nodes())
    try:
        devices = Hidraw().enumerate()
    except DeviceLost as error:
        yield Finding(WARNING, error.problem)
        return
    closed = [info for info in devices if not os.access(info.path, os.R_OK | os.W_OK)]
    for info in closed:
        yield Finding(NOTE, f"{info}: this user may not open it", f"if it is to drive: write {udev_rule(info)}")
    yield Finding(OK, f"{len(devices) - len(closed)} HID devices can be opened; `artemis devices` knows them")


def event_inputs(nodes: Iterable[EventNode]) -> Iterator[Finding]:
    """Of event nodes: those that somebody may drive with and hidraw does not show, and the motors of all that may."""
    from artemis.devices.evdev.nodes import udev_rule
    from artemis.devices.evdev.port import is_installed

    for node in nodes:
        if not node.drives:
            continue
        rule = f"write {udev_rule(node.info)}"
        permitted = os.access(node.info.path, os.R_OK | os.W_OK)
        if not node.hidraw and not is_installed():
            yield Finding(NOTE, f"{node.info}: is read by the extra evdev, which is missing", install("evdev"))
        if not node.hidraw and not permitted:
            yield Finding(NOTE, f"{node.info}: this user may not open it", f"if it is to drive: {rule}")
        elif (node.forces or node.lamps) and not permitted:
            yield Finding(NOTE, f"{node.info}: this user may not drive its motors", f"for rumble or force: {rule}")
        else:
            yield Finding(OK, f"{node.info}: this user may open it")


def _disk(loaded: LoadedMission | None, mission: Path | None) -> Iterator[Finding]:
    folder = Path.cwd() if loaded is None or mission is None else mission.parent / loaded.mission.record
    free = Disk().free(folder)
    place = next(place for place in (folder.absolute(), *folder.absolute().parents) if place.exists())
    if not os.access(place, os.W_OK):
        yield Finding(FAILURE, f"{place}: this user may not write there", "another folder: `record` of the mission")
    if free < MIN_FREE:
        yield Finding(FAILURE, f"{free / 1e9:.1f} GB free in {place}: too little to record a run", "delete old runs")
    else:
        yield Finding(OK, f"{free / 1e9:.0f} GB free in {place}")


def _clock() -> Iterator[Finding]:
    """Runs are timed by the monotonic clock; only their dates come from this one."""
    if (control := shutil.which("timedatectl")) is None:
        yield Finding(NOTE, "whether a time server keeps the date is not known: no timedatectl")
        return
    answer, problem = _asked(control, "show", "-p", "NTPSynchronized", "--value")
    match answer.strip():
        case "yes":
            yield Finding(OK, "a time server keeps the date")
        case "no":
            yield Finding(WARNING, "no time server keeps the date", "sudo timedatectl set-ntp true")
        case _:
            yield Finding(NOTE, f"whether a time server keeps the date is not known: {problem.partition('.')[0]}")


def _timing() -> Iterator[Finding]:
    late = sorted(clock.run(_lateness(), simulated=False))
    worst, usual = late[-1], late[int(0.99 * len(late))]
    words = f"99 of 100 ticks at most {1000 * usual:.1f} ms late, the latest {1000 * worst:.1f} ms"
    limit = ROWS["SYS-01"].within
    if worst > limit:
        stop = f"{words}; beyond {1000 * limit:.0f} ms the robot stops (SYS-01)"
        yield Finding(FAILURE, stop, "stop other programs; CPU governor `performance`; no power saving")
    elif worst > PERIOD:
        yield Finding(WARNING, f"{words}: more than a tick", "which other programs run on this computer?")
    else:
        yield Finding(OK, words)


async def _lateness() -> list[float]:
    """Of each tick against its schedule [s]."""
    loop = asyncio.get_running_loop()
    begun, late = loop.time(), list[float]()
    for number in range(1, int(SECONDS / PERIOD) + 1):
        due = begun + number * PERIOD
        await asyncio.sleep(due - loop.time())
        late.append(max(0.0, loop.time() - due))
    return late


def _of_others(load: Callable[[], Callable[[], Iterable[Finding]]]) -> Iterator[Finding]:
    """The findings of another package's check; a broken one is a finding."""
    try:
        yield from load()()
    except Exception as error:  # noqa: BLE001  a stranger's check may raise anything
        yield Finding(WARNING, f"the check is broken: {type(error).__name__}: {error}")
