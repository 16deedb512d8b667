"""A device in the terms of its profile: reports become levels of axes and buttons by their roles."""

from __future__ import annotations

from artemis.devices.hid.descriptor import Descriptor
from artemis.errors import HidError
from artemis.plugins.inputs.chain import calibrate, calibrate_pedal
from artemis.plugins.inputs.hands import AXES
from artemis.plugins.inputs.profiles import AxisProfile, Profile, hat_direction, misfits


class Controls:
    """Remembers the levels of one device's controls, report by report."""

    def __init__(self, profile: Profile, descriptor: Descriptor) -> None:
        """Begin with nothing known.

        Raises:
            HidError: the profile is not one of such a device.
        """
        problems = misfits(profile, descriptor)
        if problems:
            raise HidError(f"profile {profile.name}: {'; '.join(problems)}")
        fields = {field.name: field for field in descriptor.fields}
        self._descriptor = descriptor
        self._axes = [profile.axes[role] for role in AXES[profile.kind]]
        self._ranges = [(axis.field, fields[axis.field].minimum, fields[axis.field].maximum) for axis in self._axes]
        self._buttons = [(role, *hat_direction(name)) for role, name in profile.buttons.items()]
        self._hats = {hat: fields[hat].minimum for _, hat, direction in self._buttons if direction is not None}
        self._values: dict[str, int] = {}
        self.roles = tuple(profile.buttons)
        self.known = False
        """Every axis was heard of."""
        self.raw: tuple[float, ...] = ()
        """Counts of the axes, in the order of `AXES`."""
        self.axes: tuple[float, ...] = ()
        """Calibrated, in the order of `AXES`."""
        self.down: frozenset[str] = frozenset()
        """Roles of the buttons that are held."""

    def take(self, report: bytes) -> bool:
        """Take a report; whether it was one of this state (others carry the battery, or answers).

        Raises:
            HidError: it is too short, or an axis is where the device has none. Nothing is changed then.
        """
        decoded = self._descriptor.decode(report)
        if decoded is None:
            return False
        for name, minimum, maximum in self._ranges:
            if not minimum <= decoded.get(name, minimum) <= maximum:
                raise HidError(f"{name} is {decoded[name]}, outside of {minimum} to {maximum}")
        self._values.update(decoded)
        self.known = self.known or all(name in self._values for name, _, _ in self._ranges)
        self.down = frozenset(role for role, name, direction in self._buttons if self._is_down(name, direction))
        if self.known:
            self.raw = tuple(float(self._values[name]) for name, _, _ in self._ranges)
            self.axes = tuple(_calibrated(raw, axis) for raw, axis in zip(self.raw, self._axes, strict=True))
        return True

    def _is_down(self, name: str, direction: int | None) -> bool:
        """Of a hat switch: it points there, or beside it; a released one points nowhere."""
        value = self._values.get(name)
        if value is None or direction is None:
            return bool(value)
        eighth = value - self._hats[name]
        return 0 <= eighth < 8 and (eighth - direction + 1) % 8 <= 2


def _calibrated(raw: float, axis: AxisProfile) -> float:
    if axis.centre is None:
        return calibrate_pedal(raw, axis.minimum, axis.maximum, axis.inverted)
    return calibrate(raw, axis.minimum, axis.centre, axis.maximum, axis.inverted)
