"""`artemis map` in this process: what it says, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from artemis.cli import app
from artemis.errors import ArtemisError


def call(*words: str | Path) -> str:
    done = CliRunner().invoke(app, ["map", *map(str, words)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


def refused(*words: str | Path) -> str:
    with pytest.raises(ArtemisError) as caught:
        CliRunner().invoke(app, ["map", *map(str, words)], catch_exceptions=False, standalone_mode=False)
    return str(caught.value)
