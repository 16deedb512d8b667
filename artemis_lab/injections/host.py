"""Inputs, plugins, operators and a computer that misbehave: INP-.., PLG-.., PTH-.., OPR-.., SYS-.."""

from __future__ import annotations

import errno
import math
import signal
from collections.abc import Callable
from typing import Annotated, Any, Literal

from msgspec.structs import replace
from pydantic import Field, create_model

from artemis.clock import stall
from artemis.config import Config
from artemis.errors import DeviceLost
from artemis.values import OperatorInput, Request
from artemis_lab.injections import bad_plugins
from artemis_lab.injections.bad_plugins import BadInput, FollowerBehaviour, InputBehaviour
from artemis_lab.injections.stage import Count, Injection, Lasting, Nothing, Positive, Stage, Undo, together


class Input(Lasting):
    """Which of the mission's inputs; None: all."""

    input: str | None = None


class Plugin(Lasting):
    """Which of the mission's inputs; None: the follower."""

    input: str | None = None


class BadValue(Input):
    """What is wrong with its samples: a number, an axis beyond its stop, or no value at all."""

    value: Literal["nan", "inf", "beyond the stop", "a text as number"] = "nan"


class WishedMotion(Input):
    """What its axes wish for."""

    speed_m_s: float = 0.3
    steering_deg: float = 0.0


class Late(Plugin):
    """How long it takes, and how often."""

    seconds: Positive = 0.02
    times: Count = 3


class Garbage(Plugin):
    """What it returns."""

    returns: Literal["nothing", "a text", "a number"] = "nothing"


class NoNumber(Plugin):
    """What it asks for."""

    value: Literal["nan", "inf"] = "nan"


class TooMuch(Lasting):
    """What the follower asks for."""

    speed_m_s: float = 3.0
    steering_deg: float = 85.0


class Leak(Plugin):
    """How much memory it keeps at each call."""

    bytes_per_call: Annotated[int, Field(ge=1, le=100_000_000)] = 1_000_000


class Stall(Config):
    """How long the computer does nothing."""

    seconds: Positive = 1.0


class Files(Lasting):
    """Which files cannot be written."""

    files: Literal["recording", "journal", "both"] = "recording"


class Presses(Config):
    """How often, and how fast."""

    times: Count = 20
    rate_hz: Positive = 20.0


class Signal(Config):
    """What the process is sent."""

    signal: Literal["SIGTERM", "SIGINT"] = "SIGTERM"


# ---------------------------------------------------------------------------------------------- inputs and followers


def _chosen(stage: Stage, name: str | None) -> list[BadInput]:
    if name is None:
        return list(stage.inputs.values())
    if name not in stage.inputs:
        raise ValueError(f"needs one of the inputs {', '.join(stage.inputs) or '(there are none)'}, not {name}")
    return [stage.inputs[name]]


def _input(text: str, behaviour: Callable[[Any], InputBehaviour], parameters: type[Config] = Input) -> Injection:
    def act(stage: Stage, node: str | None, p: Any) -> Undo:  # noqa: ANN401 (one of the parameters above)
        devices = _chosen(stage, p.input)
        for device in devices:
            device.misbehave(behaviour(p))
        return together([lambda device=device: device.misbehave(None) for device in devices])  # type: ignore[misc]

    return Injection(text, act, parameters=parameters)


def _plugin(
    text: str, behaviour: Callable[[Any], Callable[[Any, float], Any]], parameters: type[Config] = Plugin
) -> Injection:
    """Of an input where one is named, else of the follower."""
    of_input = _input(text, behaviour, parameters)

    def act(stage: Stage, node: str | None, p: Any) -> Undo | None:  # noqa: ANN401 (one of the parameters above)
        if getattr(p, "input", None) is not None:
            return of_input.act(stage, node, p)
        for follower in stage.followers:
            follower.misbehave(behaviour(p))
        return together([lambda follower=follower: follower.misbehave(None) for follower in stage.followers])  # type: ignore[misc]

    return Injection(text, act, parameters=parameters, behaviour=behaviour)


def _bad_value(p: BadValue) -> InputBehaviour:
    if p.value == "beyond the stop":
        return lambda sample, _: replace(sample, axes=(7.0, *sample.axes[1:]))
    wrong: Any = "fast" if p.value == "a text as number" else float(p.value)
    return bad_plugins.becomes(speed=wrong)


def _wish(p: WishedMotion, **changes: Any) -> InputBehaviour:  # noqa: ANN401 (values of any field)
    steering = math.radians(p.steering_deg)
    return bad_plugins.becomes(speed=p.speed_m_s, steering=steering, neutral=False, age=0.0, **changes)


def _press(request: Request) -> InputBehaviour:
    """The button is pressed once."""
    pressed: list[bool] = []

    def behave(sample: OperatorInput, _now: float) -> OperatorInput:
        if pressed:
            return sample
        pressed.append(True)
        return replace(sample, requests=(*sample.requests, request))

    return behave


def _answer_late(p: Late) -> Callable[[Any, float], Any]:
    return bad_plugins.is_late(p.seconds, p.times)


