"""The plugin `lms1xx` keeps the contract of scanners."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pytest
from pydantic import ValidationError
from scanner_rig import spiral

from artemis.plugins.contracts import PluginContext
from artemis.plugins.scanners.lms1xx import Lms1xxConfig, Lms1xxScanner
from artemis.sim.lms100 import Lms100
from artemis.testing.scanners import ScannerContract


class TestLms1xx(ScannerContract):
    plugin = Lms1xxScanner
    options: Mapping[str, object] = {"host": "192.168.0.1"}

    def given(self) -> PluginContext:
        """A simulated device stands in."""
        return replace(super().given(), dial=Lms100(spiral).dial)


class TestLms1xxSlow(TestLms1xx):
    options: Mapping[str, object] = {"host": "192.168.0.1", "frequency_hz": 25, "resolution_deg": 0.25}
    duration = 20.0


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"resolution_deg": 0.25}, "0.25 needs frequency_hz: 25"),
        ({"resolution_deg": 1.0}, "expected 0.25 or 0.5, found 1"),
        ({"frequency_hz": 30}, "25 or 50"),
        ({"host": ""}, "at least 1 character"),
        ({"port": 0}, "greater than or equal to 1"),
    ],
)
def test_what_the_device_cannot_do_is_refused(options: Mapping[str, object], problem: str) -> None:
    with pytest.raises(ValidationError, match=problem):
        Lms1xxConfig.model_validate({"host": "192.168.0.1", **options})
