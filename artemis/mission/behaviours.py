"""Steps of a mission that behaviour plugins do: the key is the plugin's name."""

from __future__ import annotations

from typing import Any

from artemis.errors import PluginError
from artemis.plugins.contracts import Declared, declared
from artemis.progress import OWN_STEPS
from artemis.states.outline import steps_in

UNTIL = "until"
"""The key of a behaviour that artemis reads as a condition."""


def installed_behaviours() -> list[str]:
    """Names of the behaviours that are installed."""
    from artemis.plugins.registry import BEHAVIOURS, names

    return names(BEHAVIOURS)


def behaviour_class(name: str) -> type[Any]:
    """The class of a behaviour. Raises PluginError: there is none of this name, or it is broken."""
    from artemis.plugins.registry import BEHAVIOURS, load

    return load(BEHAVIOURS, name)


def declarations(steps: Any) -> dict[str, Declared]:  # noqa: ANN401 (of a file)
    """What the behaviours of these steps state of themselves, by name; one that is broken is left out."""
    found: dict[str, Declared] = {}
    for name in behaviours_in(steps):
        try:
            found[name] = declared(behaviour_class(name))
        except PluginError:  # the loader complains of it
            continue
    return found


def behaviours_in(steps: Any) -> list[str]:  # noqa: ANN401 (of a file)
    """Names of the behaviours that do steps among these, each once."""
    return list(dict.fromkeys(word for _, word, _ in steps_in(steps) if word not in OWN_STEPS))
