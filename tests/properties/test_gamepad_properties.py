"""Whatever a device does, and whatever it sends: it is enabled by a fresh press after rest, or not at all."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from artemis.devices.hid.descriptor import parse_descriptor
from artemis.devices.hid.port import HidInfo
from artemis.errors import DeviceLost, HidError
from artemis.plugins.answers import is_whole_input
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.gamepad import GamepadInput
from artemis.plugins.inputs.gamepad_config import GamepadConfig
from artemis.plugins.inputs.profiles import profile_named
from artemis.testing.fake_hid import FakeHid
from artemis.values import Request
from artemis.vehicle import RobotFile
from artemis.yaml_file import load

ROOT = Path(__file__).parents[2]
ROBOT = RobotFile.model_validate(load(ROOT / "missions" / "robots" / "artemis.yaml").data)
SETTINGS = settings(derandomize=True, deadline=None)
NAMES = {"logitech-extreme-3d-pro": "logitech_extreme_3d_pro", "sony-dualshock-4-usb": "dualshock4_usb"}


def descriptor_of(file: str) -> bytes:
    device: Any = load(ROOT / "tests" / "data" / "hid" / f"{file}.yaml").data
    return bytes.fromhex(device["report_descriptor"])


KNOWN = {name: (profile_named(name), descriptor_of(file), GamepadConfig(profile=name)) for name, file in NAMES.items()}

share = st.sampled_from([0.0, 0.0, 0.02, -0.03, 0.3, -1.0, 1.0])
act = st.one_of(
    st.tuples(st.sampled_from(["plug", "unplug", "freeze"])),
    st.tuples(st.just("send"), share, share, st.frozensets(st.sampled_from(["enable", "quickstop", "arm", "faster"]))),
    st.tuples(st.just("send"), st.just(0.0), st.just(0.0), st.just(frozenset())),
    st.tuples(st.just("send"), share, share, st.just(frozenset({"enable"}))),
    st.tuples(st.just("raw"), st.binary(max_size=80)),
    st.tuples(st.just("wait"), st.sampled_from([0.001, 0.02, 0.2, 0.7, 1.0, 5.0])),
)


class Watched:
    """A device, the plugin that reads it, and somebody who keeps account of both."""

    def __init__(self, name: str) -> None:
        self.profile, self.raw, config = KNOWN[name]
        self.descriptor = parse_descriptor(self.raw)
        key = self.profile.parts[""]
        self.info = HidInfo("/dev/hidraw0", key.bus, key.vendor, key.product, "", name, 0)
        self.hid, self.now = FakeHid(), 0.0
        self.plugged = self.frozen = False
        context = PluginContext(name="stick", robot=ROBOT, folder=ROOT)
        self.plugin = GamepadInput(config, context, self.hid)
        self.values: dict[str, int] = {}
        self.stops = 0
        self.rested = False

    def plug(self) -> None:
        if self.plugged:
            self.unplug()
        self.hid.plug(self.info, self.raw)
        self.plugged, self.frozen = True, False

    def unplug(self) -> None:
        if self.plugged:
            self.hid.unplug()
        self.plugged = False
        self.values, self.stops, self.rested = {}, 0, False

    def freeze(self) -> None:
        if self.plugged:
            self.hid.freeze()
            self.frozen = True

    def send(self, x: float, y: float, down: frozenset[str]) -> None:
        levels = {self.profile.buttons[role]: 1 for role in down}
        for role, distance in (("x", x), ("y", -y)):
            axis = self.profile.axes[role]
            assert axis.centre is not None
            end = axis.maximum if distance > 0 else axis.minimum
            levels[axis.field] = round(axis.centre + abs(distance) * (end - axis.centre))
        number = next(field.report_id for field in self.descriptor.fields if field.name == "x")
        whole = 0
        for field in self.descriptor.fields:
            if field.report_id == number:
                whole |= (levels.get(field.name, 0) & (1 << field.bits) - 1) << field.bit
        self.raw_report(bytes([number] if self.descriptor.has_report_ids else []) + whole.to_bytes(64, "little"))

    def raw_report(self, report: bytes) -> None:
        if not self.plugged:
            return
        if not self.frozen and self.hid.is_open():
            self._note(report)
        self.hid.send(report)

    def _note(self, report: bytes) -> None:
        try:
            decoded = self.descriptor.decode(report) or {}
        except HidError:
            return
        stop = self.profile.buttons["quickstop"]
        self.stops += bool(decoded.get(stop)) and not self.values.get(stop)
        self.values.update(decoded)

    def rests(self) -> bool:
        """Everything that was sent last is released."""
        if not self.values or self.values.get(self.profile.buttons["enable"]):
            return False
        distances = []
        for axis in self.profile.axes.values():
            assert axis.centre is not None
            distances.append((self.values[axis.field] - axis.centre) / (axis.maximum - axis.centre))
        return math.hypot(*distances) < 0.08  # of both gates, with what rounding does

    def tick(self, passed: float) -> None:
        self.now += passed
        try:
            sample = self.plugin.read(self.now)
        except DeviceLost:
            assert not self.plugged or not self.hid.is_open()
            return
        assert is_whole_input(sample)
        assert abs(sample.speed) <= ROBOT.limits.speed_m_s + 1e-9
        assert math.isfinite(sample.steering)
        assert not (sample.neutral and (sample.enabled or sample.speed))
        assert (Request.QUICKSTOP in sample.requests) == (self.stops > 0)
        self.stops = 0
        if sample.enabled:
            assert self.rested
            assert self.values[self.profile.buttons["enable"]]
        self.rested = self.rested or self.rests()


@SETTINGS
@given(st.lists(act, max_size=60), st.data())
@pytest.mark.parametrize("name", list(NAMES))
def test_nothing_enables_but_a_fresh_press_after_rest(
    name: str, acts: list[tuple[Any, ...]], data: st.DataObject
) -> None:
    watched = Watched(name)
    watched.plug()
    watched.tick(0.02)
    for what, *rest in acts:
        if what == "wait":
            watched.tick(*rest)
        elif what == "raw":
            watched.raw_report(*rest)
        else:
            getattr(watched, what)(*rest)
        if data.draw(st.booleans()):
            watched.tick(0.02)


def test_the_account_sees_an_enabled_device() -> None:
    watched = Watched("logitech-extreme-3d-pro")
    watched.plug()
    watched.tick(0.02)
    watched.send(0.0, 0.0, frozenset())
    for _ in range(40):
        watched.tick(0.02)
    watched.send(0.0, 1.0, frozenset({"enable"}))
    assert watched.plugin.read(watched.now + 0.02).enabled
    watched.rested = False
    with pytest.raises(AssertionError):
        watched.tick(0.04)
