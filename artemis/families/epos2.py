"""The second-generation EPOS: the first one's tables but for what it has more.

Sources: the object header of EPOS2 and drivers that run it (`kralf/libepos`, `uos/epos2_motor_controller`): states with
Refresh and Measure Init, objects and modes as of the first generation, encoder pulses of 32 bit, option codes
0x605B, 0x605C and 0x605E, automatic bit rate; error codes as several drivers name them that quote the firmware
specification of the EPOS2. Mode 7, whose buffer 0xFF0C is about, is not used here. What it speaks on USB (frames of the
EPOS4 around commands of the first generation) is not known to artemis.
"""

from __future__ import annotations

from dataclasses import replace

from artemis.families.epos1 import EPOS1, configuration
from artemis.families.family import OptionCode
from artemis.families.objects import FAULT_REACTION, U32, Object, Setting

ERRORS = {
    **EPOS1.errors,
    0x5114: "DRV-04",  # supply of the power stage too low
    0xFF0C: "DRV-38",  # interpolated position mode
    0xFF0D: "DRV-41",  # auto tuning
    0xFF0F: "DRV-08",  # gear scaling factor
    0xFF10: "DRV-40",  # controller gain
    0xFF11: "DRV-17",  # direction of the main sensor
    0xFF12: "DRV-17",  # of the auxiliary sensor
}

EPOS2 = replace(
    EPOS1,
    name="epos2",
    title="EPOS2",
    generation=2,
    top_counts=4 * 2_500_000,
    still_rpm=1.0,  # a fine encoder tells many counts of a shaft that stands
    configuration=configuration(Object(0x2210, 1, U32)),
    option_codes=(OptionCode(setting=Setting(FAULT_REACTION, 2), name="reaction to a fault: quick-stop ramp"),),
    errors=ERRORS,
    bit_rates={**EPOS1.bit_rates, 9: 0},
)
