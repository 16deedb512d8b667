"""What a mission may say of driving by hand."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from artemis.config import Config
from artemis.mission.keys import Name, Positive, check_one_key
from artemis.mission.obstacles import Obstacles


class Until(Config):
    """When driving by hand is over: either key."""

    button: Literal["done"] | None = None
    """The button `done` of the input."""
    seconds: Positive | None = None
    """So long."""

    @model_validator(mode="after")
    def _one_key(self) -> Self:
        check_one_key(self, "until")
        return self


class Teleop(Config):
    """Drive by hand with one of the mission's inputs, or with several by priority."""

    input: str | None = None
    """One of the mission's `inputs`."""
    inputs: Annotated[tuple[str, ...], Field(strict=False, min_length=2)] | None = None
    """The first that is active has the robot; another one takes over once that was released, and its own controls
    were."""
    until: Until
    """When it is over."""
    record: Name | None = None
    """Record the path that is driven under this name: all of it, or what lies between two presses of the record
    button. It is kept in the run's folder, and a later step may follow it."""
    obstacles: Obstacles | None = None
    """In this step; if left out, as in the mission."""

    @property
    def names(self) -> tuple[str, ...]:
        """Its inputs, the one of the highest priority first."""
        return self.inputs or (self.input or "",)

    @model_validator(mode="after")
    def _input_or_inputs(self) -> Self:
        if (self.input is None) == (self.inputs is None):
            raise ValueError("expected input: NAME, or inputs: [FIRST, SECOND], the highest priority first")
        if len(set(self.names)) < len(self.names):
            raise ValueError(f"inputs: one of them twice: {', '.join(self.names)}")
        return self
