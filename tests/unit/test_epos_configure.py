"""What configuring a drive leaves in it: the robot file's values, our PDOs, and an error where it refuses."""

from __future__ import annotations

import asyncio

import pytest
from core_builders import ROBOT
from epos_jobs_rig import LEFT, STEER_LEFT, STEER_RIGHT, WATCH, Rig, bring_up, changed, has, on

from artemis.drive_states import Nmt
from artemis.errors import DeviceError
from artemis.sim.dictionary import key_of


def test_configured_traction_drive_has_the_values_of_the_robot_file() -> None:
    async def test(rig: Rig) -> None:
        await bring_up(rig)
        assert rig.node.nmt is Nmt.OPERATIONAL
        rpm = 4700 * 60 / 72  # per m/s
        expected = {
            (0x6402, 0): 11, (0x6410, 1): 5000, (0x6410, 2): 10000, (0x6410, 3): 12, (0x6410, 4): 3190,
            (0x6410, 5): 526, (0x2210, 2): 3, (0x60F6, 1): 400, (0x60F6, 2): 120, (0x60F9, 1): 1200,
            (0x60F9, 2): 180, (0x60FB, 3): 200, (0x607F, 0): round(0.72 * rpm), (0x6085, 0): round(1.5 * rpm),
            (0x100C, 0): 0, (0x1017, 0): 100, (0x1016, 1): WATCH, (0x1016, 2): 0, (0x6061, 0): 3, (0x6065, 0): 2000,
        }  # fmt: skip
        assert {place: has(rig, *place) for place in expected} == expected

    on(LEFT, test)


def test_configured_steering_drive_has_the_values_of_the_robot_file() -> None:
    async def test(rig: Rig) -> None:
        await bring_up(rig)
        expected = {
            (0x6402, 0): 1, (0x6410, 1): 1000, (0x2210, 1): 500, (0x2210, 2): 1, (0x6065, 0): 20000,
            (0x1016, 1): WATCH, (0x6061, 0): -1, (0x607D, 1): -0x80000000, (0x607D, 2): 0x7FFFFFFF,
        }  # fmt: skip
        assert {place: has(rig, *place) for place in expected} == expected

    on(STEER_RIGHT, test)


@pytest.mark.parametrize(
    ("name", "received", "sent"),
    [
        (LEFT, [0x60400010, 0x60FF0020], [[0x60410010, 0x60640020], [0x20280020, 0x60780010, 0x60610008]]),
        (
            STEER_LEFT,
            [0x60400010, 0x20620020],
            [[0x60410010, 0x60640020], [0x207C0110, 0x207C0210, 0x60780010, 0x60610008]],
        ),
    ],
)
def test_configured_drive_exchanges_exactly_our_pdos(name: str, received: list[int], sent: list[list[int]]) -> None:
    async def test(rig: Rig) -> None:
        await bring_up(rig)
        node = rig.node.node_id

        def mapped(index: int) -> list[int]:
            return [has(rig, index, sub) for sub in range(1, 1 + has(rig, index))]

        assert [has(rig, 0x1400 + number, 1) >> 31 for number in range(4)] == [0, 0, 1, 1]
        assert [has(rig, 0x1800 + number, 1) >> 31 for number in range(4)] == [0, 0, 1, 1]
        assert [has(rig, 0x1400 + number, 1) & 0x7FF for number in range(2)] == [0x200 + node, 0x300 + node]
        assert [has(rig, 0x1800 + number, 1) & 0x7FF for number in range(2)] == [0x180 + node, 0x280 + node]
        assert [mapped(0x1600), mapped(0x1601)] == [received, [0x60400010]]
        assert [mapped(0x1A00), mapped(0x1A01)] == sent
        assert [has(rig, 0x1400, 2), has(rig, 0x1401, 2), has(rig, 0x1800, 2), has(rig, 0x1801, 2)] == [1, 255, 1, 1]

    on(name, test)


@pytest.mark.parametrize("name", [LEFT, STEER_RIGHT])
def test_configuring_again_writes_nothing_that_is_already_right(name: str) -> None:
    async def test(rig: Rig) -> None:
        await bring_up(rig)
        first = rig.writes()
        assert len(first) > 30
        await rig.jobs.secure(0.0)
        rig.node.poke(0x6085, 0, 123)
        rig.writes()
        await rig.jobs.configure()
        again = [(hex(index), sub) for index, sub, _ in rig.writes()]
        assert again == [("0x6085", 0), ("0x1016", 1)], "the watch was switched off while securing"

    on(name, test)


def test_pdo_that_is_not_right_is_written_whole_and_no_other() -> None:
    async def test(rig: Rig) -> None:
        await bring_up(rig)
        await rig.jobs.secure(0.0)
        rig.node.poke(0x1A01, 3, 0x60600008)
        rig.writes()
        await rig.jobs.configure()
        pdos = [(hex(index), sub) for index, sub, _ in rig.writes() if 0x1400 <= index < 0x1B00]
        assert set(pdos) == {("0x1801", 1), ("0x1801", 2), *(("0x1a01", sub) for sub in range(4))}
        assert pdos[0] == pdos[-1] == ("0x1801", 1), "off while its mapping changes"
        assert has(rig, 0x1A01, 3) == 0x60610008

    on(LEFT, test)


def test_value_that_is_not_kept_is_an_error_with_object_and_both_values() -> None:
    async def test(rig: Rig) -> None:
        values = rig.node._dictionary.values
        rig.node._dictionary.written[key_of(0x6410, 2)] = lambda _: values.__setitem__(key_of(0x6410, 2), 7)
        rig.node.poke(0x6410, 2, 7)
        await rig.jobs.secure(0.0)
        with pytest.raises(DeviceError, match=r"did not keep 0x6410:2: wrote 0x2710, reads 0x7\b"):
            await rig.jobs.configure()
        assert rig.node.nmt is Nmt.PRE_OPERATIONAL, "not started"

    on(LEFT, test)


def test_value_that_is_refused_is_an_error_with_object_and_reason() -> None:
    async def test(rig: Rig) -> None:
        await rig.jobs.secure(0.0)
        with pytest.raises(DeviceError, match=r"0x06090031 at 0x6410:1: value too high"):
            await rig.jobs.configure()

    motor = ROBOT.drives[STEER_LEFT].motor.model_copy(update={"continuous_current_ma": 6000})
    on(STEER_LEFT, test, robot=changed(STEER_LEFT, motor=motor))


def test_mode_that_is_not_taken_over_is_an_error() -> None:
    async def test(rig: Rig) -> None:
        await rig.jobs.secure(0.0)
        rig.node._dictionary.getters[key_of(0x6061, 0)] = lambda: 1
        with pytest.raises(DeviceError, match=r"shows operating mode 1, not 3"):
            await rig.jobs.configure()

    on(LEFT, test)


@pytest.mark.parametrize("delay", [0.001, 0.03, 0.3])
def test_mode_that_is_taken_over_a_moment_later_is_waited_for(delay: float) -> None:
    async def test(rig: Rig) -> None:
        loop, getters, key = asyncio.get_running_loop(), rig.node._dictionary.getters, key_of(0x6061, 0)
        true, shown = getters[key], getters[key]()

        follow = rig.node._dictionary.written[key_of(0x6060, 0)]

        def take_over(mode: int) -> None:
            follow(mode)
            loop.call_later(delay, getters.__setitem__, key, true)

        rig.node._dictionary.written[key_of(0x6060, 0)] = take_over
        getters[key] = lambda: shown
        await rig.jobs.secure(0.0)
        await rig.jobs.configure()
        assert has(rig, 0x6061) == 3

    on(LEFT, test)
