"""What an error says can always be written down, and what there is stands in the tree."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator

import pytest
from extras import PACKAGES

import artemis
from artemis import errors
from artemis.errors import DeviceBusy, DeviceLost, DeviceTimeout, NotKept, WrongDevice


@pytest.mark.parametrize("kind", [DeviceBusy, DeviceLost, DeviceTimeout, NotKept, WrongDevice])
def test_a_device_whose_name_is_no_text_is_told_all_the_same(kind: type[DeviceLost]) -> None:
    error = kind("stick", "/dev/input/js\udcff: größer")
    assert error.problem == r"/dev/input/js\udcff: größer"
    assert str(error) == rf"stick: {error.problem}"


def test_an_error_that_stands_where_its_text_belongs_is_told() -> None:
    assert DeviceLost("stick", OSError("gone")).problem == "gone"  # type: ignore[arg-type]


PRIVATE = {"AccessRefused", "_Refused"}
"""Never leave their rooms: what a simulated drive answers, and what a scanner does."""


def kinds_of(kind: type) -> Iterator[type]:
    subs: list[type] = kind.__subclasses__()
    for sub in subs:
        yield sub
        yield from kinds_of(sub)


def test_the_tree_of_errors_shows_all_of_them() -> None:
    for module in pkgutil.walk_packages(artemis.__path__, "artemis."):
        if not module.name.endswith("__main__"):
            try:
                importlib.import_module(module.name)
            except ModuleNotFoundError as error:
                if str(error.name).partition(".")[0] not in PACKAGES:
                    raise
    named = {kind.__name__ for kind in kinds_of(errors.ArtemisError) if kind.__module__.startswith("artemis.")}
    assert named >= {"ConfigError", "SdoAbort"}
    missing = {
        name for name in named - PRIVATE if not any(name in line for line in (errors.__doc__ or "").splitlines())
    }
    assert not missing
