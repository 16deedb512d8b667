"""Plugins that are installed: found by their entry points, imported one by one when they are asked for."""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from artemis.config import Config
from artemis.errors import PluginError, similar
from artemis.plugins.acting import misdeclared
from artemis.plugins.contracts import (
    CONTRACT,
    Behaviour,
    Declared,
    Follower,
    InputDevice,
    Localizer,
    Observer,
    Scanner,
    declared,
)
from artemis.progress import OWN_STEPS

INPUTS = "artemis.inputs"
FOLLOWERS = "artemis.followers"
LOCALIZERS = "artemis.localizers"
SCANNERS = "artemis.scanners"
OBSERVERS = "artemis.observers"
BEHAVIOURS = "artemis.behaviours"
CONTRACTS: dict[str, type[Any]] = {
    INPUTS: InputDevice,
    FOLLOWERS: Follower,
    LOCALIZERS: Localizer,
    SCANNERS: Scanner,
    OBSERVERS: Observer,
    BEHAVIOURS: Behaviour,
}
"""Entry-point groups, and what the classes in them must be able to do."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Listed:
    """One entry point, for people."""

    name: str
    group: str
    distribution: str
    """Package that brings it; empty if that is not known."""
    version: str
    target: str
    """Where the class is: `module:Class`."""
    error: str | None = None
    """Why it cannot be used."""


def listing(group: str, *, check: bool = False) -> tuple[Listed, ...]:
    """Plugins of a group, by name.

    Args:
        group: one of `CONTRACTS`.
        check: import every one of them, to know whether it works. Without it nothing is imported, and only names that
            several packages claim count as errors.
    """
    found = _found(group)
    return tuple(
        Listed(
            name=point.name,
            group=group,
            distribution=_owner(point),
            version=point.dist.version if point.dist else "",
            target=point.value,
            error=_error(point, found, check=check),
        )
        for point in found
    )


def load(group: str, name: str) -> type[Any]:
    """The class of a plugin, checked against its group's contract; a broken plugin harms nobody else.

    Args:
        group: one of `CONTRACTS`.
        name: as the mission writes it.

    Raises:
        PluginError: no plugin has this name, several packages claim it, its import fails, or it breaks the contract.
    """
    found = _found(group)
    claimants = [point for point in found if point.name == name]
    if not claimants:
        raise PluginError(f"{group}: no plugin '{name}'; {similar(name, names(group)) or 'none is installed'}")
    if len(claimants) > 1:
        raise PluginError(_claimed_twice(group, claimants))
    return _import(claimants[0])


def behaviour_class(name: str) -> type[Any]:
    """The class of a behaviour. Raises as `load`."""
    return load(BEHAVIOURS, name)


def declarations(behaviours: Iterable[str]) -> dict[str, Declared]:
    """What behaviours state of themselves, by name; one that is broken or not installed is left out."""
    found: dict[str, Declared] = {}
    for name in behaviours:
        with suppress(PluginError):  # the loader of a mission complains of it
            found[name] = declared(behaviour_class(name))
    return found


def package_of(group: str, name: str) -> str:
    """Name and version of the package that brings a plugin; empty if that is not known."""
    found = [point.dist for point in _found(group) if point.name == name and point.dist is not None]
    return f"{found[0].name} {found[0].version}" if found else ""


def names(group: str) -> list[str]:
    """Names of the plugins of a group; nothing is imported."""
    return sorted({point.name for point in _found(group)})


def _found(group: str) -> list[EntryPoint]:
    return sorted(entry_points(group=group), key=lambda point: (point.name, _owner(point)))


def _owner(point: EntryPoint) -> str:
    return point.dist.name if point.dist else ""


def _error(point: EntryPoint, found: list[EntryPoint], *, check: bool) -> str | None:
    claimants = [other for other in found if other.name == point.name]
    if len(claimants) > 1:
        return _claimed_twice(point.group, claimants)
    if check:
        try:
            _import(point)
        except PluginError as error:
            return str(error)
    return None


def _claimed_twice(group: str, claimants: list[EntryPoint]) -> str:
    owners = " and ".join(f"{_owner(point)} ({point.value})" for point in claimants)
    return f"{group}: '{claimants[0].name}' is claimed by {owners}; uninstall one"


def _import(point: EntryPoint) -> type[Any]:
    """Import a class and check that it is a plugin of its group."""
    place = f"{point.group}: plugin '{point.name}' of {_owner(point)} ({point.value})"
    try:
        plugin = point.load()
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a stranger's module may raise anything; its cause is chained
        raise PluginError(f"{place} cannot be imported: {type(error).__name__}: {error}") from error
    problems = breaches(plugin, CONTRACTS[point.group])
    if point.group == BEHAVIOURS and point.name in OWN_STEPS:
        problems.append("has the name of a step of artemis' own: give it another one")
    if problems:
        raise PluginError([f"{place} {problem}" for problem in problems])
    return plugin  # type: ignore[no-any-return]  # a class, as `breaches` has seen


def breaches(plugin: object, contract: type[Any]) -> list[str]:
    """What keeps an object from being a plugin of a contract."""
    if not inspect.isclass(plugin):
        return [f"is not a class but {plugin!r:.80}"]
    version = getattr(plugin, "contract", CONTRACT)
    if version != CONTRACT:
        return [f"was written for contract {version}; this artemis has contract {CONTRACT}"]
    methods = [name for name, value in vars(contract).items() if inspect.isfunction(value) and name[0] != "_"]
    problems = [f"has no method {name}()" for name in methods if not callable(getattr(plugin, name, None))]
    for name in ("live", "pure", "own_process"):
        if not isinstance(stated := getattr(plugin, name, False), bool):
            problems.append(f"states {name} = {stated!r:.40}: True or False is meant")
    problems += misdeclared(declared(plugin)) if contract is Behaviour else ()
    config = getattr(plugin, "Config", None)
    if not (inspect.isclass(config) and issubclass(config, Config)):
        problems.append("has no Config that is a subclass of artemis.config.Config")
    elif contract is Behaviour and (until := config.model_fields.get("until")):
        if not until.is_required() and until.default is not None:
            problems.append("has a default of until in its Config: only a mission may write this condition")
    return problems
