# ruff: noqa: ANN401  (changes are handed on as they are)

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import core_builders
import pytest
from core_builders import drive, drives
from msgspec.structs import replace

from artemis.devices.can_bus import Frame
from artemis.recording.emergencies import STORM
from artemis.recording.event_log import EventLog
from artemis.recording.journal import Entry, Level
from artemis.recording.schemas import pack_frames
from artemis.supervision import catalogue
from artemis.values import (
    Cause,
    Event,
    Fault,
    Job,
    JobKind,
    JobResult,
    Mode,
    OperatorInput,
    Request,
    SetPoints,
    Severity,
    Tick,
    Verdict,
    Wish,
)

NODES = {"traction-left": 1, "traction-right": 2, "steer-left": 3, "steer-right": 4}
BLOCKED = catalogue.fault("DRV-25", "steer-left", "EMCY 0x8611")
FROZEN = catalogue.fault("INP-03", "stick")
OVERRUN = catalogue.fault("DRV-18", "steer-left")
WARNING = Fault(id="DSK-02", severity=Severity.WARN, text="no space left", to_fault=False)


def tick(time: float = 0.0, mode: Mode = Mode.FOLLOW, *faults: Fault, **changes: Any) -> Tick:
    """A healthy tick but for the faults; `changes` are those of the wish, the cause, or of what was sensed."""
    cause = changes.pop("cause", None)
    told = {name: changes.pop(name) for name in ("phase", "jobs") if name in changes}
    verdict = Verdict(
        severity=max((fault.severity for fault in faults), default=Severity.NONE),
        faults=faults,
        to_fault=any(fault.to_fault for fault in faults),
        **{name: changes.pop(name) for name in ("recovers", "alarm", "final") if name in changes},
    )
    snapshot = core_builders.snapshot(time, verdict=verdict, **changes)
    return Tick(snapshot=snapshot, mode=mode, cause=cause, wish=Wish(**told), set_points=SetPoints())


def told(*ticks: Tick, frames: Sequence[tuple[bool, Frame]] = ()) -> list[Entry]:
    """What is told of the last tick."""
    event_log = EventLog(NODES, core_builders.ROBOT.errors)
    for seen in ticks[:-1]:
        event_log.observe(seen, pack_frames(frames, seen.snapshot.time), seen.snapshot.time)
    return event_log.observe(ticks[-1], b"", ticks[-1].snapshot.time)


def of(kind: str, entries: list[Entry]) -> Entry:
    """The only entry of a kind."""
    (entry,) = (entry for entry in entries if entry.kind == kind)
    return entry


def told_in_words(*ticks: Tick) -> list[tuple[str, str]]:
    return [(entry.kind, entry.text) for entry in told(*ticks)]


def test_a_tick_like_the_last_one_is_no_news() -> None:
    assert told(tick(), tick(0.02)) == []


def test_the_first_tick_names_mode_and_phase() -> None:
    assert told_in_words(tick(0.0, Mode.INIT, phase="listening")) == [("mode", "init"), ("phase", "listening")]


# ---------------------------------------------------------------------------------------------- causes of a mode


def test_a_mode_that_a_fault_brings_names_it() -> None:
    led = Cause(event=Event.FAULT, faults=(BLOCKED,))
    entry = of("mode", told(tick(), tick(0.02, Mode.FAULT, BLOCKED, FROZEN, cause=led)))

    assert (entry.text, entry.level) == ("follow -> fault: DRV-25 steer-left", Level.ERROR)
    cause = {"faults": [{"id": "DRV-25", "device": "steer-left"}]}
    assert entry.data == {"from": "follow", "to": "fault", "cause": cause}


def test_a_mode_that_a_request_brings_names_it() -> None:
    asked = Cause(event=Event.STOP, request=Request.QUICKSTOP)
    entry = of("mode", told(tick(), tick(0.02, Mode.QUICKSTOP, FROZEN, cause=asked)))

    assert (entry.text, entry.level) == ("follow -> quickstop: quick stop", Level.WARNING)
    assert entry.data["cause"] == {"request": "quick stop"}


def test_a_mode_that_an_event_brings_names_it() -> None:
    entry = of("mode", told(tick(), tick(0.02, Mode.READY, cause=Cause(event=Event.DONE))))

    assert (entry.text, entry.level) == ("follow -> ready: done", Level.INFO)
    assert entry.data["cause"] == {"event": "done"}


