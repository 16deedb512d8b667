"""`artemis calibrate input`: teach artemis a joystick, gamepad or wheel, in a dialogue at the terminal."""

from __future__ import annotations

import asyncio
import re
import select
import sys
from collections.abc import Mapping, Sequence
from itertools import permutations
from pathlib import Path
from typing import Protocol, TypeVar

from artemis import clock
from artemis.devices.hid.descriptor import Descriptor, is_control
from artemis.devices.hid.identity import Identity
from artemis.devices.hid.port import HidInfo, HidPort
from artemis.devices.hid.reader import HidReader
from artemis.devices.inputs import InputPorts, layout_of
from artemis.errors import ConfigError, DeviceLost, HidError, shown
from artemis.plugins.inputs.controls import named_fields, values_of
from artemis.plugins.inputs.hands import Kind
from artemis.plugins.inputs.profiles import (
    NAME,
    DeviceKey,
    Profile,
    ProfileDevice,
    misfits,
    own_folder,
    part_of,
    profile_from,
    text_of,
)
from artemis.plugins.inputs.teach import Learnt, lesson
from artemis.plugins.inputs.teachable import Lesson, Moment, Unteachable, kinds_for
from artemis.whole_files import write_bytes

EVERY = 0.005
"""The device and the keyboard are looked at so often [s]."""
FIND = 3.0
"""So long the device may take to open [s]."""
INTERRUPTED = 130
KINDS: dict[Kind, str] = {
    "stick": "one stick steers and drives",
    "wheel": "a wheel (or a stick) steers, one pedal (or trigger) drives, one brakes",
    "levers": "one axis steers, another one sets the speed: two sticks, a throttle lever, a trigger",
}
"""What each kind of control is, in the person's words."""
_USAGES = {0x10002: "a mouse", 0x10006: "a keyboard", 0x10007: "a keypad", 0x10001: "a pointer"}
Answer = TypeVar("Answer", bound=str)


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


def calibrate_input(devices: Sequence[str], name: str | None, output: Path | None) -> int:
    """Teach a device, or several that are held together. Returns the exit status.

    Raises:
        ConfigError: no terminal, or wrong words.
        DeviceLost: no such device, or it was unplugged.
        Unteachable: a device does not fit, or nobody did what was asked.
    """
    if not sys.stdin.isatty():
        raise ConfigError("calibrate input: a person at a terminal is needed")
    try:
        return clock.run(teach(InputPorts(), Terminal(), devices, name, output), simulated=False)
    except KeyboardInterrupt:
        sys.stdout.write("\ninterrupted: nothing was written\n")
        return INTERRUPTED


async def teach(port: HidPort, person: Dialogue, devices: Sequence[str], name: str | None, output: Path | None) -> int:
    """The whole dialogue with a person; writes the profile only when that is confirmed."""
    if name is not None and not re.fullmatch(NAME, name):
        raise ConfigError(f"--name {shown(name)}: expected at most 64 small letters, digits and hyphens")
    infos = _parts([_chosen(port, device) for device in devices] or [_chosen(port, None)])
    for part, info in infos.items():
        person.say(f"{part}: {info}" if part else str(info))
    readers = {part: _reader(port, info) for part, info in infos.items()}
    try:
        for reader in readers.values():
            await _opened(reader)
        kind, learnt = await _taught(readers, person)
        identities = {part: Identity.of(infos[part], reader.descriptor) for part, reader in readers.items()}
    except Unteachable as error:
        who = " with ".join(map(str, infos.values()))
        raise Unteachable(f"{who}: {error}; nothing was written") from error
    finally:
        for reader in readers.values():
            reader.close()
    taught = _profile(name or _name_of(next(iter(infos.values()))), kind, identities, learnt)
    for part, reader in readers.items():
        if problems := misfits(taught, layout_of(infos[part], reader.descriptor), part):
            raise Unteachable(
                f"{infos[part]}: the profile would not fit it: {'; '.join(problems)}; nothing was written"
            )
    names = " and ".join(info.name or "nameless device" for info in infos.values())
    text = f"# {names[:1].upper()}{names[1:]}, taught with `artemis calibrate input`.\n{text_of(taught)}"
    path = output or own_folder() / f"{taught.name}.yaml"
    person.say(text)
    verb = "replace" if path.exists() else "write"
    if await _ask(person, f"{verb} {path}?", ("no", "yes")) != "yes":
        person.say("nothing was written")
        return 1
    _write(path, text)
    person.say(f"written; a mission uses it with {{plugin: gamepad, profile: {taught.name}}}")
    return 0


def _reader(port: HidPort, info: HidInfo) -> HidReader:
    return HidReader(port, lambda other, _: other.path == info.path, threaded=False)


async def _taught(readers: Mapping[str, HidReader], person: Dialogue) -> tuple[Kind, Learnt]:
    """What is held, and what the lesson finds.

    Raises:
        Unteachable: the devices do not fit, or nobody did what was asked.
    """
    descriptors = _layouts(readers)
    fields = {name: field for part, it in descriptors.items() for name, field in named_fields(part, it).items()}
    kinds = kinds_for(fields)
    words = "; ".join(f"{kind}: {KINDS[kind]}" for kind in kinds)
    kind = await _ask(person, f"a stick, a wheel, or levers? {words}", kinds)
    learnt = await _do(lesson(kind, fields), readers, person)
    used = {part_of(name)[0] for name in [*(axis.field for axis in learnt.axes.values()), *learnt.buttons.values()]}
    if unused := sorted(readers.keys() - used):
        raise Unteachable(f"no axis and no button of {', '.join(unused)} was used: teach without it")
    return kind, learnt


