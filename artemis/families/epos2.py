"""The second-generation EPOS: the first one's tables but for what it has more.

Sources: the object header of EPOS2 and drivers that run it (`kralf/libepos`, `uos/epos2_motor_controller`): states with
Refresh and Measure Init, objects and modes as of the first generation, encoder pulses of 32 bit, option codes
0x605B, 0x605C and 0x605E, automatic bit rate. Codes that it has beyond the first generation's have no row of their own.
"""

from __future__ import annotations

from dataclasses import replace

from artemis.families.epos1 import EPOS1, configuration
from artemis.families.family import OptionCode
from artemis.families.objects import FAULT_REACTION, U32, Object, Setting

EPOS2 = replace(
    EPOS1,
    name="epos2",
    title="EPOS2",
    generation=2,
    configuration=configuration(Object(0x2210, 1, U32)),
    option_codes=(OptionCode(setting=Setting(FAULT_REACTION, 2), name="reaction to a fault: quick-stop ramp"),),
    bit_rates={**EPOS1.bit_rates, 9: 0},
)
