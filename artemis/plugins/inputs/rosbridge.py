"""The input `rosbridge`: commanded by velocity commands and requests of rosbridge's clients."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, ClassVar

import msgspec
from pydantic import Field

from artemis.bridges.addresses import check_listen, listening_at
from artemis.bridges.child_process import ENDED
from artemis.bridges.received import Problem
from artemis.bridges.rosbridge.input_process import InputSetup, RosbridgeProcess
from artemis.bridges.rosbridge.settings import INPUT_PORT, PortConfig, ServerConfig
from artemis.build import require
from artemis.clock import stopwatch
from artemis.config import Config
from artemis.errors import ConfigError
from artemis.plugins.contracts import PluginContext
from artemis.plugins.inputs.commanded import CommandedInput, Ros1CommandKeys


class RosbridgeInputConfig(Ros1CommandKeys, PortConfig):
    """Keys of an input with `plugin: rosbridge`."""

    port: Annotated[int, Field(ge=0, le=65535)] = INPUT_PORT
    """0: any that is free."""


class RosbridgeInput(CommandedInput):
    """A server that is commanded, in a process of its own. Nothing is opened but for a run that keeps real time."""

    Config: ClassVar[type[Config]] = RosbridgeInputConfig

    def __init__(
        self, config: RosbridgeInputConfig, context: PluginContext, clock: Callable[[], float] = stopwatch
    ) -> None:
        """Take the robot, and in a run the port; `clock` of arrivals [s].

        Raises:
            ConfigError: the extra is not installed, more speed than the robot has, the port is in use, or this computer
                has no such address.
        """
        require(f"{context.name}: plugin: rosbridge", "web", "websockets")
        super().__init__(config, context, clock)
        check_listen(context.name, config.listen)
        self.process: RosbridgeProcess | None = None
        self.port = config.port
        if context.real_time:
            listening = listening_at(context.name, config.listen, config.port)
            self.port = listening.getsockname()[1]
            keys = config.model_dump(include=set(ServerConfig.model_fields), mode="json")
            setup = InputSetup(config=msgspec.json.encode(keys).decode(), rules=self._rules)
            self.process = RosbridgeProcess(setup, listening, self._mailbox)
            self.process.start()

    @staticmethod
    def may_share(one: RosbridgeInputConfig, other: RosbridgeInputConfig, _files: Mapping[str, bytes]) -> bool:
        """Whether both listen at one port."""
        return one.port == other.port != 0

    def take_problems(self) -> list[Problem]:
        """What could not be used; and that the process ended, and is back."""
        words = [] if self.process is None else self.process.take_words()
        return [*super().take_problems(), *((ENDED, each) for each in words)]

    def close(self) -> None:
        """Leave."""
        if self.process is not None:
            self.process.close()

    def _open(self) -> None:
        if self.process is None:
            raise ConfigError("its clients need real time: leave `pace: fast` out of the mission")

    def _heard(self) -> tuple[bool, str]:
        assert self.process is not None
        return False, self.process.problem

    def _answer(self, numbers: Sequence[int], taken: bool, words: str) -> None:
        if self.process is not None:
            self.process.answer(numbers, taken, words)
