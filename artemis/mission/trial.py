"""Trials of inputs before the run: one that opens nothing is made, and no two of a step may read one device."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import combinations
from typing import Any

from artemis.config import Config
from artemis.errors import ConfigError
from artemis.plugins.contracts import PluginContext
from artemis.plugins.guard import PLUGIN_ERRORS, told
from artemis.plugins.stated import may_share_device
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
    except KeyboardInterrupt:  # Ctrl-C meanwhile is the operator's wish
        raise
    except PLUGIN_ERRORS as error:
        yield ("plugin",), f"the plugin cannot be made: {told(error)}"


def shared_devices(
    names: Iterable[str], plugins: Mapping[KeyPath, tuple[Any, Config]], files: Mapping[str, bytes]
) -> Iterator[str]:
    """Inputs of one step that may read the same device; `plugins`: class and keys by place, `files`: content."""
    used = [(name, *plugins["inputs", name]) for name in names if ("inputs", name) in plugins]
    for (one, plugin, config), (other, another, its_config) in combinations(used, 2):
        if plugin is another and may_share_device(plugin, config, its_config, files):
            yield f"{one} and {other} may be one device: tell them apart by profile or serial"
