"""Where a user's own files are kept."""

from __future__ import annotations

import os
from pathlib import Path


def user_folder(variable: str, below_home: str) -> Path:
    """The folder of artemis below what an environment variable names, else below the home (XDG Base Directory).

    Raises:
        RuntimeError: it names none, and the user has no home.
    """
    base = os.environ.get(variable, "")
    return (Path(base) if os.path.isabs(base) else Path.home() / below_home) / "artemis"
