"""A known device in memory: plugged in, held and moved as a test says, read by the plugin `gamepad`."""

from __future__ import annotations

from pathlib import Path

from hid_devices import DESCRIPTORS, DEVICES

from artemis.devices.hid.descriptor import Descriptor, parse_descriptor
from artemis.devices.hid.port import HidInfo
from artemis.errors import DeviceLost
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.gamepad import GamepadInput
from artemis.plugins.inputs.gamepad_config import GamepadConfig
from artemis.plugins.inputs.profiles import Profile, all_profiles, profile_named
from artemis.testing.fake_hid import FakeHid
from artemis.values import OperatorInput, Request
from artemis.vehicle import RobotFile
from artemis.yaml_file import load

MISSIONS = Path(__file__).parents[2] / "missions"
ROBOT = RobotFile.model_validate(load(MISSIONS / "robots" / "artemis.yaml").data)
TICK = 0.02
NAMES = sorted(it.name for it in all_profiles() if {part.source for part in it.parts.values()} == {"hidraw"})


def device_of(profile: Profile) -> str:
    """The device of the data set with a profile's very descriptor."""
    from hashlib import sha256

    digests = {sha256(raw).hexdigest()[:16]: name for name, raw in DESCRIPTORS.items()}
    return digests[profile.parts[""].digest]


def encode(descriptor: Descriptor, report_id: int, levels: dict[str, int], count: int = 0) -> bytes:
    """A report with these values of its fields; others are 0. A count is its last byte, behind all fields."""
    fields = [field for field in descriptor.fields if field.report_id == report_id]
    whole = 0
    for field in fields:
        whole |= (levels.get(field.name, 0) & (1 << field.bits) - 1) << field.bit
    last = max(field.bit + field.bits for field in fields)
    return (
        bytes([report_id] if descriptor.has_report_ids else [])
        + whole.to_bytes((last + 7) // 8 + 3, "little")
        + bytes([count])
    )


class Pad:
    """One device, and the plugin that reads it. Times pass with `tick`."""

    def __init__(self, profile: str = "logitech-extreme-3d-pro", *, plugged: bool = True, **keys: object) -> None:
        self.profile = profile_named(profile)
        name = device_of(self.profile)
        self.raw = DESCRIPTORS[name]
        self.descriptor = parse_descriptor(self.raw)
        usage = self.descriptor.application
        self.info = HidInfo(
            "/dev/hidraw0",
            DEVICES[name]["bus"],
            self.profile.parts[""].vendor,
            self.profile.parts[""].product,
            "",
            name,
            0,
            usage,
        )
        self.hid, self.now, self.woken, self.count = FakeHid(), 0.0, 0, 0
        self.levels: dict[str, int] = {}
        self.release()
        if plugged:
            self.hid.plug(self.info, self.raw)
        context = PluginContext(name="stick", robot=ROBOT, folder=MISSIONS, wake=self._wake)
        self.plugin = GamepadInput(GamepadConfig.model_validate({"profile": profile, **keys}), context, self.hid)

    def _wake(self) -> None:
        self.woken += 1

    def release(self) -> None:
        """Let go of everything."""
        self.levels = {field.name: field.maximum + 1 for field in self.descriptor.fields if field.name == "hat"}
        for axis in self.profile.axes.values():
            rest = axis.maximum if axis.inverted else axis.minimum
            self.levels[axis.field] = rest if axis.centre is None else axis.centre

    def move(self, **shares: float) -> None:
        """Move axes by their roles, each from -1 (a pedal: 0) to 1."""
        for role, share in shares.items():
            axis = self.profile.axes[role]
            share = -share if axis.inverted else share
            if axis.centre is None:
                begin = axis.maximum if axis.inverted else axis.minimum
                self.levels[axis.field] = round(begin + share * (axis.maximum - axis.minimum))
            else:
                distance = axis.maximum - axis.centre if share > 0 else axis.centre - axis.minimum
                self.levels[axis.field] = round(axis.centre + share * distance)

    def press(self, *roles: str, down: bool = True) -> None:
        """Press buttons by their roles, or release them."""
        for role in roles:
            self.levels[self.profile.buttons[role]] = int(down)

    def send(self) -> None:
        """The device reports its levels."""
        number = next(f.report_id for f in self.descriptor.fields if f.name in self.levels)
        self.count = (self.count + 1) % 256
        self.hid.send(encode(self.descriptor, number, self.levels, self.count))

    def tick(self, seconds: float = TICK, *, reports: bool = False) -> OperatorInput:
        """Let time pass, read at each tick, at each with a report if it `reports`; the last sample."""
        for _ in range(round(seconds / TICK)):
            if reports:
                self.send()
            self.now += TICK
            sample = self.plugin.read(self.now)
        return sample

    def requests(self) -> list[Request]:
        """What the next tick asks for."""
        return list(self.tick().requests)

    def ready(self) -> OperatorInput:
        """Found, at rest for long enough, then the enable button pressed."""
        self.tick()
        self.send()
        self.tick(0.6, reports=self.profile.reports != "on_change")
        self.press("enable")
        self.send()
        return self.tick()

    def is_lost(self) -> bool:
        """Whether the next tick finds no device."""
        try:
            self.tick()
        except DeviceLost:
            return True
        return False
