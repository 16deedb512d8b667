"""`artemis calibrate input`: teach artemis a joystick, gamepad or wheel, in a dialogue at the terminal."""

from __future__ import annotations

import asyncio
import re
import select
import sys
from pathlib import Path
from typing import Protocol

from artemis import clock
from artemis.devices.hid.descriptor import is_control, parse_descriptor
from artemis.devices.hid.identity import Identity
from artemis.devices.hid.port import HidInfo, HidPort, Hidraw
from artemis.devices.hid.reader import HidReader
from artemis.errors import ConfigError, DeviceLost, HidError, shown
from artemis.plugins.inputs.hands import Kind
from artemis.plugins.inputs.profiles import NAME, DeviceKey, Profile, own_folder, profile_from, text_of
from artemis.plugins.inputs.teach import Learnt, Lesson, Moment, lesson

EVERY = 0.005
"""The device and the keyboard are looked at so often [s]."""
FIND = 3.0
"""So long the device may take to open [s]."""
INTERRUPTED = 130


class Dialogue(Protocol):
    """The person."""

    def say(self, text: str) -> None:
        """Tell a line."""

    def typed(self) -> str | None:
        """A line that was typed since the last call, without its end; None: none. Never waits."""


class Terminal:
    """The person at standard input and output."""

    def say(self, text: str) -> None:
        """Tell a line."""
        sys.stdout.write(text + "\n")
        sys.stdout.flush()

    def typed(self) -> str | None:
        """A line that was typed.

        Raises:
            ConfigError: the terminal is closed.
        """
        if not select.select([sys.stdin], [], [], 0.0)[0]:
            return None
        line = sys.stdin.readline()
        if not line:
            raise ConfigError("the terminal was closed; nothing was written")
        return line.strip()


def calibrate_input(device: str | None, name: str | None, output: Path | None) -> int:
    """Teach a device. Returns the exit status.

    Raises:
        ConfigError: no terminal, or wrong words.
        DeviceLost: no such device, or it was unplugged.
    """
    if not sys.stdin.isatty():
        raise ConfigError("calibrate input: a person at a terminal is needed")
    try:
        return clock.run(teach(Hidraw(), Terminal(), device, name, output), simulated=False)
    except KeyboardInterrupt:
        sys.stdout.write("\ninterrupted: nothing was written\n")
        return INTERRUPTED


async def teach(port: HidPort, person: Dialogue, device: str | None, name: str | None, output: Path | None) -> int:
    """The whole dialogue with a person; writes the profile only when that is confirmed."""
    if name is not None and not re.fullmatch(NAME, name):
        raise ConfigError(f"--name {shown(name)}: expected at most 64 small letters, digits and hyphens")
    info = _chosen(port, device)
    person.say(str(info))
    kind: Kind = (
        "wheel" if await _ask(person, "a stick (joystick, gamepad), or a wheel?", ("stick", "wheel")) else "stick"
    )
    reader = HidReader(port, lambda other, _: other.path == info.path, threaded=False)
    try:
        await _opened(reader)
        learnt = await _do(lesson(kind, parse_descriptor(reader.descriptor)), reader, person)
        identity = Identity.of(info, reader.descriptor)
    finally:
        reader.close()
    taught = _profile(name or _name_of(info), kind, identity, learnt)
    text = f"# {info.name or 'Nameless device'}, taught with `artemis calibrate input`.\n{text_of(taught)}"
    path = output or own_folder() / f"{taught.name}.yaml"
    person.say(text)
    verb = "replace" if path.exists() else "write"
    if not await _ask(person, f"{verb} {path}?", ("no", "yes")):
        person.say("nothing was written")
        return 1
    _write(path, text)
    person.say(f"written; a mission uses it with {{plugin: gamepad, profile: {taught.name}}}")
    return 0


def _chosen(port: HidPort, wanted: str | None) -> HidInfo:
    """The device of that `vendor:product` or serial number; or the only one.

    Raises:
        DeviceLost: there is none, or there are several.
    """
    found = [info for info in port.enumerate() if not info.usage or is_control(info.usage)]
    if wanted is not None:
        names = {info: (f"{info.vendor:04x}:{info.product:04x}", info.serial) for info in found}
        matching = [info for info in found if wanted.lower() in (word.lower() for word in names[info] if word)]
    else:
        matching = found
    if len(matching) == 1:
        return matching[0]
    there = "".join(f"\n  {info}" for info in found)
    what = (
        "several devices are plugged in" if matching else f"no {wanted or 'joystick, gamepad or wheel'} is plugged in"
    )
    hint = f"; choose with --device VENDOR:PRODUCT, or a serial number:{there}" if found else ""
    raise DeviceLost("calibrate input", what + hint)


async def _opened(reader: HidReader) -> None:
    loop = asyncio.get_running_loop()
    latest = loop.time() + FIND
    while not reader.generation:
        reader.take(loop.time())
        if loop.time() > latest:
            raise DeviceLost("calibrate input", reader.error)
        await clock.until(loop.time() + EVERY)


async def _do(lesson: Lesson[Learnt], reader: HidReader, person: Dialogue) -> Learnt:
    """Hold a lesson: each report is a moment, and so is each look at the keyboard."""
    loop = asyncio.get_running_loop()
    descriptor, values = parse_descriptor(reader.descriptor), dict[str, int]()
    said, text = "", next(lesson)
    while True:
        if text != said:
            person.say(text)
            said = text
        await clock.until(loop.time() + EVERY)
        moments = []
        for report in reader.take(loop.time()):
            try:
                values = {**values, **(descriptor.decode(report) or {})}
            except HidError as error:
                person.say(f"skipped: {error}")
                continue
            moments.append(Moment(time=loop.time(), values=values, heard=True))
        if reader.state == "lost":
            raise DeviceLost("calibrate input", reader.error)
        moments.append(Moment(time=loop.time(), values=values, typed=person.typed()))
        for moment in moments:
            try:
                text = lesson.send(moment)
            except StopIteration as end:
                learnt: Learnt = end.value
                return learnt


async def _ask(person: Dialogue, question: str, answers: tuple[str, str]) -> bool:
    """Whether the second of two answers is given; their first letters will do."""
    loop = asyncio.get_running_loop()
    person.say(f"{question} [{answers[0]}/{answers[1]}]")
    while True:
        await clock.until(loop.time() + EVERY)
        typed = person.typed()
        matching = [answer for answer in answers if typed and answer.startswith(typed.lower())]
        if len(matching) == 1:
            return matching[0] == answers[1]
        if typed is not None:
            person.say(f"{answers[0]} or {answers[1]}?")


def _profile(name: str, kind: Kind, identity: Identity, learnt: Learnt) -> Profile:
    key = DeviceKey.model_validate(
        {
            "bus": identity.bus,
            "vendor": identity.vendor,
            "product": identity.product,
            "descriptor": identity.descriptor_hash,
        }
    )
    return Profile(
        name=name,
        device=key,
        kind=kind,
        reports=learnt.reports,
        gate=learnt.gate,
        axes=learnt.axes,
        buttons=learnt.buttons,
    )


def _name_of(info: HidInfo) -> str:
    """A profile's name made of the device's."""
    return (
        re.sub("[^a-z0-9]+", "-", info.name.lower()).strip("-")[:64] or f"device-{info.vendor:04x}-{info.product:04x}"
    )


def _write(path: Path, text: str) -> None:
    """Put the file there, whole or not at all.

    Raises:
        ConfigError: it cannot be written.
    """
    profile_from(text.encode(), str(path))
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_text(text)
        part.replace(path)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from error
