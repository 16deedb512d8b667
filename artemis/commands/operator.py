"""`artemis operator`: pairing, and what its arguments mean."""

from __future__ import annotations

import getpass
import socket
import ssl
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from artemis.bridges.operator.pairing import (
    default_place,
    new_phrase,
    phrase_from,
    read_secret,
    secret_from,
    write_secret,
)
from artemis.errors import ConfigError
from artemis.mission.actions import PluginUse
from artemis.mission.files import read_data
from artemis.mission.loading import load_mission, plugin_from
from artemis.plugins.contracts import InputDevice, PluginContext
from artemis.plugins.inputs.network import PORT
from artemis.plugins.stated import input_speed
from artemis.vehicle import RobotFile
from artemis.yaml_file import scalar

PAIR = "pair"
STICK = "stick"
"""Whatever joystick, gamepad or wheel is plugged in."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceChoice:
    """Which device the operator holds, by the words of the command line."""

    name: str
    """Of a plugin, or of an input in `mission`."""
    mission: Path | None = None
    options: Sequence[str] = ()
    """key=value, for a plugin without a mission."""

    def check(self) -> None:
        """Complain at once of what needs no robot. Raises ConfigError."""
        self._use()

    def made(self, context: PluginContext) -> InputDevice:
        """The device, for the robot of the context.

        Raises:
            ConfigError: something is wrong with its keys.
        """
        use, folder, files = self._use()
        plugin, config = plugin_from("artemis.inputs", use)
        limit = context.robot.limits.speed_m_s
        if (speed := input_speed(config)) is not None and speed > limit:
            config = config.model_copy(update={"max_speed_m_s": limit})
        made: InputDevice = plugin(
            config,
            PluginContext(
                name=self.name,
                robot=context.robot,
                folder=folder,
                files=files,
                wake=context.wake,
                typed=context.typed,
                real_time=True,
            ),
        )
        return made

    def _use(self) -> tuple[PluginUse, Path, dict[str, bytes]]:
        """The plugin with its keys, the folder that these count from, and the files that they name."""
        if self.mission is not None:
            loaded = load_mission(self.mission)
            inputs = loaded.mission.inputs
            if self.name not in inputs:
                there = ", ".join(inputs) or "none"
                raise ConfigError(f"--input {self.name}: {self.mission} has no such input; there are: {there}")
            if self.options:
                raise ConfigError("--option: the mission has the keys; leave it out")
            use = inputs[self.name]
            _refuse_network(use.plugin)
            return use, loaded.folder, dict(loaded.files)
        keys: dict[str, object] = {}
        for option in self.options:
            key, equals, value = option.partition("=")
            if not key or not equals:
                raise ConfigError(f"--option {option}: write a key of the input and its value, as max_speed_m_s=0.4")
            keys[key] = scalar(value)
        name = "gamepad" if self.name == STICK else self.name
        _refuse_network(name)
        use = PluginUse.model_validate({"plugin": name, **keys})
        plugin_from("artemis.inputs", use)
        named = [value for key, value in keys.items() if key == "file" or key.endswith("_file")]
        return use, Path(), {str(value): read_data(Path(str(value))) for value in named}


def pair(secret: Path | None, *, force: bool) -> None:
    """Make a phrase, or take the other side's, and keep the secret that it stands for.

    Raises:
        ConfigError: it is no phrase, there is a secret already, or it cannot be written.
    """
    place = secret or default_place()
    if place.exists() and not force:
        raise ConfigError(f"{place}: there is a secret already; --force replaces it, and all others pair again")
    sys.stdout.write("Phrase of the other side (enter: make a new one): ")
    sys.stdout.flush()
    typed = sys.stdin.readline() if sys.stdin is not None else ""
    phrase = phrase_from(typed) if typed.strip() else new_phrase()
    write_secret(place, secret_from(phrase), force=force)
    if not typed.strip():
        sys.stdout.write(
            f"\n  {phrase}\n\nType it at the other side after `artemis operator pair`, and keep it nowhere else.\n"
        )
    sys.stdout.write(f"secret written: {place}\n")


def address_from(text: str) -> tuple[str, int]:
    """Host and port of HOST, HOST:PORT, or [IPV6]:PORT.

    Raises:
        ConfigError: it is none of these.
    """
    host, port = text, str(PORT)
    if text.startswith("["):
        host, _, rest = text[1:].partition("]")
        port = rest[1:] if rest[:1] == ":" else rest or port
    elif text.count(":") == 1:
        host, _, port = text.partition(":")
    if not host or not port.isascii() or not port.isdigit() or not 0 < int(port) < 65536:
        raise ConfigError(f"{text}: expected HOST, HOST:PORT or [IPV6]:PORT, as 192.168.1.7:{PORT}")
    return host, int(port)


def trusted(certificate: Path | None) -> ssl.SSLContext | None:
    """TLS that trusts this certificate alone, whatever the robot is called; None: no TLS.

    Raises:
        ConfigError: the file is none of a certificate.
    """
    if certificate is None:
        return None
    try:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname = False
        context.minimum_version = ssl.TLSVersion.TLSv1_3
        context.load_verify_locations(certificate)
    except (OSError, ValueError) as error:
        raise ConfigError(f"--tls {certificate}: {getattr(error, 'strerror', None) or error}") from None
    return context


def operate(
    address: str,
    choice: DeviceChoice,
    secret: Path | None,
    certificate: Path | None,
    name: str,
    *,
    stop: bool = False,
) -> int:
    """Drive a robot from here; the exit status. `stop`: have it stop, and leave.

    Raises:
        ConfigError: refused, here or by the robot; nothing was driven.
        DeviceLost: the robot cannot be reached.
    """
    from artemis.commands.operator_drive import OperatorDrive, ask_to_stop

    host, port = address_from(address)
    key, tls = read_secret(secret or default_place()), trusted(certificate)
    if stop:
        return ask_to_stop(host, port, key, tls, name)
    choice.check()
    return OperatorDrive(host, port, key, tls, name, choice).run()


def user_name() -> str:
    """Who this is, for a robot's journal."""
    try:
        who = getpass.getuser()
    except (KeyError, OSError):  # a user without a name
        who = "operator"
    return f"{who}@{socket.gethostname()}"


def robot_from(told: bytes) -> RobotFile:
    """The robot that a welcome tells of. Raises ConfigError: this artemis does not understand it."""
    try:
        return RobotFile.model_validate_json(told)
    except ValidationError as error:
        problem = error.errors()[0]
        where = ".".join(map(str, problem["loc"]))
        raise ConfigError(f"the robot is of another version of artemis: {where}: {problem['msg']}") from None


def _refuse_network(plugin: str) -> None:
    if plugin == "network":
        raise ConfigError("--input: `network` is the robot's side; here a device is meant, such as stick or keyboard")