def test_an_end_that_was_asked_for_names_the_request() -> None:
    ticks = tick(), tick(0.02, Mode.END, cause=Cause(event=Event.END, request=Request.END))

    assert of("mode", told(*ticks)).data["cause"] == {"request": "end"}


def test_an_end_because_nobody_acknowledges_names_the_fault() -> None:
    led = Cause(event=Event.END, faults=(BLOCKED,))
    entry = of("mode", told(tick(0.0, Mode.FAULT, BLOCKED), tick(0.02, Mode.END, BLOCKED, cause=led)))

    assert entry.text == "fault -> end: end, DRV-25 steer-left"
    assert entry.data["cause"] == {"event": "end", "faults": [{"id": "DRV-25", "device": "steer-left"}]}


# ---------------------------------------------------------------------------------------------- faults and verdicts


def test_a_fault_is_told_with_all_that_machines_need() -> None:
    entries = told(tick(), tick(0.02, Mode.FAULT, BLOCKED, drives=drives(drive("steer-left", emergencies=(0x8611,)))))
    entry = of("fault", entries)

    assert entry.text == "DRV-25 steer-left: cannot follow its set-point (EMCY 0x8611)"
    assert entry.level is Level.ERROR
    assert entry.data == {
        "id": "DRV-25",
        "device": "steer-left",
        "severity": "QUICK_STOP",
        "recovery": "acknowledge",
        "code": 0x8611,
    }


def test_a_fault_without_device_is_told_once_by_its_words() -> None:
    entry = of("fault", told(tick(), tick(0.02, Mode.FOLLOW, WARNING)))

    assert (entry.text, entry.level) == ("DSK-02 no space left", Level.WARNING)
    assert entry.data == {"id": "DSK-02", "device": "", "severity": "WARN", "recovery": "by itself"}


def test_a_fault_that_grows_worse_or_final_is_told_again() -> None:
    mild, worse = replace(FROZEN, severity=Severity.CONTROLLED_STOP), replace(FROZEN, severity=Severity.QUICK_STOP)

    assert of("fault", told(tick(0.0, Mode.FOLLOW, mild), tick(0.02, Mode.FOLLOW, worse))).data["severity"] == (
        "QUICK_STOP"
    )
    entry = of("fault", told(tick(0.0, Mode.FOLLOW, mild), tick(0.02, Mode.FOLLOW, replace(mild, final=True))))
    assert entry.data["recovery"] == "not in this run"


def test_a_mild_fault_goes_by_itself() -> None:
    entry = of("cleared", told(tick(0.0, Mode.FOLLOW, WARNING), tick(0.02)))

    assert (entry.text, entry.data) == ("DSK-02", {"id": "DSK-02", "device": "", "by": "itself"})


def test_every_change_of_the_verdict_is_told() -> None:
    entry = of("verdict", told(tick(), tick(0.02, Mode.FAULT, BLOCKED)))
    assert (entry.text, entry.level) == ("S1, leads to fault", Level.WARNING)
    assert entry.data["faults"] == [{"id": "DRV-25", "device": "steer-left"}]

    recovering = told(tick(0.0, Mode.FAULT, OVERRUN), tick(0.02, Mode.FAULT, OVERRUN, recovers=True))
    assert [(entry.kind, entry.text) for entry in recovering] == [
        ("verdict", "S1, leads to fault, recovers automatically")
    ]

    assert told(tick(0.0, Mode.FAULT, BLOCKED), tick(0.02, Mode.FAULT, BLOCKED)) == []
    alarm = of("verdict", told(tick(0.0, Mode.FAULT, BLOCKED), tick(0.02, Mode.FAULT, BLOCKED, alarm=True)))
    assert alarm.level is Level.ERROR
    assert "PRESS THE EMERGENCY STOP" in alarm.text
    assert of("verdict", told(tick(0.0, Mode.FAULT, BLOCKED), tick(0.02, Mode.FAULT))).text == "nothing is wrong"


# ---------------------------------------------------------------------------------------------- how it goes on


def test_an_acknowledgment_is_told_with_what_it_forgot() -> None:
    entries = told(tick(0.0, Mode.FAULT, BLOCKED), tick(0.02, Mode.FAULT, requests=(Request.ACKNOWLEDGE,)))

    assert of("acknowledged", entries).text == "DRV-25 steer-left"
    assert of("acknowledged", entries).data == {"faults": [{"id": "DRV-25", "device": "steer-left"}], "left": []}
    assert of("cleared", entries).data["by"] == "person"


