"""Hosts that die while the robot drives: `make host-death`. The drives are simulated here, in another process."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))  # what tests share, where pytest has not put it
