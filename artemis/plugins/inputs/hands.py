"""What everything driven by hand shares, a device as a script: from calibrated controls to an operator's wish.

Buttons are known by their roles. What goes down asks for something, once; the direction of travel changes only near
standstill; the steering angle trails the hand's like a slack rope.
"""

from __future__ import annotations

import math
from collections.abc import Set
from dataclasses import dataclass
from typing import Literal, TypeAlias

from msgspec.structs import replace

from artemis.plugins.inputs.chain import centre_lever, centre_pedal, curve, push
from artemis.plugins.inputs.joystick import (
    STANDSTILL,
    Gate,
    Momentum,
    deflection_from_stick,
    speed_from_stick,
    steering_from_stick,
    step_range,
    trail,
)
from artemis.plugins.inputs.wheel import FAR_OFF_CENTRE, HARD_BRAKE, speed_from_pedals, steering_from_wheel
from artemis.values import OperatorInput, Request

Kind: TypeAlias = Literal["stick", "wheel", "levers"]
AXES: dict[Kind, tuple[str, ...]] = {
    "stick": ("x", "y"),
    "wheel": ("steering", "gas", "brake"),
    "levers": ("steering", "speed"),
}
"""Axes of each kind of control, in the order in which they are handed over. x and steering: right positive; y and
speed: forward positive; gas, brake and a one-sided speed: from 0, released, to 1."""
PEDALS = ("gas", "brake")
REQUESTS = {word: Request[word.upper()] for word in ("quickstop", "acknowledge", "arm", "end", "done", "record")}
BUTTONS: dict[Kind, tuple[str, ...]] = {
    "stick": ("enable", "faster", "slower", *REQUESTS),
    "wheel": ("enable", "faster", "slower", "reverse", *REQUESTS),
    "levers": ("enable", "faster", "slower", "reverse", *REQUESTS),
}
"""Roles of buttons that mean something to each kind of control."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Grip:
    """How the hands' controls are taken."""

    kind: Kind = "stick"
    top_speed: float
    """Speed at full deflection, or full gas, with the whole speed range [m/s]."""
    steering_limit: float
    """Angle at full deflection [rad]."""
    acceleration: float
    deceleration: float
    """How the robot follows a wished speed [m/s²]."""
    gate: Gate = "square"
    deadzone: float = 0.05
    """Share of the travel of a stick or a pedal that counts as released."""
    expo: float = 0.0
    """Of a stick's deflection, of a wheel's angle, or of both levers."""
    band: float = math.radians(1.0)
    """The angle in force trails the wished one by at most this much [rad]."""
    hard_brake: float = HARD_BRAKE


