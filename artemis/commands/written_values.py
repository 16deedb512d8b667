"""New values of a robot file that a calibration found: written once a person has confirmed it."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

from artemis.commands.terminal import confirmed
from artemis.errors import ConfigError
from artemis.yaml_edit import Keys, edit
from artemis.yaml_file import Data


def check_yes(robot_file: Path | None, *, yes: bool) -> None:
    """Nothing, if `--yes` has something to confirm.

    Raises:
        ConfigError: it has not.
    """
    if yes and robot_file is None:
        raise ConfigError("--yes confirms what --write ROBOT writes: say which robot file")


def write_values(command: str, robot_file: Path | None, values: Mapping[Keys, Data], *, yes: bool) -> None:
    """Write values into a robot file, once that is confirmed, and print whether they are written.

    Args:
        command: its name, for messages.
        robot_file: None: they are not to be written.
        values: by their keys.
        yes: it is confirmed.

    Raises:
        ConfigError: no person can confirm it, or the file cannot be edited.
    """
    if robot_file is None:
        sys.stdout.write("not written; --write ROBOT writes the new values into the robot file\n")
    elif not yes and not confirmed(command, f"write the new values into {robot_file}?"):
        sys.stdout.write(f"not written: {robot_file}\n")
    else:
        edit(robot_file, values)
        sys.stdout.write(f"written: {robot_file}\n")
