"""A mission without a robot, driven by the outcomes that a test gives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath

from msgspec.structs import replace

from artemis.errors import ConfigError, nearest_of, shown, similar
from artemis.mission.loading import LoadedMission, load_mission
from artemis.mission.tree import MissionTree
from artemis.progress import DONE, Acted, MissionEvent, Position, SignalValue
from artemis.states.advance import MissionFacts, advance
from artemis.states.condition import SignalKind, Value
from artemis.states.tree import FAULT, LOST, LOST_FAULTS, TIMEOUT, Leaf, Tree, inside
from artemis.supervision.catalogue import ROWS
from artemis.yaml_file import dotted

Happening = str | float | Mapping[str, Value]
"""How the present step ends, an answer to its question, or `fault:ID`; or so many seconds pass; or signals change."""
DT = 0.02
"""What a tick lasts in which nothing else is said [s]."""
ANY_BEHAVIOUR = -1
"""Number of the behaviour that publishes a signal: whichever it is."""


class MissionWalk:
    """A mission on its way.

    Attributes:
        steps: Steps that have begun so far, in their order, in words: `follow paths/lap.csv`, `wait 20 s`.
        places: Where these stand in the mission: `steps[1].follow`.
        events: What was reported so far: `retry 1 of 2 after fault:DRV-25`.
        said: What was reported to people.
    """

    def __init__(self, found: MissionTree, tree: Tree | None = None) -> None:
        """At the beginning; `tree` takes the place of the mission's."""
        self.found, self.tree = found, tree or found.tree
        self._told = {name for node in inside(self.tree.root) if isinstance(node, Leaf) for name in node.signals}
        self.words = {dotted(path): name for (path, _), name in zip(found.steps, found.names, strict=True)}
        self.position = Position()
        self.signals: dict[str, Value] = {"run_s": 0.0, "driven_m": 0.0}
        self.places = [dotted(found.steps[0][0])] if self.tree.is_list else []
        self.told: list[MissionEvent] = []
        self.beside: list[int] = []
        """Numbers of the behaviours that run beside the present step."""
        self.tick(dt=0.0)

    @property
    def steps(self) -> list[str]:
        """See the class."""
        return [self.words[place] for place in self.places]

    @property
    def events(self) -> list[str]:
        """See the class."""
        return [f"{event.kind} {event.text}" for event in self.told]

    @property
    def said(self) -> list[str]:
        """See the class."""
        return [event.text for event in self.told if event.kind == "said"]

    @property
    def is_over(self) -> bool:
        """Nothing is left of it."""
        return self.position.step >= self.tree.size

    @property
    def at(self) -> str:
        """The step that runs now, in words; empty: the mission has ended."""
        return "" if self.is_over else self.found.names[self.position.step]

    @property
    def ended(self) -> str:
        """`done`, or the outcome that ended the mission; empty: it has not ended."""
        return (self.position.ended or DONE) if self.is_over else ""

    def tick(
        self,
        outcome: str = "",
        *,
        dt: float = DT,
        fault: str = "",
        answer: str = "",
        pressed: Sequence[str] = (),
        of: int | None = None,
    ) -> None:
        """One tick: what happened to the present step, or to that `of` a number beside it; signals that are true in it.

        The robot stands; a step that calibrates is finished before anything else is begun, as on the robot.
        """
        self.signals["run_s"] = float(self.signals["run_s"]) + dt
        told = tuple(
            SignalValue(name=n, value=float(self.signals.pop(n))) for n in sorted(self._told & self.signals.keys())
        )
        position = replace(self.position, faults=(fault,)) if fault else self.position
        waits = not self.is_over and self.found.passive[position.step] is not None
        acted = {ANY_BEHAVIOUR: Acted(step=ANY_BEHAVIOUR, signals=told)} if told else {}
        if of is not None:
            acted[of], outcome = Acted(step=of, outcome=outcome), ""
        facts = MissionFacts(
            signals={**self.signals, **dict.fromkeys(pressed, True)},
            dt=dt,
            standing=bool(fault) or self.is_over or self.found.steps[position.step][1].calibrate is None,
            done=position.done + dt if waits else None,
            outcome=outcome,
            answers=(answer,) if answer else (),
            acted=acted,
        )
        advanced = advance(self.tree, self.found.passive, position, facts)
        self.position = advanced.position
        self.beside = [number for number in advanced.beside if self.found.passive[number] is None]
        self.told += advanced.events
        self.places += advanced.entered


