"""How it goes on after a fault, for each kind of recovery of the fault table: nothing moves before a person arms."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest
from every_row import SETTINGS, Scene, notice, play
from rig import Rig, Run, Seen
from watched import STEERING, TRACTION, standing

from artemis.supervision.catalogue import ROWS
from artemis.supervision.catalogue.row import Kind
from artemis.values import JobKind, Mode

AT = SETTINGS["driving"].at
LEFT, STEER = TRACTION[0], STEERING[1]
NODE = 4
"""Of STEER."""
NMT, RESET_NODE, RESET_COMMUNICATION = 0x000, 0x81, 0x82
ACKNOWLEDGED, ARMED, ENDED = AT + 1.5, AT + 3.6, AT + 5.7


def attended(folder: Path, id: str, scene: Scene, acts: Sequence[tuple[float, str]]) -> Run:
    """A run in which a person does things, and ends it."""
    return play(folder, id, Scene(node=scene.node, options=scene.options, along=scene.along, operator=acts))


def there(run: Run, id: str) -> list[Seen]:
    """Ticks in which it is in the verdict."""
    return [seen for seen in run.seen if id in {fault.id for fault in seen.tick.snapshot.verdict.faults}]


def resets(run: Run) -> set[int]:
    """NMT commands to STEER after the acknowledgment."""
    return {f.data[0] for time, f in run.bus.sent if f.id == NMT and f.data[1] == NODE and time > ACKNOWLEDGED - 1e-6}


def kind_of(id: str) -> Kind:
    return ROWS[id].recovery.kind


@pytest.mark.sampled(2)
@pytest.mark.parametrize("id", ["DRV-25", "DRV-11", "DRV-15", "DRV-19"])
def test_fault_waits_for_a_person_then_for_the_arm(tmp_path: Path, id: str) -> None:
    acts = [(ACKNOWLEDGED, "acknowledge"), (ARMED, "arm"), (ENDED, "end")]
    run = attended(tmp_path, id, Scene(node=STEER), acts)
    assert kind_of(id) in (Kind.ACKNOWLEDGED, Kind.CALIBRATED, Kind.CONFIGURED)
    assert ACKNOWLEDGED - 0.03 < there(run, id)[-1].time < ACKNOWLEDGED + 0.03
    waits = [seen for seen in run.seen if ACKNOWLEDGED + 2.0 < seen.time < ARMED]
    assert {seen.phase for seen in waits} == {"waiting for arm"}
    assert all(standing(truth) for truth in run.truth_from(AT + 1.0))
    assert run.modes[-5:] == [Mode.FAULT, Mode.INIT, Mode.READY, Mode.TELEOP, Mode.END]
    done = {
        r.kind for seen in run.seen if seen.time > ARMED for r in seen.tick.snapshot.sensed.results if r.drive == STEER
    }
    assert JobKind.REFERENCE in done, "where the wheels stand is measured again"
    wanted = {"node": {RESET_NODE}, "communication": {RESET_COMMUNICATION}, "": set()}[ROWS[id].recovery.reset]
    assert resets(run) & {RESET_NODE, RESET_COMMUNICATION} == wanted


@pytest.mark.parametrize("id", ["DRV-05", "DRV-21"])
def test_fault_that_is_final_is_not_acknowledged(tmp_path: Path, id: str) -> None:
    run = attended(tmp_path, id, Scene(node=STEER), [(ACKNOWLEDGED, "acknowledge"), (AT + 2.2, "end")])
    assert kind_of(id) is Kind.NEVER
    assert there(run, id)[-1].time > ACKNOWLEDGED + 0.5
    assert run.modes[-2:] == [Mode.FAULT, Mode.END]
    assert {seen.phase for seen in run.seen if ACKNOWLEDGED < seen.time < AT + 2.1 and "cannot continue" in seen.phase}


@pytest.mark.slow
def test_fault_that_comes_again_is_final(tmp_path: Path) -> None:
    again = {"at_s": ARMED, "inject": "DRV-02", "node": STEER}
    acts = [(ACKNOWLEDGED, "acknowledge"), (ARMED + 2.5, "acknowledge"), (ARMED + 3.0, "end")]
    run = attended(tmp_path, "DRV-02", Scene(node=STEER, along=[again]), acts)
    second = notice(run, ["DRV-02"], ROWS["DRV-02"].severity, ARMED)
    assert second is not None
    assert second.fault is not None
    assert second.fault.final
    assert run.modes[-4:] == [Mode.FAULT, Mode.INIT, Mode.FAULT, Mode.END]


BRING_UP = ["configure", "first contact", "proving the watchdog", "waiting for arm", "aligning"]
"""Before, the drive still has the error: there is none that could come again."""


@pytest.mark.sampled(3)
@pytest.mark.parametrize("phase", BRING_UP)
def test_fault_that_comes_again_in_the_next_bring_up_is_final(tmp_path: Path, phase: str) -> None:
    def prepare(rig: Rig) -> None:
        rig.when(
            lambda seen: seen.time > ACKNOWLEDGED and seen.phase == phase,
            rig.emergency(STEER, 0x2310),
            after=0.007,
            name="again",
        )

    acts = [(ACKNOWLEDGED, "acknowledge"), (ARMED, "arm"), (ARMED + 2.5, "acknowledge"), (ARMED + 3.0, "end")]
    run = play(tmp_path, "DRV-02", Scene(node=STEER, operator=acts), prepare=prepare)
    second = notice(run, ["DRV-02"], ROWS["DRV-02"].severity, run.acts["again"])
    assert second is not None
    assert second.fault is not None
    assert second.fault.final
    assert second.seen.time - run.acts["again"] <= ROWS["DRV-02"].within
    assert run.modes[-4:] == [Mode.FAULT, Mode.INIT, Mode.FAULT, Mode.END]
    assert all(standing(truth) for truth in run.truth_from(ACKNOWLEDGED))


def test_automatic_fault_is_forgotten_as_often_as_its_row_says(tmp_path: Path) -> None:
    again = {"at_s": ARMED, "inject": "COM-28", "node": STEER, "duration_s": 0.6}
    run = attended(
        tmp_path, "COM-28", Scene(node=STEER, options={"duration_s": 0.6}, along=[again]), [(ARMED + 2.5, "end")]
    )
    assert (kind_of("COM-28"), ROWS["COM-28"].recovery.times) == (Kind.AUTOMATIC, 1)
    first = [seen.time for seen in there(run, "COM-28") if seen.time < ARMED]
    settled = AT + 0.6 + 0.1 + ROWS["COM-28"].recovery.settle  # the next heartbeat comes within 0.1 s
    assert first[-1] <= settled + 0.02
    waits = {seen.phase for seen in run.seen if settled + 1.0 < seen.time < ARMED}
    assert waits == {"waiting for arm"}, "forgotten without a person, but nothing moves"
    assert [seen for seen in there(run, "COM-28") if seen.time > ARMED + 2.4], "the second one needs a person"
    assert all(standing(truth) for truth in run.truth_from(AT + 1.0))


def test_warning_goes_by_itself_once_its_cause_is_gone(tmp_path: Path) -> None:
    run = play(tmp_path, "INP-08", Scene(options={"duration_s": 0.3}))
    assert kind_of("INP-08") is Kind.ITSELF
    gone = AT + 0.3 + 0.5 + ROWS["INP-08"].recovery.settle  # jumps count for 0.5 s
    assert gone - 0.2 < there(run, "INP-08")[-1].time < gone + 0.04
    assert run.status == 0
