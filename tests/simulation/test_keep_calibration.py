"""What the steering drives keep of their potentiometers: written, stored, compared at each start."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from rig import CALIBRATE, Rig, write_mission
from steering_rig import (
    LEFT,
    LEFT_ALONE,
    MEMORY,
    RIGHT,
    calibrate,
    memory,
)

from artemis.drive_states import DriveState

pytestmark = pytest.mark.short_alignment


def test_start_is_refused_where_a_drive_keeps_something_else(tmp_path: Path) -> None:
    first = calibrate(tmp_path / "first", **LEFT_ALONE).run()
    second = Rig(
        write_mission(tmp_path / "second", [CALIBRATE]), world=first.world, start=first.world.time, longest=30.0
    ).run()

    (fault,) = second.faults
    assert (fault.id, fault.device, second.status) == ("CAL-02", LEFT, 1)
    assert re.search(r"keeps zero 2\.499\d and 2\.491\d V", fault.text)  # the last digit is noise of the readings
    assert "the robot file says zero 2.5100 and 2.4800 V" in fault.text
    assert DriveState.OPERATION_ENABLE not in {state for t in second.truth_from(first.world.time) for state in t.states}


@pytest.mark.exhaustive
def test_a_drive_that_is_not_to_be_written_must_keep_what_the_file_says_all_the_same(tmp_path: Path) -> None:
    first = calibrate(tmp_path / "first").run()
    rig = calibrate(tmp_path / "second", **LEFT_ALONE)
    second = Rig(rig.mission, world=first.world, start=first.world.time, longest=30.0).run()

    assert [(fault.id, fault.device) for fault in second.faults] == [("CAL-02", RIGHT)]


def test_a_drive_that_refuses_to_store_is_named_with_what_is_where(tmp_path: Path) -> None:
    rig = calibrate(tmp_path)

    def refuse() -> None:
        rig.drive(RIGHT).failures.refuse_object(0x1010, 1, 0x08000020)

    run = rig.at(1.0, refuse).run()

    fault = run.faults[0]
    assert (fault.id, fault.device, run.status) == ("CAL-01", RIGHT, 1)
    assert "before it kept nothing; steer-left keeps the new values already, before nothing" in fault.text
    assert "`artemis calibrate steering --store` brings it back" in fault.text
    run.world.drive(RIGHT).power_on(run.world.time)
    assert memory(run.world.drive(RIGHT)) == (0, 0, 0, 0)


def test_a_drive_that_does_not_keep_what_is_written_is_named(tmp_path: Path) -> None:
    rig = calibrate(tmp_path, **LEFT_ALONE)

    def ignore() -> None:
        rig.drive(LEFT).failures.ignore_writes(MEMORY, 3)

    run = rig.at(1.0, ignore).run()

    assert (run.faults[0].id, run.faults[0].device) == ("CAL-01", LEFT)
    assert "did not keep" in run.faults[0].text
    assert run.results.kept == {}


def test_power_lost_while_a_drive_stores_leaves_it_as_it_was_and_the_next_start_tells(tmp_path: Path) -> None:
    rig = calibrate(tmp_path / "first")

    def lose() -> None:
        rig.drive(RIGHT).power_off()
        rig.bus.loop.call_later(0.5, lambda: rig.drive(RIGHT).power_on(rig.bus.loop.time()))

    rig.when(lambda seen: seen.phase == f"write calibration {RIGHT}", lose, after=0.001)
    first = rig.run()

    assert first.status == 1
    assert memory(first.world.drive(RIGHT)) == (0, 0, 0, 0)
    assert list(first.results.kept) == [LEFT]
    mission = write_mission(tmp_path / "second", [CALIBRATE])
    second = Rig(mission, world=first.world, start=first.world.time, longest=30.0).run()
    assert [(fault.id, fault.device) for fault in second.faults] == [("CAL-02", LEFT)]
