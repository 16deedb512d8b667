"""Proofs that the injections into localizers happen."""

from __future__ import annotations

from dataclasses import replace
from math import isnan
from typing import Any, ClassVar

import pytest
from injection_rig import Host, proves

from artemis.config import Config
from artemis.values import Pose, PoseFix
from artemis_lab.injections.bad_plugins import BadLocalizer

FIX = PoseFix(time=5.0, pose=Pose(x=1.0, y=2.0), covariance=(1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-3), source="camera")


class Sure:
    """Tells the same fix again and again."""

    Config: ClassVar[type[Config]] = Config

    def fixes(self, now: float) -> tuple[PoseFix, ...]:
        return (FIX,)

    def close(self) -> None:
        """Nothing is open."""


def told(host: Host, id: str, **options: Any) -> tuple[PoseFix, ...]:  # noqa: ANN401 (of any row)
    """What a localizer then tells; afterwards it is as it was."""
    localizer = BadLocalizer(Sure())
    host.stage = replace(host.stage, localizer=localizer)
    assert localizer.fixes(0.0) == (FIX,)
    undo = host.inject(id, **options)
    found = localizer.fixes(0.0)
    undo()
    assert localizer.fixes(0.0) == (FIX,)
    return found


@proves("LOC-01")
async def _silent(host: Host) -> None:
    with pytest.raises(ValueError, match="needs a localizer"):
        host.inject("LOC-01")
    assert told(host, "LOC-01") == ()


@proves("LOC-02")
async def _jumps(host: Host) -> None:
    (fix,) = told(host, "LOC-02", x_m=0.5, y_m=0.0, heading_deg=90.0)
    assert (fix.pose.x, fix.pose.y, fix.pose.heading) == pytest.approx((1.5, 2.0, 1.5707963))


@proves("LOC-03")
async def _doubts(host: Host) -> None:
    (fix,) = told(host, "LOC-03", doubt=0.5)
    assert (fix.covariance, fix.quality, fix.doubt) == ((), 0.0, 0.5)


@proves("LOC-04")
async def _spoils(host: Host) -> None:
    (fix,) = told(host, "LOC-04")
    assert isnan(fix.pose.x)


@proves("LOC-05")
async def _shifts(host: Host) -> None:
    (fix,) = told(host, "LOC-05", seconds=1.0)
    assert fix.time == 6.0
