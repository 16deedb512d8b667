"""The arm is a person's: nothing that recovers automatically takes the place of one that is missing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from rig import CALIBRATE, STICK, TELEOP, Rig, Run, Seen, follow, standing, stick, straight, write_mission

from artemis.values import Mode, Request

pytestmark = pytest.mark.short_alignment

STEPS, FILES = [CALIBRATE, follow(0.4)], {"line.csv": straight(3.0)}
LATE = {"inject": "SYS-01", "seconds": 0.08}
TRIP = {"inject": "DRV-25", "node": "steer-left"}
OVERRUN = {"inject": "DRV-18", "node": "traction-right"}
CONTINUE = {"resume": "continue"}


def fault(time: float, what: dict[str, Any]) -> dict[str, Any]:
    return {"at_s": time, **what}


def attended(folder: Path, faults: list[dict[str, Any]], *acts: tuple[float, str], **keys: Any) -> Run:  # noqa: ANN401
    """A run with faults and a scripted operator, who is there until 13.4 s."""
    operator = [{"at_s": time, "do": act} for time, act in (*acts, (13.4, "acknowledge"))]
    mission = write_mission(folder, STEPS, FILES, simulation={"faults": faults, "operator": operator}, **keys)
    return Rig(mission).run()


def assert_waits_for_arm(seen: Run, since: float) -> None:
    """Nothing is enabled, no wheel turns, and the run ends for want of an arm."""
    assert {s.mode for s in seen.seen if s.time > since} <= {Mode.INIT, Mode.QUICKSTOP, Mode.FAULT, Mode.END}
    assert all(standing(truth) for truth in seen.truth_from(since))
    assert not any("aligning" in s.phase or s.phase == "enabling" for s in seen.seen if s.time > since)
    assert seen.status == 1


@pytest.mark.slow
@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("first", "second", "recovery"),
    [
        (TRIP, LATE, {"SYS-01": CONTINUE}),
        ({"inject": "PLG-06", "duration_s": 0.1}, LATE, {"SYS-01": CONTINUE}),
        (TRIP, OVERRUN, {"DRV-18": {"retries": 1, **CONTINUE}}),
    ],
    ids=["waiting for arm in init", "waiting for arm after a stop", "another drive's fault"],
)
def test_what_may_continue_does_not_spend_an_arm_that_another_fault_waits_for(
    tmp_path: Path, first: dict[str, Any], second: dict[str, Any], recovery: dict[str, Any]
) -> None:
    seen = attended(tmp_path, [fault(5.4, first), fault(10.41, second)], (7.4, "acknowledge"), recovery=recovery)
    assert len(set(seen.fault_ids)) == 2
    assert_waits_for_arm(seen, 7.4)


@pytest.mark.slow
def test_what_may_continue_does_where_nothing_else_was_wrong(tmp_path: Path) -> None:
    seen = attended(tmp_path, [fault(5.4, OVERRUN)], recovery={"DRV-18": {"retries": 1, **CONTINUE}})
    assert (seen.status, seen.fault_ids) == (0, ["DRV-18"])


@pytest.mark.parametrize("time", [0.5, 0.7], ids=["first contact", "proof of the watchdogs"])
def test_the_start_is_no_arm_any_more_after_a_stop_in_the_first_bring_up(tmp_path: Path, time: float) -> None:
    lost = fault(8.0, {"inject": "COM-11", "node": "traction-left", "duration_s": 0.15})
    seen = attended(tmp_path, [fault(time, LATE), lost])
    assert set(seen.fault_ids) == {"SYS-01"}  # drives that are off and have to be brought up again are not judged
    assert_waits_for_arm(seen, time)


def test_the_start_is_the_arm_of_a_bring_up_that_recovers_by_itself(tmp_path: Path) -> None:
    mute = fault(0.02, {"inject": "COM-08", "node": "traction-left", "duration_s": 1.0})
    seen = attended(tmp_path, [mute])
    assert (seen.status, set(seen.fault_ids)) == (0, {"COM-08"})


@pytest.mark.slow
def test_an_arm_with_the_controls_pressed_enables_nothing_until_they_are_released_and_it_is_given_again(
    tmp_path: Path,
) -> None:
    files = {"stick.csv": stick((0, 0, 0, 0), (5, 0, 1, 1), (18, 0, 0, 0), (24, 0, 0, 0))}
    operator = [{"at_s": 9.0, "do": "acknowledge"}, {"at_s": 30.0, "do": "acknowledge"}]
    simulation = {"faults": [fault(6.0, TRIP)], "operator": operator}
    rig = Rig(write_mission(tmp_path, [TELEOP], files, inputs=STICK, simulation=simulation))

    def waits(seen: Seen) -> bool:
        return seen.time > 11.0 and seen.phase == "release the controls"

    rig.when(waits, rig.request(Request.ARM), name="refused")
    rig.when(lambda s: s.time > 19.0 and s.phase == "waiting for arm", rig.request(Request.ARM), name="armed")
    seen = rig.run()
    assert all(standing(t) for t in seen.truth_from(8.0) if t.time < seen.acts["armed"])
    assert seen.acts["armed"] > 19.0
    assert Mode.TELEOP in {s.mode for s in seen.seen if s.now > seen.acts["armed"]}
