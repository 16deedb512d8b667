"""When a shaft counts as standing: a fine encoder tells many counts of one that does, a coarse one may tell one."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import pytest
from epos_jobs_rig import STEER_LEFT, Rig, changed, on

from artemis.drive_schema import Sensor
from artemis.errors import DeviceError
from artemis.families.objects import POSITION, Object
from artemis.vehicle import RobotFile


def with_encoder(family: str, counts: int) -> RobotFile:
    return changed(STEER_LEFT, family=family, sensor=Sensor(type="encoder_3_channel", counts_per_turn=counts))


@pytest.mark.parametrize(
    ("family", "counts", "swing", "stands"),
    [
        ("epos2", 10_000_000, 3000, True),
        ("epos2", 10_000_000, 4000, False),
        ("epos2", 2000, 1, True),
        ("epos2", 2000, 2, False),
        ("epos2", 400, 1, True),
        ("epos1", 2000, 1, True),
        ("epos1", 2000, 2, False),
    ],
)
def test_a_shaft_stands_where_its_sensor_tells_no_more_than_a_turn_a_minute(
    family: str, counts: int, swing: int, stands: bool
) -> None:
    async def test(rig: Rig) -> None:
        shown: Iterator[int] = itertools.cycle((0, swing))

        async def read(object: Object) -> int:
            assert object == POSITION
            return next(shown)

        rig.jobs.read = read  # type: ignore[method-assign]
        if stands:
            await rig.jobs._come_to_rest()
        else:
            with pytest.raises(DeviceError, match="found moving"):
                await rig.jobs._come_to_rest()

    on(STEER_LEFT, test, robot=with_encoder(family, counts))