def test_an_acknowledgment_that_comes_too_early_is_told_with_what_is_still_there() -> None:
    ticks = tick(0.0, Mode.FAULT, BLOCKED), tick(0.02, Mode.FAULT, BLOCKED, requests=(Request.ACKNOWLEDGE,))
    entry = of("refused", told(*ticks))

    assert entry.text == "acknowledge; still there: DRV-25 steer-left"
    assert entry.data == {"faults": [], "left": [{"id": "DRV-25", "device": "steer-left"}]}


def test_a_recovery_without_a_person_is_told_with_the_budget_spent() -> None:
    event_log = EventLog(NODES, core_builders.ROBOT.errors)
    entries: list[Entry] = []
    for number in range(4):
        faults = (OVERRUN,) if number % 2 == 0 else ()
        entries += event_log.observe(tick(number / 50, Mode.FAULT, *faults, recovers=True), b"", number / 50)

    first, second = [entry for entry in entries if entry.kind == "recovered"]
    assert first.text == "automatically: DRV-18 1 of 1 times; recovery 1 of 5 in this run"
    assert second.text == "automatically: DRV-18 2 of 1 times; recovery 2 of 5 in this run"
    assert second.data == {"faults": [{"id": "DRV-18", "device": "steer-left"}], "recoveries": 2, "at_most": 5}
    assert [entry.data["by"] for entry in entries if entry.kind == "cleared"] == ["artemis", "artemis"]


def test_a_bring_up_after_a_fault_names_who_let_it_go_on() -> None:
    for asked, by, words in (
        ((Request.ACKNOWLEDGE,), "person", "acknowledged"),
        ((), "artemis", "recovered automatically"),
    ):
        forgotten = tick(0.02, Mode.FAULT, requests=asked)
        begun = tick(0.04, Mode.INIT, cause=Cause(event=Event.ACKNOWLEDGED))
        entry = of("mode", told(tick(0.0, Mode.FAULT, OVERRUN), forgotten, begun))
        assert entry.text == f"fault -> init: {words}"
        assert entry.data["cause"] == {"event": "acknowledged", "by": by}


HELD = OperatorInput(source="stick", neutral=False, age=0.0)


@pytest.mark.parametrize(
    ("request_", "seen", "reason"),
    [
        (Request.ARM, tick(0.02, Mode.QUICKSTOP, inputs=(HELD,), phase="release the controls"), "release the controls"),
        (Request.ARM, tick(0.02, Mode.QUICKSTOP, phase="stopping"), "the robot is still stopping"),
        (Request.ARM, tick(0.02, Mode.QUICKSTOP), None),
        (Request.ARM, tick(0.02, Mode.QUICKSTOP, FROZEN), f"acknowledge: {FROZEN.text}"),
        (Request.ARM, tick(0.02, Mode.FAULT, BLOCKED), "acknowledge the fault first"),
        (Request.ARM, tick(0.02, Mode.INIT, phase="configure"), "it is not needed yet"),
        (Request.ARM, tick(0.02, Mode.INIT, inputs=(HELD,), phase="release the controls"), "release the controls"),
        (Request.ARM, tick(0.02, Mode.INIT, phase="reading potentiometers"), None),
        (Request.ARM, tick(0.02, Mode.END), "the run ends"),
        (Request.ACKNOWLEDGE, tick(0.02, Mode.FOLLOW), "there is no fault to acknowledge"),
        (Request.ACKNOWLEDGE, tick(0.02, Mode.FAULT, phase="acknowledged"), None),
        (
            Request.ACKNOWLEDGE,
            tick(0.02, Mode.FAULT, BLOCKED, phase="cannot acknowledge yet: blocked"),
            "cannot acknowledge yet: blocked",
        ),
        (Request.ACKNOWLEDGE, tick(0.02, Mode.QUICKSTOP, FROZEN), f"its cause is still present: {FROZEN.text}"),
        (Request.ACKNOWLEDGE, tick(0.02, Mode.QUICKSTOP), None),
        (Request.DONE, tick(0.02, Mode.FOLLOW), "no step by hand is running"),
        (Request.DONE, tick(0.02, Mode.TELEOP), None),
        (Request.ACCEPT, tick(0.02, Mode.READY), "no wheel is being measured"),
        (Request.QUICKSTOP, tick(0.02, Mode.QUICKSTOP), None),
    ],
)
def test_a_request_that_leads_to_nothing_says_why(request_: Request, seen: Tick, reason: str | None) -> None:
    sensed = replace(seen.snapshot.sensed, requests=(request_,))
    asked = replace(seen, snapshot=replace(seen.snapshot, sensed=sensed))
    entry = of("request", told(tick(), asked))
    assert entry.data.get("ignored") == reason
    assert entry.text == (f"{request_.value}: ignored, {reason}" if reason else request_.value)