def walk(mission: str | FilePath | LoadedMission, *happenings: Happening) -> MissionWalk:
    """Drive a mission by what happens, one thing after the other, without robot and simulation.

    Args:
        mission: Its file, or the loaded mission.
        happenings: A text is how the present step ends (`done`, `timeout`, an outcome of its own), or else a behaviour
            beside it; an answer to its question; or a fault (`fault:DRV-25`; `lost` for one that lost the path). A
            number is so many seconds that pass. A mapping changes signals: `{"battery_v": 22.0}`; one that is true is
            so for one tick, as a button is.

    Raises:
        ConfigError: the mission is wrong; or something cannot happen where it is.
    """
    loaded = mission if isinstance(mission, LoadedMission) else load_mission(FilePath(mission))
    made = MissionWalk(loaded.tree)
    for number, happening in enumerate(happenings, start=1):
        try:
            _happen(made, happening)
        except ConfigError as error:
            raise ConfigError(f"walk: {shown(happening)}, number {number}: {error}") from None
    return made


def _happen(made: MissionWalk, happening: Happening) -> None:
    if made.is_over:
        raise ConfigError(f"the mission has ended before, with {made.ended}")
    if isinstance(happening, Mapping):
        for name, value in happening.items():
            _check_signal(name, value, made.found.declared)
        pressed = [name for name, value in happening.items() if value is True]
        made.signals.update({name: value for name, value in happening.items() if value is not True})
        made.tick(pressed=pressed)
    elif isinstance(happening, str):
        _end_step(made, happening)
    elif isinstance(happening, bool) or happening < 0:
        raise ConfigError("write an outcome, so many seconds, or signals with their values")
    else:
        made.tick(dt=float(happening))


def _check_signal(name: str, value: Value, declared: Mapping[str, SignalKind]) -> None:
    if name not in declared:
        raise ConfigError(f"unknown signal {name!r}; {similar(name, declared)}")
    kind = declared[name].kind
    if name == "answer":
        raise ConfigError("an answer is given to the step that asks: write it as a text")
    if isinstance(value, bool) is not (kind is bool) or isinstance(value, str) is not (kind is str):
        raise ConfigError(f"{name} is {'true or false' if kind is bool else 'a number'}")


def _end_step(made: MissionWalk, outcome: str) -> None:
    number = made.position.step
    passive, ends = made.found.passive[number], made.found.outcomes[number]
    limit = passive.at_most if passive is not None else None
    kind, _, id = outcome.partition(":")
    if kind == FAULT and id in ROWS:
        made.tick(fault=id)
    elif outcome == LOST and LOST in ends:
        made.tick(fault=LOST_FAULTS[0])
    elif passive is not None and outcome in passive.answers:
        made.tick(answer=outcome)
    elif outcome == DONE and passive is not None and passive.seconds is not None:
        made.tick(dt=passive.seconds - made.position.done)
    elif outcome == TIMEOUT and limit is not None:
        made.tick(dt=limit - made.position.done)
    elif outcome in ends and not (passive is not None and passive.answers):
        made.tick(outcome)
    elif beside := [n for n in made.beside if outcome in made.found.outcomes[n]]:
        made.tick(outcome, of=beside[0])
    else:
        raise _impossible(made, outcome)


def _impossible(made: MissionWalk, outcome: str) -> ConfigError:
    number = made.position.step
    passive = made.found.passive[number]
    kind, _, id = outcome.partition(":")
    if kind == FAULT and id:
        near = nearest_of(id, ROWS) or "`artemis faults` shows it"
        return ConfigError(f"no fault {id!r} in the fault table; {near}")
    answers = passive.answers if passive is not None else ()
    ends = made.found.outcomes[number] - ({DONE} if answers else set())
    ends = ends.union(*(made.found.outcomes[n] for n in made.beside))
    names = [*answers, *sorted(ends), f"{FAULT}:ID"]
    return ConfigError(f"the step '{made.at}' does not end so; {similar(outcome, names)}")
