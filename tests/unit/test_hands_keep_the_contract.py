"""The contract suite for authors of input devices, held against the built-in ones that a person moves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from pad import Pad

from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.gamepad import GamepadInput
from artemis.plugins.inputs.gamepad_config import GamepadConfig
from artemis.plugins.inputs.keyboard import KeyboardInput
from artemis.testing.contracts import InputContract

TELLS_RELEASE, UP = b"\x1b[?2u", b"\x1b[A"


class TestGamepad(InputContract):
    plugin = GamepadInput
    profile = "logitech-extreme-3d-pro"

    def make(self) -> GamepadInput:
        self.pad = Pad(self.profile)
        return GamepadInput(GamepadConfig(profile=self.profile), self.given(), self.pad.hid)

    def move(self, device: GamepadInput) -> None:
        self.pad.press("enable")
        self.pad.move(y=0.5)
        self.pad.send()


class TestGamepadThatAlwaysReports(TestGamepad):
    profile = "sony-dualshock-4-usb"


class TestKeyboard(InputContract):
    plugin = KeyboardInput

    def given(self) -> PluginContext:
        return replace(super().given(), typed=self._typed)

    def _typed(self, listener: Callable[[bytes], None]) -> bool:
        self.type = listener
        return True

    def move(self, device: KeyboardInput) -> None:
        self.type(TELLS_RELEASE + UP)
