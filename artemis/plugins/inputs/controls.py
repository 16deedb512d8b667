"""Devices in the terms of a profile: values of fields become levels of axes and buttons by their roles.

Where the values come from does not matter here: `values_of` takes them from the reports of a HID device.
"""

from __future__ import annotations

from collections.abc import Mapping

from artemis.devices.hid.descriptor import Descriptor, Field
from artemis.errors import HidError
from artemis.plugins.inputs.chain import calibrate, calibrate_pedal
from artemis.plugins.inputs.hands import AXES
from artemis.plugins.inputs.profiles import AxisProfile, Profile, hat_direction, off_direction

BESIDE = 67.5
"""A hat switch points into a direction, or beside it, if it is off by less [degrees]."""


def named_fields(part: str, descriptor: Descriptor) -> dict[str, Field]:
    """Fields of a profile's device `part` (empty: its only one) by the names that the profile has for them."""
    return {f"{part}/{field.name}" if part else field.name: field for field in descriptor.fields}


def values_of(part: str, descriptor: Descriptor, report: bytes) -> dict[str, int] | None:
    """Values in a report of a profile's device `part`, by such names; None: it is unknown or has no fields.

    Raises:
        HidError: it is too short.
    """
    decoded = descriptor.decode(report)
    return decoded if decoded is None or not part else {f"{part}/{name}": value for name, value in decoded.items()}


class Controls:
    """Remembers the levels of a profile's controls."""

    def __init__(self, profile: Profile, fields: Mapping[str, Field]) -> None:
        """Begin with nothing known. `fields`: of all its devices, see `named_fields`; they fit the profile."""
        self._axes = [profile.axes[role] for role in AXES[profile.kind]]
        self._ranges = [(axis.field, fields[axis.field].minimum, fields[axis.field].maximum) for axis in self._axes]
        where = {role: hat_direction(name) for role, name in profile.buttons.items()}
        self._buttons = [(role, name, fields[name], direction) for role, (name, direction) in where.items()]
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

    def take(self, values: Mapping[str, int]) -> None:
        """Take the values of some fields.

        Raises:
            HidError: an axis is where the device has none. Nothing is changed then.
        """
        for name, minimum, maximum in self._ranges:
            if not minimum <= values.get(name, minimum) <= maximum:
                raise HidError(f"{name} is {values[name]}, outside of {minimum} to {maximum}")
        self._values.update(values)
        self.known = self.known or all(name in self._values for name, _, _ in self._ranges)
        self.down = frozenset(role for role, name, field, where in self._buttons if self._is_down(name, field, where))
        if self.known:
            self.raw = tuple(float(self._values[name]) for name, _, _ in self._ranges)
            self.axes = tuple(calibrated(raw, axis) for raw, axis in zip(self.raw, self._axes, strict=True))

    def _is_down(self, name: str, field: Field, direction: float | None) -> bool:
        """Of a hat switch: it points there, or beside it; a released one points nowhere."""
        value = self._values.get(name)
        if value is None or direction is None:
            return bool(value)
        return off_direction(value, field, direction) < BESIDE


def calibrated(raw: float, axis: AxisProfile) -> float:
    """Share of an axis' travel: in [-1, 1], of one without a centre in [0, 1]."""
    if axis.centre is None:
        return calibrate_pedal(raw, axis.minimum, axis.maximum, axis.inverted)
    return calibrate(raw, axis.minimum, axis.centre, axis.maximum, axis.inverted)
