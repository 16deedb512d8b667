"""Which modules are compiled where that is asked for (`ARTEMIS_COMPILE=1`, `make fast`). Otherwise none is."""

import os

from setuptools import setup

COMPILED = """
artemis/devices/allow_list.py
artemis/devices/bus_gateway.py
artemis/devices/canopen.py
artemis/devices/drive.py
artemis/devices/epos.py
artemis/devices/epos_state.py
artemis/motion/ackermann.py
artemis/motion/angles.py
artemis/motion/limits.py
artemis/motion/odometry.py
artemis/motion/pace.py
artemis/motion/perception.py
artemis/motion/pose_filter.py
artemis/motion/poses.py
artemis/motion/potentiometers.py
artemis/motion/samples.py
artemis/plugins/answers.py
artemis/plugins/followers/frenet.py
artemis/plugins/followers/progress.py
artemis/plugins/guard.py
artemis/recording/event_log.py
artemis/recording/mcap_file.py
artemis/recording/mcap_writer.py
artemis/sim/axis.py
artemis/sim/bus.py
artemis/sim/cia402.py
artemis/sim/cia402_motion.py
artemis/sim/cia402_power.py
artemis/sim/dictionary.py
artemis/sim/epos.py
artemis/sim/epos1_motion.py
artemis/sim/epos2.py
artemis/sim/epos4.py
artemis/sim/epos4_errors.py
artemis/sim/epos4_homing.py
artemis/sim/epos4_motion.py
artemis/sim/epos4_periphery.py
artemis/sim/epos4_power.py
artemis/sim/epos_error_control.py
artemis/sim/epos_errors.py
artemis/sim/epos_motion.py
artemis/sim/epos_objects.py
artemis/sim/epos_parameters.py
artemis/sim/epos_pdo.py
artemis/sim/epos_power.py
artemis/sim/epos_sdo.py
artemis/sim/servo.py
artemis/sim/truth.py
artemis/sim/vehicle.py
artemis/sim/wheels.py
artemis/sim/wire.py
artemis/sim/world.py
artemis/states/blocked.py
artemis/states/follow.py
artemis/states/modes.py
artemis/states/parts.py
artemis/supervision/measures.py
artemis/supervision/poses.py
artemis/supervision/steered.py
artemis/supervision/supervisor.py
artemis/supervision/wheels.py
""".split()

extensions = []
if os.environ.get("ARTEMIS_COMPILE"):
    from mypyc.build import mypycify

    extensions = mypycify(COMPILED, opt_level="1", debug_level="0")

setup(ext_modules=extensions)
