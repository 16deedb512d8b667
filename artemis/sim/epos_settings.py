"""What differs from drive to drive, or is not in its specification."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from artemis.config import Config

Seconds = Annotated[float, Field(ge=0)]


class SimSettings(Config):
    """Of simulated drives; the EPOS4's own are in `epos4`."""

    answer_time_s: Seconds = 0.0003
    """From the end of an SDO request to the answer being ready: an assumption, of no EPOS. EPOS4 drives were seen to
    answer 0.26 to 0.46 ms after a request, the 0.13 ms of the answer's frame included (a candump of 12 transfers)."""
    boot_time_s: Seconds = 0.05
    """From power-up or reset to the boot-up frame."""
    refresh_s: Seconds = 0.005
    """Time in the state Refresh."""
    measure_s: Seconds = 0.005
    """Time in the state Measure Init; of others that of the transition to Switched On, in which they measure, too."""
    firmware: Annotated[int, Field(ge=0x2030, le=0xFFFF)] = 0x2033
    """Object 0x2003:1."""
    position_limits_clip: bool = False
    """Limits 0x607D clip the set-point (specification, figures 7 and 21) instead of raising 0xFF09 (14.74)."""
    under_voltage_v: Seconds = 9.0
    over_voltage_v: Seconds = 30.0
    """The supply thresholds are assumptions: the hardware references of the 24/1 and 24/5 are not at hand."""
    epos4: Epos4Settings = Field(default_factory=lambda: Epos4Settings())


class Epos4Settings(Config):
    """Of simulated EPOS4 drives."""

    firmware: Annotated[int, Field(ge=0x0100, le=0xFFFF)] = 0x0170
    """High word of object 0x1018:3."""
    boot_time_s: Seconds = 0.2
    """From power-up or reset to the boot-up frame: published nowhere; a public simulator takes as long."""
    late_set_points: Annotated[float, Field(ge=0)] = 1.0
    """So many interpolation periods a set-point may be late before 0x8250: published nowhere."""
    overload_warns: bool = True
    """0xFF01 is a warning, as public tables of 2026 have it; those of 2021 have an error that cuts the power."""
