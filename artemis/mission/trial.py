"""A trial of an input that opens nothing: it is made, to see before the run what is wrong in its files."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from artemis.config import Config
from artemis.errors import ConfigError
from artemis.plugins.border import PLUGIN_ERRORS, told
from artemis.plugins.contracts import Setup
from artemis.yaml_file import KeyPath


def trial(plugin: Callable[[Config, Setup], object], config: Config, setup: Setup) -> Iterator[tuple[KeyPath, str]]:
    """What the plugin complains of: keys of its own, each with what is wrong; or (), with file:line:column."""
    own = f"{setup.name}: "
    try:
        plugin(config, setup)
    except ConfigError as error:
        for problem in error.problems:
            key, _, text = problem.removeprefix(own).partition(": ")
            yield ((key,), text) if problem.startswith(own) else ((), problem)
    except PLUGIN_ERRORS as error:
        yield ("plugin",), f"the plugin cannot be made: {told(error)}"
