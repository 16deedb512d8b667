"""A mission as a tree of steps: words compose steps; each step ends with an outcome, `done` or one that it declares."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from msgspec import Struct

from artemis.states.condition import Condition

TIMEOUT, FAULT, ANY = "timeout", "fault", "any"
LOST, LOST_FAULTS = "lost", ("PTH-05", "PTH-06", "LOC-01", "LOC-02", "LOC-03")
"""Faults of a step that follows a path which are its outcome `lost`, too."""
RESUME, RESTART = "resume", "restart"


class Leaf(Struct, frozen=True):
    """A step that takes time."""

    number: int
    """Among the mission's steps, as they stand there."""
    path: str
    """Key path in the mission."""
    signals: tuple[str, ...] = ()
    """What its behaviour publishes: forgotten where it begins."""


class Say(Struct, frozen=True):
    """Reports something to people."""

    path: str
    text: str


class End(Struct, frozen=True):
    """The mission's ordered end."""

    path: str
    outcome: str
    text: str = ""


class Steps(Struct, frozen=True):
    """One after the other."""

    of: tuple[Node, ...]


class Repeat(Struct, frozen=True, kw_only=True):
    """Again and again: so often, or until a condition holds between two rounds; without either for ever."""

    path: str
    steps: Steps
    times: int | None = None
    until: Condition | None = None


class Try(Struct, frozen=True, kw_only=True):
    """Catches outcomes: tries again, then does the branch that names one."""

    path: str
    steps: Steps
    retries: int = 0
    again_on: tuple[str, ...] = (ANY,)
    """`any` means no fault."""
    between: Steps | None = None
    catch: tuple[tuple[str, Steps], ...] = ()

    @property
    def keys(self) -> tuple[str, ...]:
        """All that it names."""
        return (*self.again_on, *(name for name, _ in self.catch))

    def names(self, outcome: str) -> tuple[str, ...]:
        """What it may call an outcome by; see `names_in`."""
        return names_in(outcome, self.keys)

    def tries_again(self, outcome: str) -> bool:
        """Whether its steps begin anew after it, while retries are left: after a fault only where a name means it."""
        return not set(names_in(outcome, self.again_on)).isdisjoint(self.again_on)


class Watch(Struct, frozen=True, kw_only=True):
    """What is done when a condition becomes true, and what then."""

    text: str
    condition: Condition
    steps: Steps | None
    then: str


class During(Struct, frozen=True, kw_only=True):
    """Watches while its steps run."""

    path: str
    steps: Steps
    at_most: float | None
    """[s] in which the mission runs."""
    when: tuple[Watch, ...]


class Choose(Struct, frozen=True, kw_only=True):
    """The first branch whose condition holds; one without a condition always."""

    path: str
    branches: tuple[tuple[Condition | None, Steps], ...]


class Together(Struct, frozen=True, kw_only=True):
    """Steps that may move the robot, and others beside that may not."""

    path: str
    steps: Steps
    beside: tuple[Steps, ...]


Node = Leaf | Say | End | Steps | Repeat | Try | During | Choose | Together


def inside(part: object) -> Iterator[Node]:
    """The nodes in a part of a tree, itself among them, as they stand in the mission."""
    if isinstance(part, Node):
        yield part
    if isinstance(part, tuple | Node | Watch):
        for inner in part if isinstance(part, tuple) else (getattr(part, name) for name in part.__struct_fields__):
            yield from inside(inner)


class Tree(Struct, frozen=True):
    """A mission's words around its steps."""

    root: Steps
    size: int
    """How many steps that take time it has."""
    is_list: bool
    """It is a list of such steps, and nothing else."""
    faults: frozenset[str]
    """What its words call faults by which they make outcomes."""


def tree_of(root: Steps) -> Tree:
    """The tree of a mission."""
    nodes = list(inside(root))
    return Tree(
        root=root,
        size=len([node for node in nodes if isinstance(node, Leaf)]),
        is_list=all(isinstance(node, Leaf) for node in root.of),
        faults=frozenset(name for node in nodes if isinstance(node, Try) for name in node.keys if is_fault(name)),
    )


def list_of(signals: Iterable[Iterable[str]]) -> Tree:
    """The tree of a mission that is a list of steps, with the signals that each publishes."""
    return tree_of(Steps(tuple(Leaf(index, f"steps[{index}]", tuple(told)) for index, told in enumerate(signals))))


def is_fault(name: str) -> bool:
    """Whether a `try` means faults by a name."""
    return name in (FAULT, LOST) or name.startswith(f"{FAULT}:")


def fault_names(id: str) -> tuple[str, ...]:
    """What a `try` may call a fault by, of which the fault table has this id; the most exact name first."""
    return (f"{FAULT}:{id}", *((LOST,) if id in LOST_FAULTS else ()), FAULT)


def names_in(outcome: str, keys: Sequence[str]) -> tuple[str, ...]:
    """What a `try` that names `keys` may call an outcome by, the most exact name first; (): a fault that none names."""
    kind, _, id = outcome.partition(":")
    names = fault_names(id) if kind == FAULT else (outcome,)
    return () if kind == FAULT and not set(names).intersection(keys) else (*names, ANY)