def _parts(infos: Sequence[HidInfo]) -> dict[str, HidInfo]:
    """The devices by the names that the profile will have for them; the only one has none.

    Raises:
        ConfigError: one of them twice.
    """
    if len(set(infos)) < len(infos):
        raise ConfigError("--device: two of them are the same device")
    if len(infos) == 1:
        return {"": infos[0]}
    for one, other in permutations(infos, 2):
        same = (one.vendor, one.product) == (other.vendor, other.product)
        if same and one.serial in ("", other.serial):
            raise ConfigError(f"{one} and {other} cannot be told apart: they have no serial numbers of their own")
    parts: dict[str, HidInfo] = {}
    for info in infos:
        name = _name_of(info)
        parts[f"{name[:60]}-{len(parts) + 1}" if name in parts else name] = info
    return parts


def _chosen(port: HidPort, wanted: str | None) -> HidInfo:
    """The device of that `vendor:product` or serial number; or the only one.

    Raises:
        DeviceLost: there is none, or there are several; or it is something else.
    """
    present = port.enumerate()
    found = [info for info in present if not info.usage or is_control(info.usage)]
    matching = found if wanted is None else [info for info in found if _is_called(info, wanted)]
    if len(matching) == 1:
        return matching[0]
    if not matching and wanted is not None:
        for other in (info for info in present if _is_called(info, wanted)):
            usage = _USAGES.get(other.usage, f"something of usage {other.usage >> 16:04x}:{other.usage & 0xFFFF:04x}")
            raise DeviceLost("calibrate input", f"{other} says that it is {usage}: no joystick, gamepad or wheel")
    there = "".join(f"\n  {info}" for info in found)
    what = (
        "several devices are plugged in" if matching else f"no {wanted or 'joystick, gamepad or wheel'} is plugged in"
    )
    hint = f"; choose with --device VENDOR:PRODUCT, or a serial number:{there}" if found else ""
    raise DeviceLost("calibrate input", what + hint)


def _is_called(info: HidInfo, wanted: str) -> bool:
    return wanted.lower() in (f"{info.vendor:04x}:{info.product:04x}", info.serial.lower() or None)


async def _opened(reader: HidReader) -> None:
    loop = asyncio.get_running_loop()
    latest = loop.time() + FIND
    while not reader.generation:
        reader.take(loop.time())
        if loop.time() > latest:
            raise DeviceLost("calibrate input", reader.error)
        await clock.until(loop.time() + EVERY)


def _layouts(readers: Mapping[str, HidReader]) -> dict[str, Descriptor]:
    """What the reports of each device contain, once it was opened."""
    return {part: layout_of(it.info, it.descriptor) for part, it in readers.items() if it.info is not None}


async def _do(lesson: Lesson[Learnt], readers: Mapping[str, HidReader], person: Dialogue) -> Learnt:
    """Hold a lesson: each report is a moment, and so is each look at the keyboard."""
    loop = asyncio.get_running_loop()
    descriptors = _layouts(readers)
    values: dict[str, int] = {}
    said, text = "", next(lesson)
    while True:
        if text != said:
            person.say(text)
            said = text
        await clock.until(loop.time() + EVERY)
        moments = []
        for part, reader in readers.items():
            for report in reader.take(loop.time()):
                decoded = undescribed = None
                try:
                    decoded = values_of(part, descriptors[part], report)
                    if decoded is None:
                        undescribed = f"ID 0x{report[0]:02x}" if descriptors[part].has_report_ids else "no ID"
                except HidError as error:
                    undescribed = str(error)
                values = {**values, **(decoded or {})}
                heard = None if decoded is None else part
                moments.append(Moment(time=loop.time(), values=values, heard=heard, undescribed=undescribed))
            if reader.state == "lost":
                raise DeviceLost("calibrate input", reader.error)
        moments.append(Moment(time=loop.time(), values=values, typed=person.typed()))
        for moment in moments:
            try:
                text = lesson.send(moment)
            except StopIteration as end:
                learnt: Learnt = end.value
                return learnt


async def _ask(person: Dialogue, question: str, answers: Sequence[Answer]) -> Answer:
    """Which of the answers is given; their first letters will do."""
    loop = asyncio.get_running_loop()
    person.say(f"{question} [{'/'.join(answers)}]")
    while True:
        await clock.until(loop.time() + EVERY)
        typed = person.typed()
        matching = [answer for answer in answers if typed and answer.startswith(typed.lower())]
        if len(matching) == 1:
            return matching[0]
        if typed is not None:
            person.say(f"{' or '.join(answers)}?")


def _profile(name: str, kind: Kind, identities: Mapping[str, Identity], learnt: Learnt) -> Profile:
    keys = {
        part: ProfileDevice.model_validate(
            {
                "bus": identity.bus,
                "vendor": identity.vendor,
                "product": identity.product,
                "descriptor" if identity.source == "hidraw" else "capabilities": identity.descriptor_hash,
                "reports": learnt.reports[part] if identity.source == "hidraw" else "on_change",
            }
        )
        for part, identity in identities.items()
    }
    alike = {part for one, other in permutations(keys, 2) if keys[one].may_be(keys[other]) for part in (one, other)}
    only = keys.get("")
    return Profile(
        name=name,
        device=None if only is None else DeviceKey.model_validate(only.model_dump(exclude={"reports", "serial"})),
        devices={
            part: key.model_copy(update={"serial": identities[part].serial or None}) if part in alike else key
            for part, key in keys.items()
            if part
        },
        kind=kind,
        reports=None if only is None else only.reports,
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
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from error
    write_bytes({path: text.encode()})
