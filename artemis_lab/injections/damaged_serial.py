"""A serial port whose line does to bytes what real ones do: between a computer and a drive, real or simulated."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass

from artemis.devices.serial_port import SerialPort
from artemis.errors import DeviceLost

BIT = 1


@dataclass(slots=True, kw_only=True)
class SerialDamage:
    """What is done to the bytes of one direction; may be changed while they pass. Numbers count down."""

    pass_first: int = 0
    """So many bytes pass whole before."""
    flip: int = 0
    """So many bytes have one wrong bit."""
    insert: bytes = b""
    """Comes between two bytes, once."""
    drop: int = 0
    """So many bytes disappear."""
    unplug: bool = False
    """The port is lost."""
    chance: float = 0.0
    """Besides: each byte is flipped, doubled or dropped with this probability."""


class DamagedSerialPort:
    """A `SerialPort` around another one."""

    def __init__(self, port: SerialPort, seed: int = 1) -> None:
        self.name = port.name
        self.to_drive, self.to_host = SerialDamage(), SerialDamage()
        self._port, self._dice = port, random.Random(seed)

    def write(self, data: bytes) -> None:
        """Send bytes. Raises DeviceLost: the port is gone."""
        if damaged := self._through(self.to_drive, data):
            self._port.write(damaged)

    def read(self) -> bytes:
        """Everything that arrived since the last call. Raises DeviceLost: the port is gone."""
        return self._through(self.to_host, self._port.read())

    def listen(self, wake: Callable[[], None]) -> None:
        """Have `wake` called when bytes have arrived, or when the port is lost."""
        self._port.listen(wake)

    def close(self) -> None:
        """Give the port back."""
        self._port.close()

    def _through(self, damage: SerialDamage, data: bytes) -> bytes:
        passed = bytearray()
        for byte in data:
            if damage.pass_first:
                damage.pass_first -= 1
                passed.append(byte)
                continue
            passed += damage.insert
            damage.insert = b""
            if damage.drop:
                damage.drop -= 1
            elif damage.flip:
                damage.flip -= 1
                passed.append(byte ^ BIT)
            else:
                passed += self._by_chance(damage.chance, byte)
        if damage.unplug and not damage.pass_first:
            raise DeviceLost(self.name, "was unplugged")
        return bytes(passed)

    def _by_chance(self, chance: float, byte: int) -> bytes:
        if not chance or self._dice.uniform(0.0, 1.0) >= chance:
            return bytes((byte,))
        return self._dice.choice((b"", bytes((byte, byte)), bytes((byte ^ 1 << self._dice.randrange(8),))))