def test_an_acknowledgment_that_accepts_the_view_of_a_scanner_says_so() -> None:
    asked = tick(0.02, Mode.QUICKSTOP, requests=(Request.ACKNOWLEDGE,))
    entries = told(tick(0.0, Mode.QUICKSTOP, catalogue.fault("LAS-06", "front")), asked)
    assert of("request", entries).text == "acknowledge: the view of scanner front is taken as it is"
    assert of("cleared", entries).data["by"] == "person"


def test_a_request_is_told_once_with_its_source_and_the_mode() -> None:
    asked = tick(
        0.02,
        Mode.FOLLOW,
        requests=(Request.ARM, Request.QUICKSTOP),
        inputs=(OperatorInput(source="stick", requests=(Request.QUICKSTOP,)),),
    )

    assert [(entry.text, entry.data) for entry in told(tick(), asked)] == [
        (
            "arm: ignored, the drives are armed",
            {"request": "arm", "by": "operator", "mode": "follow", "ignored": "the drives are armed"},
        ),
        ("quick stop (by stick)", {"request": "quick stop", "by": "stick", "mode": "follow"}),
    ]


# ---------------------------------------------------------------------------------------------- evidence


def frame(identifier: int, time: float) -> tuple[bool, Frame]:
    return identifier in (0x203, 0x000), Frame(identifier, b"\x37\x03", False, time)


def evidence(*faults: Fault, mode: Mode = Mode.FAULT) -> Entry:
    """Two seconds and a half of frames on a clock that shows 1000 s more than the run, then the faults."""
    event_log = EventLog(NODES, core_builders.ROBOT.errors)
    for number in range(126):
        time = number * 0.02
        frames = [frame(identifier, 1000 + time) for identifier in (0x183, 0x184, 0x203, 0x080, 0x77F)]
        frames += [frame(0x000, 1000 + time)] if number == 100 else []
        event_log.observe(tick(time), pack_frames(frames, 1000 + time), 1000 + time)
    led = Cause(event=Event.STOP, faults=faults)
    last = pack_frames([frame(0x083, 1002.51)], 1002.53)
    return of("frames", event_log.observe(tick(2.53, mode, *faults, cause=led), last, 1002.53))


def test_a_stop_by_a_verdict_shows_the_frames_of_the_drive_of_the_last_two_seconds() -> None:
    entry = evidence(BLOCKED)
    frames = entry.data["frames"]

    assert entry.data["drives"] == ["steer-left"]
    assert entry.text == "steer-left: 200 frames of the last 2 s"
    assert frames[:2] == [[0.54, "rx", "183", "3703"], [0.54, "tx", "203", "3703"]]
    assert frames[-1] == [2.51, "rx", "083", "3703"]
    assert {identifier for _, _, identifier, _ in frames} == {"183", "203", "083", "000"}


def test_a_fault_of_no_drive_shows_the_frames_of_all() -> None:
    for faults in ((FROZEN,), (BLOCKED, FROZEN), (catalogue.fault("COM-22"),)):
        entry = evidence(*faults, mode=Mode.QUICKSTOP)
        assert entry.data["drives"] == list(NODES)
        assert {identifier for _, _, identifier, _ in entry.data["frames"]} == {"183", "184", "203", "083", "000"}


def test_a_stop_that_a_person_asked_for_needs_no_evidence() -> None:
    asked = Cause(event=Event.STOP, request=Request.QUICKSTOP)
    entries = told(tick(), tick(0.02, Mode.QUICKSTOP, requests=(Request.QUICKSTOP,), cause=asked))

    assert [entry.kind for entry in entries] == ["request", "mode"]


# ---------------------------------------------------------------------------------------------- drives and jobs


