"""A drive may fail in every mode, in every phase of a bring-up, and while the robot stops for another reason."""

from __future__ import annotations

import random
from dataclasses import replace
from pathlib import Path

import pytest
from every_row import SETTINGS, Scene, assert_follows, assert_noticed, in_phase, name_of, play
from scenes_of_drives import of_code
from watched import DRIVES, standing

from artemis.values import Mode
from artemis_lab.injections.emergencies import CODES

AT, FOLLOWING = SETTINGS["driving"].at, SETTINGS["following"].at
STOPPING = [{"at_s": AT - 0.1, "inject": "DRV-25", "node": "steer-left"}]
HELD = [{"at_s": FOLLOWING - 0.1, "inject": "RUN-11"}]
PLACES = {
    Mode.INIT: Scene(of="bring-up", at=0.901),
    Mode.READY: Scene(of="standing"),
    Mode.CALIBRATE: Scene(of="calibrating"),
    Mode.TELEOP: Scene(of="driving"),
    Mode.FOLLOW: Scene(of="following"),
    Mode.QUICKSTOP: Scene(of="stopping", operator=[(AT - 0.1, "quickstop")]),
    Mode.FAULT: Scene(of="driving", at=AT + 0.001, along=STOPPING),
}
PHASES = {"first contact": 0.541, "proving the watchdog": 0.661, "aligning": 1.501}
EACH = 3


def drawn(place: Scene, count: int, seed: int) -> list[tuple[str, Scene]]:
    """The place, with errors of drives drawn by lot."""
    dice = random.Random(seed)
    errors = [(id, codes[0]) for id, codes in CODES["epos1"].items() if id != "DRV-20"]  # in a bring-up it is expected
    found = []
    for id, code in dice.sample(errors, count):
        error = of_code(id, code, dice.choice(DRIVES))
        found.append((id, replace(place, inject=id, node=error.node, options=error.options, coasts=error.coasts)))
    return found


CASES = [
    *(
        (mode.value, *drawing)
        for seed, (mode, place) in enumerate(PLACES.items())
        for drawing in drawn(place, EACH, seed)
    ),
    *(
        (phase, *drawing)
        for seed, (phase, at) in enumerate(PHASES.items())
        for drawing in drawn(Scene(of="bring-up", at=at), 1, 100 + seed)
    ),
    *(("controlled stop", *drawing) for drawing in drawn(Scene(of="held", along=HELD), EACH, 200)),
]


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("where", "id", "scene"), CASES, ids=name_of)
def test_error_of_a_drive_is_noticed_wherever_it_comes(tmp_path: Path, where: str, id: str, scene: Scene) -> None:
    run = play(tmp_path, id, scene)
    found = assert_noticed(run, id, scene)
    assert where in (found.before.value, run.seen[run.seen.index(found.seen) - 1].phase, "controlled stop")
    assert_follows(run, scene, found)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("phase", "at"), [("listening", 0.201), ("secure", 0.301), ("configure", 0.401)])
def test_error_before_a_drive_exchanges_process_data_is_told_at_once_by_its_name(
    tmp_path: Path, phase: str, at: float
) -> None:
    scene = replace(of_code("DRV-05", 0x5113, "steer-right", of="bring-up"), at=at)
    run = play(tmp_path, "DRV-05", scene)
    found = assert_noticed(run, "DRV-05", scene)
    assert run.seen[run.seen.index(found.seen) - 1].phase == phase
    assert_follows(run, scene, found)
    assert run.fault_ids == ["DRV-05"]
    assert all(standing(truth) for truth in run.world.history)


def test_error_whose_message_is_lost_while_a_drive_is_configured_is_seen_before_anything_moves(tmp_path: Path) -> None:
    error = of_code("DRV-05", 0x5113, "steer-right", of="bring-up", heard=False)
    first_contact = 1.5  # so long the drives have to be ready
    scene = replace(error, at=0.401, effect=in_phase("first contact", first_contact))
    run = play(tmp_path, "COM-01", scene)
    assert_follows(run, scene, assert_noticed(run, "COM-01", scene))
    assert all(standing(truth) for truth in run.world.history)
