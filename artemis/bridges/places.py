"""What a run has only once, such as a port: no two of its plugins may take the same."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, runtime_checkable

if TYPE_CHECKING:
    from artemis.yaml_file import KeyPath


class TakenPlace(NamedTuple):
    """One such thing."""

    key: str
    """Of the plugin's keys: that which chooses it."""
    what: str
    """As a text, such as `port 9090`."""
    where: str = ""
    """Where it is that: of an address, a master; empty: everywhere."""

    def clashes(self, other: TakenPlace) -> bool:
        """Whether both are the same."""
        return self.what == other.what and (self.where == other.where or not (self.where and other.where))


@runtime_checkable
class TakesPlaces(Protocol):
    """Keys of an input or an observer that takes such things."""

    def places(self, name: str) -> Sequence[TakenPlace]:
        """Those that it takes, by its name in the mission."""


def clashing(plugins: Mapping[KeyPath, tuple[Any, Any]]) -> Iterator[tuple[KeyPath, str]]:
    """Keys of inputs and observers that choose what another one has, and why they cannot."""
    taken: list[tuple[str, TakenPlace]] = []
    for path, (_, config) in plugins.items():
        if path[0] not in ("inputs", "observers") or not isinstance(config, TakesPlaces):
            continue
        group, name = path[0], str(path[-1])
        for place in config.places(name):
            owner = next((owner for owner, other in taken if place.clashes(other)), None)
            if owner is not None:
                yield (*path, place.key), f"{place.what} is already used by {owner}"
            taken.append((f"{group}.{name}", place))


def port_place(listen: str, port: int) -> list[TakenPlace]:
    """A port at an address; port 0, any that is free, is nothing."""
    everywhere = listen in ("0.0.0.0", "::")
    return [TakenPlace("port", f"port {port}", "" if everywhere else listen)] if port else []