def test_emergencies_and_boots_of_a_drive_are_told() -> None:
    said = drives(drive("traction-left", emergencies=(0x8130, 0, -1), boots=1))

    assert [(entry.kind, entry.text, entry.level) for entry in told(tick(), tick(0.02, drives=said))] == [
        ("emergency", "traction-left: EMCY 0x8130", Level.WARNING),
        ("emergency", "traction-left: EMCY 0x0000", Level.INFO),
        ("emergency", "traction-left: damaged EMCY", Level.WARNING),
        ("boot-up", "traction-left", Level.INFO),
    ]


def test_the_proof_of_the_watchdog_is_no_warning() -> None:
    said = drives(drive("traction-left", emergencies=(0x8130, 0x8611)))
    proving = replace(tick(0.02, drives=said), wish=Wish(phase="proving the watchdog"))
    entries = [entry for entry in told(tick(), proving) if entry.kind == "emergency"]
    assert [(entry.kind, entry.text, entry.level) for entry in entries] == [
        (
            "emergency",
            "traction-left: EMCY 0x8130, as it has to: the proof that the drive notices a lost heartbeat",
            Level.INFO,
        ),
        ("emergency", "traction-left: EMCY 0x8611", Level.WARNING),
    ]


def test_of_a_storm_of_emergencies_the_first_are_told_and_the_rest_counted() -> None:
    event_log = EventLog(NODES, core_builders.ROBOT.errors)
    entries: list[Entry] = []
    for number in range(120):  # 2.4 s, of which the first 1.2 s with 100 emergencies a second
        codes = (0x8611, 0x8130) if number < 60 else ()
        said = drives(drive("steer-left", emergencies=codes), drive("steer-right", emergencies=codes[:1]))
        entries += event_log.observe(tick(number * 0.02, drives=said))
    entries += event_log.end()

    single = [entry for entry in entries if entry.kind == "emergency" and entry.data["drive"] == "steer-left"]
    counted = [entry for entry in entries if entry.kind == "emergencies"]
    assert len(single) == STORM + 2 * 9
    assert [(entry.time, entry.data["drive"], entry.data["count"]) for entry in counted] == [
        (1.0, "steer-left", 2 * 51 - STORM),
        (1.0, "steer-right", 51 - STORM),
    ]
    assert counted[0].text == "steer-left: 82 more: EMCY 0x8130 x 41, EMCY 0x8611 x 41"
    in_all = [entry.data["drive"] for entry in entries if entry.kind == "emergency"]
    assert in_all.count("steer-right") == STORM + 9


def test_a_storm_that_lasts_until_the_end_is_counted() -> None:
    event_log = EventLog(NODES, core_builders.ROBOT.errors)
    event_log.observe(tick(drives=drives(drive("steer-left", emergencies=(0x8611,) * 50))))

    (entry,) = event_log.end()
    assert entry.text == "steer-left: 30 more: EMCY 0x8611 x 30"


def test_a_failed_job_is_a_warning_with_its_detail() -> None:
    result = JobResult(
        id=7, kind=JobKind.CONFIGURE, drive="steer-left", ok=False, detail="no answer", fault="COM-08", values=(1, 2)
    )
    (entry,) = told(tick(), tick(0.02, results=(result,)))

    assert (entry.kind, entry.text) == ("result", "configure steer-left: failed, no answer")
    assert entry.level is Level.WARNING
    assert entry.data == {
        "id": 7, "job": "configure", "drive": "steer-left", "ok": False, "values": [1, 2], "fault": "COM-08"
    }  # fmt: skip


def test_what_jobs_bring_back_is_told_in_words() -> None:
    histories = [
        JobResult(id=1, kind=JobKind.READ_HISTORY, drive="steer-left", ok=True, values=(0x8611, 0x1234)),
        JobResult(id=2, kind=JobKind.READ_HISTORY, drive="steer-right", ok=True),
        JobResult(id=3, kind=JobKind.CLEAR_TARGET, drive="traction-left", ok=True, values=(250,)),
    ]
    ordered = Job(id=4, kind=JobKind.REFERENCE, drive="steer-left", value=0.1)

    entries = told(tick(), tick(0.02, results=tuple(histories), jobs=(ordered,)))
    assert [entry.text for entry in entries] == [
        "read history steer-left: done: 0x8611 following error, 0x1234 unknown",
        "read history steer-right: done: empty",
        "clear target traction-left: done: stale set-point 250 cleared",
        "reference steer-left",
    ]
    assert entries[-1].data == {"id": 4, "job": "reference", "drive": "steer-left", "value": 0.1}
