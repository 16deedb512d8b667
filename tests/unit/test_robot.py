"""The robot's loop on virtual time: when it ticks, what it hands in once, and how it goes down."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest
from core_builders import NAMES, PERIOD
from fake_scanner import FakeScanner
from msgspec.structs import replace
from robot_rig import EMERGENCY, HEARTBEAT, SYNC, Rig

from artemis.clock import run
from artemis.devices.can_bus import Frame
from artemis.robot import Robot
from artemis.states.mode import OFF, ON, STOPPING
from artemis.supervision import catalogue
from artemis.values import Job, JobKind, OperatorInput, Request, Sensed, Tick, Wish


def stop_when_asked(sensed: Sensed) -> Wish:
    return STOPPING if Request.QUICKSTOP in sensed.requests else ON


def is_stop(frame: Frame) -> bool:
    return frame.id & 0x780 == 0x300


# ---------------------------------------------------------------------------------------------- schedule


def test_ticks_come_on_schedule_and_are_numbered() -> None:
    rig = Rig().run(1.0)
    assert rig.scheduled == pytest.approx([number * PERIOD for number in range(51)])
    assert [sensed.index for sensed in rig.core.seen] == list(range(51))
    assert [sensed.late for sensed in rig.core.seen] == pytest.approx([0.0] * 51, abs=1e-9)


def test_run_time_begins_with_the_run() -> None:
    rig = Rig()

    async def main() -> None:
        await asyncio.sleep(1000.0)
        await rig._main(0.1)

    run(main(), simulated=True)
    assert rig.scheduled == pytest.approx([number * PERIOD for number in range(6)])


def test_run_ends_with_the_tick_that_says_so() -> None:
    rig = Rig().run(0.1)
    assert rig.scheduled[-1] == pytest.approx(0.1)
    assert max(frame.time for frame in rig.bus.sent) == pytest.approx(0.1)


def busy(rig: Rig, at: float, seconds: float) -> None:
    """Let a tick take long."""
    script = rig.core.script

    def slow(sensed: Sensed) -> Wish:
        if sensed.time == pytest.approx(at) and not sensed.urgent:
            rig.loop._selector_with_time.now += seconds
        return script(sensed)

    rig.core.script = slow


def test_tick_after_one_that_took_too_long_knows_how_late_it_is() -> None:
    rig = Rig()
    busy(rig, at=0.1, seconds=0.03)
    rig.run(0.2)
    late = {round(sensed.time, 6): sensed.late for sensed in rig.core.seen if sensed.late > 1e-9}
    assert late == pytest.approx({0.13: 0.01})
    assert rig.scheduled == pytest.approx([0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.13, 0.14, 0.16, 0.18, 0.2])


def test_tick_knows_when_the_set_points_before_it_were_sent() -> None:
    rig = Rig()
    busy(rig, at=0.1, seconds=0.03)
    rig.at(0.135, rig.request(Request.QUICKSTOP))
    rig.run(0.18)
    sent = {round(sensed.time, 6): sensed.sent for sensed in rig.core.seen if sensed.time > 0.07}
    assert sent == pytest.approx({0.08: 0.06, 0.1: 0.08, 0.13: 0.13, 0.135: 0.13, 0.14: 0.13, 0.16: 0.14, 0.18: 0.16})


def test_extra_tick_after_a_late_one_is_not_late() -> None:
    rig = Rig()
    busy(rig, at=0.1, seconds=0.03)
    rig.at(0.135, rig.request(Request.QUICKSTOP))
    rig.run(0.2)
    assert [sensed.late for sensed in rig.urgent] == [0.0]


def test_ticks_that_were_missed_are_not_made_up_for() -> None:
    rig = Rig()
    busy(rig, at=0.04, seconds=0.1)
    rig.run(0.2)
    assert rig.scheduled == pytest.approx([0.0, 0.02, 0.04, 0.14, 0.16, 0.18, 0.2])
    assert rig.core.seen[3].late == pytest.approx(0.08)


def test_whether_somebody_is_there_is_asked_at_each_tick_with_the_run_time() -> None:
    rig = Rig()
    rig.attended = lambda time: (time < 0.05, True)
    rig.run(0.1)
    assert [sensed.attended for sensed in rig.core.seen] == [True] * 3 + [False] * 3
    assert all(sensed.awaited for sensed in rig.core.seen)


# ---------------------------------------------------------------------------------------------- what is handed in


@pytest.mark.parametrize("seconds", [0.0, 0.005, PERIOD, 0.033])
def test_results_of_jobs_are_delivered_exactly_once(seconds: float) -> None:
    ordered: list[Job] = []

    def order(sensed: Sensed) -> Wish:
        if sensed.time > 0.1 - 1e-6:
            return ON
        first = len(ordered)
        jobs = [Job(id=first + n, kind=JobKind.SECURE, drive=name, value=seconds) for n, name in enumerate(NAMES)]
        ordered.extend(jobs)
        return replace(ON, jobs=tuple(jobs))

    rig = Rig(order)
    rig.at(0.031, rig.request(Request.QUICKSTOP))
    rig.at(0.037, rig.hear(EMERGENCY))
    results = rig.run(0.3).collected("results")
    assert len(ordered) == 7 * len(NAMES)
    assert sorted(result.id for result in results) == [job.id for job in ordered]


def test_result_comes_with_the_first_tick_after_its_job_has_ended() -> None:
    job = Job(id=1, kind=JobKind.SECURE, drive="steer-left", value=0.03)
    rig = Rig(lambda sensed: replace(ON, jobs=(job,)) if sensed.index == 0 else ON).run()
    assert [round(s.time, 6) for s in rig.core.seen if s.results] == [0.04]


@pytest.mark.parametrize("request_", [request for request in Request if request is not Request.QUICKSTOP])
def test_request_comes_once_with_the_next_scheduled_tick(request_: Request) -> None:
    rig = Rig()
    rig.at(0.051, rig.request(request_))
    rig.run()
    assert [(round(s.time, 6), s.requests) for s in rig.core.seen if s.requests] == [(0.06, (request_,))]
    assert rig.urgent == []


def test_fault_that_was_noticed_beside_the_ticks_comes_once_with_the_next() -> None:
    rig, fault = Rig(), catalogue.fault("PLG-05")
    rig.at(0.051, lambda: rig.robot.report(fault))
    rig.run()
    assert [(round(s.time, 6), s.faults) for s in rig.core.seen if s.faults] == [(0.06, (fault,))]


def test_requests_of_input_devices_come_with_those_of_the_operator() -> None:
    def ending(now: float) -> OperatorInput:
        return OperatorInput(source="stick", requests=(Request.DONE,) if now > 0.05 - 1e-6 else ())

    rig = Rig(stick=ending)
    rig.at(0.051, rig.request(Request.END))
    rig.run(0.06)
    assert rig.core.seen[-1].requests == (Request.END, Request.DONE)


def test_samples_come_in_the_order_of_the_inputs_with_the_run_time_they_were_asked_for() -> None:
    asked: list[float] = []

    def sample(now: float) -> OperatorInput:
        asked.append(now)
        return OperatorInput(source="b")

    rig = Rig(a=lambda now: OperatorInput(source="a"), b=sample).run(0.04)
    assert asked == pytest.approx([0.0, 0.02, 0.04])
    assert [[sample.source for sample in sensed.inputs] for sensed in rig.core.seen] == [["a", "b"]] * 3


# ---------------------------------------------------------------------------------------------- extra ticks


def test_quick_stop_makes_an_extra_tick_at_once_that_sends_stop_frames_only() -> None:
    rig = Rig(stop_when_asked)
    rig.at(0.051, rig.request(Request.QUICKSTOP))
    rig.run()
    (extra,) = rig.urgent
    assert extra.time == pytest.approx(0.051)
    assert extra.requests == (Request.QUICKSTOP,)
    between = [frame for frame in rig.bus.sent if 0.0405 < frame.time < 0.0595]
    assert [(frame.id, frame.data, frame.time) for frame in between] == [
        (0x301, b"\x0b\x00", 0.051),
        (0x302, b"\x0b\x00", 0.051),
    ]


def test_extra_tick_leaves_the_schedule_as_it_was() -> None:
    rig, plain = Rig(stop_when_asked), Rig().run()
    for time in (0.051, 0.0511, 0.119):
        rig.at(time, rig.request(Request.QUICKSTOP))
    rig.run()
    assert len(rig.urgent) == 3
    assert rig.scheduled == pytest.approx(plain.scheduled)
    for identifier in (SYNC, HEARTBEAT):
        times = [[frame.time for frame in each.bus.sent if frame.id == identifier] for each in (rig, plain)]
        assert times[0] == pytest.approx(times[1])


def test_emergency_makes_an_extra_tick_that_sees_it_and_no_later_one_does() -> None:
    rig = Rig()
    rig.at(0.051, rig.hear(EMERGENCY))
    rig.run()
    seen = [(round(s.time, 6), s.drives[2].emergencies) for s in rig.core.seen if s.drives[2].emergencies]
    assert seen == [(0.051, (0x2310,))]
    assert rig.urgent[0].drives[2].name == "steer-left"


@pytest.mark.parametrize("frame", [Frame(0x583, bytes(8)), Frame(0x703, b"\x05"), Frame(0x085, bytes(8))])
def test_other_frames_between_ticks_make_no_extra_tick(frame: Frame) -> None:
    rig = Rig()
    rig.at(0.051, rig.hear(frame))
    assert rig.run().urgent == []


def test_quick_stop_before_the_first_tick_waits_for_it() -> None:
    rig = Rig(stop_when_asked)

    async def main() -> None:
        loop = asyncio.get_running_loop()
        loop.call_soon(lambda: None)
        await rig._main(0.02)

    original = Robot.run

    async def run_later(robot: Robot) -> None:
        robot.request(Request.QUICKSTOP)
        await original(robot)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Robot, "run", run_later)
        run(main(), simulated=True)
    assert rig.urgent == []
    assert rig.core.seen[0].requests == (Request.QUICKSTOP,)


def test_quick_stop_from_within_a_tick_comes_with_the_next() -> None:
    rig = Rig(stop_when_asked)
    rig.observe = lambda tick: rig.robot.request(Request.QUICKSTOP) if tick.snapshot.sensed.index == 2 else None
    rig.run(0.1)
    assert rig.urgent == []
    assert [sensed.index for sensed in rig.core.seen if sensed.requests] == [3]


# ---------------------------------------------------------------------------------------------- trouble outside


def test_lost_bus_is_a_fault_in_every_tick_until_it_is_back() -> None:
    rig = Rig()
    rig.at(0.051, lambda: setattr(rig.bus, "lost", True))
    rig.at(0.091, lambda: setattr(rig.bus, "lost", False))
    rig.run()
    assert {(time, id) for time, id, _ in rig.faults()} == {(0.06, "COM-22"), (0.08, "COM-22"), (0.1, "COM-22")}
    assert any(frame.time > 0.1 for frame in rig.bus.sent), "and continues"


def test_bus_that_cannot_be_written_is_a_fault_in_the_next_tick() -> None:
    rig = Rig(lambda sensed: OFF)
    send = rig.bus.send

    def fail_once(frame: Frame) -> None:
        rig.bus.lost = rig.bus.clock() == pytest.approx(0.04)
        try:
            send(frame)
        finally:
            rig.bus.lost = False

    rig.bus.send = fail_once  # type: ignore[method-assign]
    rig.run(0.1)
    assert [(time, id) for time, id, _ in rig.faults()] == [(0.06, "COM-22")]


def test_bus_found_lost_between_ticks_is_a_fault() -> None:
    rig = Rig()

    def lose() -> None:
        rig.bus.lost = True
        rig.bus.wake()
        rig.bus.lost = False

    rig.at(0.051, lose)
    assert [id for _, id, _ in rig.run().faults()] == ["COM-22"]


def broken(now: float) -> OperatorInput:
    if now > 0.05:
        raise OSError("unplugged")
    return OperatorInput(source="stick")


def test_input_that_raises_is_a_fault_with_its_name_and_the_others_are_still_read() -> None:
    rig = Rig(stick=broken, wheel=lambda now: OperatorInput(source="wheel")).run(0.1)
    assert rig.faults() == [(time, "PLG-02", "stick") for time in (0.06, 0.08, 0.1)]
    assert "unplugged" in rig.core.seen[-1].faults[0].text
    assert [sample.source for sample in rig.core.seen[-1].inputs] == ["wheel"]


@pytest.mark.parametrize("garbage", [None, 42, "left", object(), ()])
def test_input_that_returns_garbage_is_a_fault_with_its_name(garbage: object) -> None:
    rig = Rig(stick=lambda now: garbage).run(0.02)
    assert rig.faults() == [(time, "PLG-06", "stick") for time in (0.0, 0.02)]
    assert rig.core.seen[-1].inputs == ()


# ---------------------------------------------------------------------------------------------- our own bugs


def failing_at(time: float, *, urgent: bool = False) -> Callable[[Sensed], Wish]:
    def script(sensed: Sensed) -> Wish:
        if sensed.urgent is urgent and sensed.time > time - 1e-6:
            raise ZeroDivisionError("our own bug")
        return ON

    return script


def went_down(rig: Rig) -> float:
    """The robot fails with its own error; all drives are told to stop and nothing else. Returns the time of that."""
    with pytest.raises(BaseException) as caught:  # noqa: PT011
        rig.run()
    error: BaseException | None = caught.value
    while isinstance(error, BaseExceptionGroup):
        (error,) = error.exceptions
    assert isinstance(error, ZeroDivisionError)
    stops = [number for number, frame in enumerate(rig.bus.sent) if is_stop(frame)]
    first = stops[0]
    assert [frame.id for frame in rig.bus.sent[first : first + 4]] == [0x301, 0x302, 0x303, 0x304]
    assert all(map(is_stop, rig.bus.sent[first:]))
    return rig.bus.sent[first].time


def test_work_of_a_device_beside_the_ticks_ends_with_the_run() -> None:
    rig, scanner = Rig(), FakeScanner()
    rig.sensors = [scanner]
    rig.run(0.2)
    assert rig.collected("scans") == scanner.made
    assert (len(scanner.made), scanner.work) == (7, "ended")


def test_exception_in_the_work_of_a_device_stops_every_drive() -> None:
    rig = Rig()
    rig.sensors = [FakeScanner(fail=2)]
    assert went_down(rig) == pytest.approx(0.0753)


def test_exception_in_a_tick_stops_every_drive_before_it_propagates() -> None:
    assert went_down(Rig(failing_at(0.06))) == pytest.approx(0.06)


def test_exception_in_an_extra_tick_stops_every_drive_before_it_propagates() -> None:
    rig = Rig(failing_at(0.0, urgent=True))
    rig.at(0.051, rig.request(Request.QUICKSTOP))
    assert went_down(rig) == pytest.approx(0.051)
    assert rig.scheduled[-1] == pytest.approx(0.04), "no tick after the bug"


def test_exception_in_the_extra_tick_of_an_emergency_stops_every_drive_before_it_propagates() -> None:
    rig = Rig(failing_at(0.0, urgent=True))
    rig.at(0.051, rig.hear(EMERGENCY))
    assert went_down(rig) == pytest.approx(0.051)


def test_exception_in_an_observer_stops_every_drive_before_it_propagates() -> None:
    rig = Rig()

    def observe(tick: Tick) -> None:
        if tick.snapshot.sensed.index == 3:
            raise ZeroDivisionError("full disk")

    rig.observe = observe
    went_down(rig)


def test_exception_in_a_job_stops_every_drive_before_it_propagates() -> None:
    job = Job(id=1, kind=JobKind.SECURE, drive="steer-left", value=-1.0)
    went_down(Rig(lambda sensed: replace(ON, jobs=(job,)) if sensed.index == 2 else ON))


@pytest.mark.parametrize("urgent", [False, True])
def test_lost_bus_does_not_hide_our_own_bug(urgent: bool) -> None:
    rig = Rig(failing_at(0.06, urgent=urgent))
    rig.at(0.051, lambda: setattr(rig.bus, "lost", True))
    rig.at(0.071, rig.request(Request.QUICKSTOP))
    with pytest.raises(BaseException) as caught:  # noqa: PT011
        rig.run()
    assert "our own bug" in "".join(map(str, _leaves(caught.value)))


def _leaves(error: BaseException) -> list[BaseException]:
    if isinstance(error, BaseExceptionGroup):
        return [leaf for inner in error.exceptions for leaf in _leaves(inner)]
    return [error]


def test_cancelled_run_stops_every_drive() -> None:
    rig = Rig()

    async def main() -> None:
        task = asyncio.create_task(rig._main(10.0))
        await asyncio.sleep(0.051)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    run(main(), simulated=True)
    assert [frame.id for frame in rig.bus.sent[-4:]] == [0x301, 0x302, 0x303, 0x304]


def test_an_answer_is_sensed_once_and_makes_no_extra_tick() -> None:
    rig = Rig()
    rig.at(0.05, lambda: rig.robot.request("left"))
    rig.run(0.2)
    assert [(round(s.time, 6), s.answers, s.requests) for s in rig.core.seen if s.answers] == [(0.06, ("left",), ())]
    assert not any(s.urgent for s in rig.core.seen)