class Hands:
    """Remembers what is held, how far the speed range is open, and how fast the robot rolls, or may still."""

    def __init__(self, source: str, grip: Grip, speed_range: float) -> None:
        """`source` is the input's name; `speed_range` the share of the top speed to begin with."""
        self._source, self._grip, self._range = source, grip, speed_range
        self._axes: tuple[float, ...] = (0.0,) * len(AXES[grip.kind])
        self._down: Set[str] = frozenset()
        self._momentum = Momentum(grip.deceleration)
        self._steering = self._wished = self._rolling = 0.0
        self._last: float | None = None
        self._backwards = self._turns_round = False

    def grasp(self, axes: tuple[float, ...], down: Set[str]) -> list[Request]:
        """What the controls say next: calibrated axes in the order of `AXES`, and the roles that are down.

        Returns what is asked for, each thing once at its press.
        """
        if self._brakes_hard(axes):
            down = down | {"hard brake"}
        pressed = down - self._down
        self._axes, self._down = axes, down
        self._range = step_range(self._range, "faster" in pressed, "slower" in pressed)
        self._turns_round = self._turns_round or "reverse" in pressed
        requests = [request for role, request in REQUESTS.items() if role in pressed]
        if "hard brake" in pressed and Request.QUICKSTOP not in requests:
            requests.insert(0, Request.QUICKSTOP)
        return requests

    def hold(self, down: Set[str]) -> None:
        """What is `down` already when a device is taken up was not pressed, but for a stop."""
        self._down = down - {"quickstop"}

    def asks_to_stop(self, axes: tuple[float, ...], down: Set[str]) -> bool:
        """Whether the stop button is down, or the brake pressed hard."""
        return "quickstop" in down or self._brakes_hard(axes)

    def wish(self, now: float) -> OperatorInput:
        """What the newest axes wish at run time `now` [s], neutral if they rest; the steering angle trails."""
        grip = self._grip
        passed = 0.0 if self._last is None else now - self._last
        slowed = self._momentum.brake(passed)
        self._last = now
        up, down = self._rolling + grip.acceleration * passed, self._rolling - grip.deceleration * passed
        self._rolling = max(min(self._wished, up), down)
        match grip.kind:
            case "stick":
                wish = self._wish_of_stick()
            case "wheel":
                wish = self._wish_of_wheel(abs(slowed))
            case "levers":
                wish = self._wish_of_levers(abs(slowed))
        self._steering = trail(wish.steering, self._steering, grip.band, grip.steering_limit)
        speed = self._momentum.follow(wish.speed)
        self._wished = abs(speed)
        return replace(wish, speed=speed, steering=self._steering, age=0.0, axes=self._axes)

    def _wish_of_stick(self) -> OperatorInput:
        grip, (x, y) = self._grip, self._axes
        deflection = deflection_from_stick(x, y, grip.gate, grip.deadzone)
        shaped = curve(deflection, grip.expo)
        return OperatorInput(
            source=self._source,
            speed=speed_from_stick(y, shaped, self._range * grip.top_speed),
            steering=steering_from_stick(x, y, grip.steering_limit) if deflection > 0 else 0.0,
            neutral=deflection == 0,
            centred=push(x, y, grip.gate, deflection),
            shaped=push(x, y, grip.gate, shaped),
        )

    def _wish_of_wheel(self, slowed: float) -> OperatorInput:
        """The brake wins: while it is pressed, no gas makes the robot faster than it rolls."""
        grip, (turned, gas, _) = self._grip, self._axes
        gas, brake = centre_pedal(gas, grip.deadzone), self._brake(self._axes)
        shaped = curve(turned, grip.expo)
        speed = speed_from_pedals(gas, brake, grip.hard_brake, self._range * grip.top_speed)
        speed = min(speed, self._rolling) if brake > 0 else speed
        self._turn_round(slowed, released=gas == 0)
        return OperatorInput(
            source=self._source,
            speed=-speed if self._backwards else speed,
            steering=steering_from_wheel(shaped, grip.steering_limit),
            neutral=gas == 0 and brake == 0 and abs(turned) <= FAR_OFF_CENTRE,
            centred=(turned, gas, brake),
            shaped=(shaped, gas, brake),
        )

    def _wish_of_levers(self, slowed: float) -> OperatorInput:
        """Steering by one axis, speed by another; a one-sided speed is never negative, and goes back by `reverse`."""
        grip = self._grip
        steering, speed = (centre_lever(share, grip.deadzone) for share in self._axes)
        turned, pushed = curve(steering, grip.expo), curve(speed, grip.expo)
        self._turn_round(slowed, released=speed == 0)
        wished = pushed * self._range * grip.top_speed
        return OperatorInput(
            source=self._source,
            speed=-wished if self._backwards else wished,
            steering=steering_from_wheel(turned, grip.steering_limit),
            neutral=speed == 0 and abs(self._axes[0]) <= FAR_OFF_CENTRE,
            centred=(steering, speed),
            shaped=(turned, pushed),
        )

    def _turn_round(self, slowed: float, released: bool) -> None:
        """Change the direction of travel where that was asked for, at standstill with the speed released."""
        if self._turns_round and slowed <= STANDSTILL and released:
            self._backwards = not self._backwards
        self._turns_round = False

    def _brakes_hard(self, axes: tuple[float, ...]) -> bool:
        return self._grip.kind == "wheel" and len(axes) == 3 and self._brake(axes) >= self._grip.hard_brake

    def _brake(self, axes: tuple[float, ...]) -> float:
        return centre_pedal(axes[2], self._grip.deadzone)
