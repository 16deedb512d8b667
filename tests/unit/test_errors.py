"""What an error says can always be written down."""

from __future__ import annotations

import pytest

from artemis.errors import DeviceBusy, DeviceLost, DeviceTimeout, NotKept, WrongDevice


@pytest.mark.parametrize("kind", [DeviceBusy, DeviceLost, DeviceTimeout, NotKept, WrongDevice])
def test_a_device_whose_name_is_no_text_is_told_all_the_same(kind: type[DeviceLost]) -> None:
    error = kind("stick", "/dev/input/js\udcff: größer")
    assert error.problem == r"/dev/input/js\udcff: größer"
    assert str(error) == rf"stick: {error.problem}"


def test_an_error_that_stands_where_its_text_belongs_is_told() -> None:
    assert DeviceLost("stick", OSError("gone")).problem == "gone"  # type: ignore[arg-type]
