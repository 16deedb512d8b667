"""A trial of an input that opens nothing: it is made, to see before the run what is wrong in its files."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from artemis.config import Config
from artemis.errors import ConfigError
from artemis.plugins.contracts import PluginContext
from artemis.plugins.guard import PLUGIN_ERRORS, told
from artemis.yaml_file import KeyPath


def trial(
    plugin: Callable[[Config, PluginContext], object], config: Config, context: PluginContext
) -> Iterator[tuple[KeyPath, str]]:
    """What the plugin complains of: keys of its own, each with what is wrong; or (), with file:line:column."""
    own = f"{context.name}: "
    try:
        plugin(config, context)
    except ConfigError as error:
        for problem in error.problems:
            key, _, text = problem.removeprefix(own).partition(": ")
            yield ((key,), text) if problem.startswith(own) else ((), problem)
    except PLUGIN_ERRORS as error:
        yield ("plugin",), f"the plugin cannot be made: {told(error)}"
