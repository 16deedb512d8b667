"""Wrappers that pass through until they are told to misbehave."""

from __future__ import annotations

import asyncio
import math
from typing import Any

import pytest
from msgspec.structs import replace
from passing_plugins import Stick, Walker, at

from artemis.clock import run, stall
from artemis.errors import DeviceLost
from artemis.values import Request
from artemis_lab.injections import bad_plugins
from artemis_lab.injections.bad_plugins import BadFollower, BadInput

ASKING = Stick([Request.DONE])


def bad_stick(behaviour: bad_plugins.InputBehaviour | None) -> BadInput:
    device = BadInput(ASKING)
    device.misbehave(behaviour)
    return device


def test_untold_wrappers_pass_everything_through() -> None:
    stick, walker = Stick(), Walker()
    device, follower = BadInput(stick), BadFollower(walker)
    assert device.read(3.0) == stick.read(3.0)
    device.close()
    assert stick.closed
    follower.start(None, at(0.0))  # type: ignore[arg-type]  # the walker looks at no path
    assert walker.started == 1
    assert follower.step(at(3.0)) == walker.step(at(3.0))


def test_frozen_sample_grows_older_and_asks_for_nothing() -> None:
    device = bad_stick(bad_plugins.freezes())
    frozen = replace(ASKING.read(3.0), requests=())
    assert device.read(3.0) == frozen
    assert device.read(3.5) == replace(frozen, age=0.5)
    device.misbehave(None)
    assert device.read(4.0) == ASKING.read(4.0)


def test_unplugged_device_raises() -> None:
    with pytest.raises(DeviceLost, match="gone"):
        bad_stick(bad_plugins.raises(DeviceLost("stick", "gone"))).read(1.0)


def test_fields_change() -> None:
    sample = bad_stick(bad_plugins.becomes(speed=math.nan, enabled=False)).read(1.0)
    assert math.isnan(sample.speed)
    assert not sample.enabled
    assert sample.axes == (0.1, 0.2)


def test_axes_jump_from_stop_to_stop() -> None:
    device = bad_stick(bad_plugins.jumps(0.5))
    samples = [device.read(0.02 * n) for n in range(3)]
    assert [(sample.speed, sample.axes) for sample in samples] == [
        (-0.5, (-1.0, -1.0)),
        (0.5, (1.0, 1.0)),
        (-0.5, (-1.0, -1.0)),
    ]


@pytest.mark.parametrize("answer", [None, "garbage", 1e300])
def test_anything_is_returned(answer: object) -> None:
    device: Any = bad_stick(bad_plugins.returns(answer))
    assert device.read(1.0) is answer
    follower: Any = BadFollower(Walker())
    follower.misbehave(bad_plugins.returns(answer))
    assert follower.step(at(1.0)) is answer


def test_late_answers_take_virtual_time_so_often() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        device = bad_stick(bad_plugins.is_late(0.03, 2))
        times = []
        for _ in range(3):
            assert device.read(1.0) == ASKING.read(1.0)
            times.append(loop.time())
        assert times == pytest.approx([0.03, 0.06, 0.06])

    run(main(), simulated=True)


def test_held_command_never_ends() -> None:
    follower = BadFollower(Walker())
    follower.misbehave(bad_plugins.holds_command())
    assert follower.step(at(3.0)).command.speed == 3.0
    late = follower.step(at(11.0))
    assert late.command.speed == 3.0
    assert late.tracking.arc_length == 11.0
    assert not late.finished


def test_agenda_happens_at_its_times() -> None:
    agenda: list[tuple[float, bad_plugins.FollowerBehaviour | None]]
    agenda = [(2.0, bad_plugins.commands(math.inf, 0.1)), (4.0, None)]
    follower = BadFollower(Walker(), agenda)
    speeds = [follower.step(at(time)).command.speed for time in (1.99, 2.0, 3.98, 4.0, 9.0)]
    assert speeds == [1.99, math.inf, math.inf, 4.0, 9.0]
    follower = BadFollower(Walker(), agenda)
    assert follower.step(at(7.0)).command.speed == 7.0


def test_leaking_plugin_answers_all_the_same() -> None:
    assert bad_stick(bad_plugins.leaks(1000)).read(2.0) == ASKING.read(2.0)


# ---------------------------------------------------------------------------------------------- stalling


def test_stall_makes_every_timer_late_that_falls_into_it() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        happened: list[float] = []
        for due in (0.1, 0.3, 0.6):
            loop.call_at(due, lambda: happened.append(loop.time()))
        loop.call_at(0.05, stall, 0.4)
        await asyncio.sleep(1.0)
        assert happened == pytest.approx([0.45, 0.45, 0.6])

    run(main(), simulated=True)


def test_stall_without_a_loop_does_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    slept: list[float] = []
    monkeypatch.setattr("time.sleep", slept.append)
    stall(1000.0)
    assert slept == []


def test_stall_on_a_real_loop_blocks_it() -> None:
    async def main() -> None:
        loop = asyncio.get_running_loop()
        before = loop.time()
        stall(0.01)
        assert loop.time() - before >= 0.01

    run(main(), simulated=False)