def _garbage(p: Garbage) -> Callable[[object, float], Any]:
    return bad_plugins.returns({"nothing": None, "a text": "garbage", "a number": 1e300}[p.returns])


def _no_number(p: NoNumber) -> Callable[[Any, float], Any]:
    wrong = float(p.value)
    if p.input is not None:
        return bad_plugins.becomes(speed=wrong)
    return bad_plugins.commands(wrong, 0.0)


def _too_much(p: TooMuch) -> FollowerBehaviour:
    return bad_plugins.commands(p.speed_m_s, math.radians(p.steering_deg))


def _leak(p: Leak) -> Callable[[Any, float], Any]:
    return bad_plugins.leaks(p.bytes_per_call)


def _raise(_: Plugin) -> Callable[[object, float], Any]:
    return bad_plugins.raises(RuntimeError("told to fail"))


def _unplug(_: Input) -> InputBehaviour:
    return bad_plugins.raises(DeviceLost("input", "unplugged"))


# ---------------------------------------------------------------------------------------------- operator and computer


def _acknowledge(stage: Stage, node: str | None, _: Nothing) -> None:
    stage.request(Request.ACKNOWLEDGE)


def _acknowledge_on_and_on(stage: Stage, node: str | None, p: Presses) -> Undo:
    return stage.repeat(lambda: stage.request(Request.ACKNOWLEDGE), 1.0 / p.rate_hz, p.times)


def _stall(stage: Stage, node: str | None, p: Stall) -> None:
    stage.loop.call_soon(stall, p.seconds)  # not before the run has begun, whose time would begin later


def _stalls(text: str, seconds: float) -> Injection:
    return Injection(text, _stall, parameters=create_model("Stall", __base__=Stall, seconds=(Positive, seconds)))


def _have_a_bug(stage: Stage, node: str | None, _: Nothing) -> None:
    def fail() -> None:
        raise RuntimeError("told to fail")

    stage.loop.call_soon(fail)


def _refuse_to_write(error: int) -> Callable[[Stage, str | None, Files], Undo]:
    def refuse(stage: Stage, node: str | None, p: Files) -> Undo:
        if stage.disk is None:
            raise ValueError("needs a run that is recorded on a disk which can fail")
        stage.disk.fail("" if p.files == "both" else p.files, error)  # the beginning of their names
        return stage.disk.heal

    return refuse


def _send_signal(stage: Stage, node: str | None, p: Signal) -> None:
    signal.raise_signal(signal.Signals[p.signal])


HOST_INJECTIONS: dict[str, Injection] = {
    "INP-01": _input("input is unplugged", _unplug),
    "INP-03": _input("input freezes", lambda _: bad_plugins.freezes()),
    "INP-04": _input("input falls silent while it commands", lambda _: bad_plugins.freezes()),
    "INP-05": _input("input repeats its last report", lambda _: bad_plugins.freezes()),
    "INP-06": _input("input sends a bad value", _bad_value, BadValue),
    "INP-07": _input("axes do not rest", _wish, WishedMotion),
    "INP-08": _input("axes jump", lambda p: bad_plugins.jumps(p.speed_m_s), WishedMotion),
    "INP-09": _input("enable button is released", lambda _: bad_plugins.becomes(enabled=False)),
    "INP-10": _input("enable button is tied down", lambda _: bad_plugins.becomes(enabled=True, neutral=False)),
    "INP-11": _input("stop button is pressed", lambda _: _press(Request.QUICKSTOP)),
    "INP-12": _input("input wants to drive", lambda p: _wish(p, enabled=True), WishedMotion),
    "PLG-02": _plugin("plugin raises", _raise),
    "PLG-03": _plugin("plugin answers late", _answer_late, Late),
    "PLG-04": _plugin(
        "plugin holds the interpreter",
        _answer_late,
        create_model("Hold", __base__=Late, seconds=(Positive, 1.0), times=(Count, 1)),
    ),
    "PLG-05": _plugin("plugin leaks", _leak, Leak),
    "PLG-06": _plugin("plugin returns garbage", _garbage, Garbage),
    "PTH-08": _plugin("follower drives on beyond the end", lambda _: bad_plugins.holds_command(), Lasting),
    "PTH-09": _plugin("follower answers late", _answer_late, Late),
    "RUN-11": _plugin("command is not a number", _no_number, NoNumber),
    "RUN-12": _plugin("command is beyond the limits", _too_much, TooMuch),
    "COM-31": _stalls("the host's heartbeat comes late", 0.12),
    "SYS-01": _stalls("a tick comes late", 0.07),
    "SYS-03": _stalls("the computer sleeps", 1.0),
    "SYS-04": Injection("the program fails", _have_a_bug),
    "SYS-05": Injection("the process is asked to end", _send_signal, parameters=Signal),
    "SYS-07": _stalls("the process is stopped and continues", 1.0),
    "DSK-02": Injection("the disk is full", _refuse_to_write(errno.ENOSPC), parameters=Files),
    "DSK-05": Injection("the disk fails", _refuse_to_write(errno.EIO), parameters=Files),
    "OPR-01": Injection("the operator acknowledges", _acknowledge),
    "OPR-02": Injection("the operator acknowledges on and on", _acknowledge_on_and_on, parameters=Presses),
}
