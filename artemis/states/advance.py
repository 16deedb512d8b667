"""Where a mission is, and how it continues. Pure: no clock, no robot.

The place in the tree is one frozen value (`Position`), recorded with each tick and resumed from. An outcome other than
`done` climbs until a `try` names it. A step that begins lasts for at least one tick, so no tick turns for ever.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from msgspec import Struct, json
from msgspec.structs import replace

from artemis.progress import DONE, Acted, MissionEvent, Position, SignalValue
from artemis.states.answers import given_answer
from artemis.states.condition import Condition, Signals, holds
from artemis.states.tree import (
    FAULT,
    RESTART,
    RESUME,
    TIMEOUT,
    Choose,
    During,
    End,
    Leaf,
    Node,
    Repeat,
    Say,
    Steps,
    Together,
    Tree,
    Try,
)


class Place(Struct, frozen=True, array_like=True, gc=False):
    """Where a mission is in one of its words, and in those within."""

    numbers: tuple[int | float | str, ...] = ()
    """What it counts, which of its parts run, and an outcome that waits for the robot to stand."""
    within: tuple[Place, ...] = ()
    """Of these parts."""


class MissionFacts(Struct, frozen=True, kw_only=True):
    """What a mission has to know of a tick in which it runs."""

    signals: Signals
    dt: float = 0.0
    """Time since the last tick [s]."""
    standing: bool = True
    """The robot stands, ready for the next step."""
    done: float | None = None
    """How much of the present step is done; None: as before."""
    outcome: str = ""
    """How it ended; empty: it has not."""
    answers: tuple[str, ...] = ()
    acted: Mapping[int, Acted] = {}
    """What behaviours reported, by the number of their step."""


class Passive(Struct, frozen=True, kw_only=True):
    """A step that moves nothing: it ends by time, a condition, or an answer."""

    seconds: float | None = None
    """It is done after so long."""
    condition: Condition | None = None
    """It is done once this holds."""
    answers: tuple[str, ...] = ()
    """It is done once one of these was given."""
    at_most: float | None = None
    """Else it ends with `timeout` after so long [s]."""


class Advanced(Struct, frozen=True, kw_only=True):
    """A mission after a tick."""

    position: Position
    events: tuple[MissionEvent, ...] = ()
    rests: bool = False
    """The present step is to come to rest: something else is next."""
    beside: Mapping[int, str] = {}
    """Steps that run beside the present one, by number, each with the state of its behaviour."""
    begun: bool = False
    """Another step is the present one, or it has begun anew."""
    entered: tuple[str, ...] = ()
    """Key paths of the steps that take time and have begun in this tick."""


def advance(tree: Tree, passive: Sequence[Passive | None], position: Position, facts: MissionFacts) -> Advanced:
    """Where the mission is after a tick in which it ran.

    Args:
        tree: The mission.
        passive: Of each step, by its number, what ends it; None: the robot's modes report that.
        position: Where it was.
        facts: What it has to know.
    """
    return _Advance(passive, position, facts).result(tree)


_ENCODER, _DECODER = json.Encoder(), json.Decoder(Place)


class _Advance:
    """One tick of a mission."""

    def __init__(self, passive: Sequence[Passive | None], position: Position, facts: MissionFacts) -> None:
        self._passive, self._position, self._facts = passive, position, facts
        self._signals = {**facts.signals, "answer": position.answer} if position.answer else dict(facts.signals)
        self._told = told_after(position, facts.acted) if facts.acted else position.told
        for signal in self._told:
            self._signals[signal.name] = signal.value
        self._forgotten: tuple[str, ...] = ()
        self._events: list[MissionEvent] = []
        self._entered: list[str] = []
        self._tries: list[Try] = []
        self._is_list = False
        self._beside = False
        self._rests = self._begun = False
        self._step, self._done, self._answer = position.step, 0.0, position.answer
        self._state, self._running = "", dict[int, str]()

    def result(self, tree: Tree) -> Advanced:
        position = self._position
        place = _DECODER.decode(position.place) if position.place else Place()
        self._is_list = tree.is_list
        if tree.is_list:
            place = Place((position.step,), (_leaf_place(position.step, position.done, position.state),))
        place, outcome = self._run(tree.root, place)
        told = self._told
        if self._forgotten:
            told = tuple(signal for signal in told if signal.name not in self._forgotten)
        after = replace(position, faults=(), answer=self._answer, told=told)
        if outcome:
            ended = "" if outcome in (DONE, f"!{DONE}") else outcome.removeprefix("!")
            after = replace(after, step=tree.size, done=0.0, state="", place="", ended=ended)
        else:
            where = "" if tree.is_list else _ENCODER.encode(place).decode()
            after = replace(after, step=self._step, done=self._done, state=self._state, place=where)
        return Advanced(
            position=after,
            events=tuple(self._events),
            rests=self._rests,
            beside=self._running if not outcome else {},
            begun=self._begun,
            entered=tuple(self._entered),
        )

    def _tell(self, kind: str, path: str, text: str) -> None:
        self._events.append(MissionEvent(kind=kind, place=path, text=text))

    @property
    def _stands(self) -> bool:
        """The robot stands, and no fault is to be reported to its step first; steps beside others do not move it."""
        return self._beside or (self._facts.standing and not self._position.faults)

    def _holds(self, condition: Condition) -> bool:
        return holds(condition, self._signals)

    def _run(self, node: Node, place: Place) -> tuple[Place, str]:
        """Where the node is after the tick, and how it ended; empty: it has not. An empty place: it begins."""
        match node:
            case Leaf():
                return self._leaf(node, place)
            case Steps():
                return self._steps(node, place)
            case During():
                return self._during(node, place)
            case Repeat():
                return self._repeat(node, place)
            case Try():
                return self._try(node, place)
            case Choose():
                return self._choose(node, place)
            case Together():
                return self._together(node, place)
            case End():
                return self._end(node, place)
        return self._say(node, place)

    def _say(self, node: Say, place: Place) -> tuple[Place, str]:
        self._tell("said", node.path, node.text)
        return place, DONE

    def _end(self, node: End, place: Place) -> tuple[Place, str]:
        if node.text:
            self._tell("said", node.path, node.text)
        self._tell("end", node.path, node.outcome)
        return place, f"!{node.outcome}"

    def _leaf(self, node: Leaf, place: Place) -> tuple[Place, str]:
        number, facts = node.number, self._facts
        if not place.numbers:
            self._entered.append(node.path)
            self._forgotten += node.signals
            self._present(number, 0.0, "")
            return _leaf_place(number, 0.0, ""), ""
        done, state = float(place.numbers[0]), str(*place.numbers[2:])
        if not self._beside and number != self._position.step:  # it resumes after something else
            self._present(number, done, state)
            return place, ""
        acted = facts.acted.get(number, Acted(step=number, state=state))
        if self._beside:
            done += facts.dt
        elif facts.done is not None:
            done = facts.done
        outcome = self._outcome(node, done) or (acted.outcome if self._beside else "")
        if outcome and not (outcome == DONE and self._is_list):
            self._tell("ended", node.path, outcome)
        elif not outcome and self._beside:
            self._running[number] = acted.state
        elif not outcome:
            self._step, self._done, self._state = number, done, acted.state
        return _leaf_place(number, done, acted.state), outcome

    def _present(self, number: int, done: float, state: str) -> None:
        """A step is the present one from now on, or begins beside it."""
        if self._beside:
            self._running[number] = state
        else:
            self._step, self._done, self._state, self._begun = number, done, state, True

    def _outcome(self, leaf: Leaf, done: float) -> str:
        for fault in self._position.faults if not self._beside else ():
            if any(each.names(f"{FAULT}:{fault}") for each in self._tries):
                return f"{FAULT}:{fault}"
        if (outcome := self._facts.outcome) and not self._beside and (outcome == DONE or not self._rests):
            return outcome  # of one that is to come to rest for something else only that it is done
        step = self._passive[leaf.number]
        if step is None:
            return ""
        for answer in self._facts.answers if step.answers else ():
            if given := given_answer(answer, step.answers):
                self._answer = self._signals["answer"] = given
                return DONE
        if step.seconds is not None and done >= step.seconds:
            return DONE
        if step.condition is not None and self._holds(step.condition):
            return DONE
        return TIMEOUT if step.at_most is not None and done >= step.at_most else ""

    def _steps(self, node: Steps, place: Place) -> tuple[Place, str]:
        index, inner = (int(place.numbers[0]), place.within[0]) if place.numbers else (0, Place())
        while True:
            inner, outcome = self._run(node.of[index], inner)
            if outcome != DONE:
                return Place((index,), (inner,)), outcome
            index += 1
            if index == len(node.of):
                return Place(), DONE
            inner = Place()

    def _repeat(self, node: Repeat, place: Place) -> tuple[Place, str]:
        done, inner = (int(place.numbers[0]), place.within[0]) if place.numbers else (0, Place())
        before = self._signals.get("round")
        try:
            while True:
                self._signals["round"] = float(done + 1)
                inner, outcome = self._run(node.steps, inner)
                if outcome != DONE:
                    return Place((done,), (inner,)), outcome
                done, inner = done + 1, Place()
                if (node.times is not None and done >= node.times) or (
                    node.until is not None and self._holds(node.until)
                ):
                    return Place(), DONE
                self._tell("round", node.path, f"{done + 1}" + (f" of {node.times}" if node.times else ""))
        finally:
            if before is None:
                del self._signals["round"]
            else:
                self._signals["round"] = before

    def _try(self, node: Try, place: Place) -> tuple[Place, str]:
        attempt, branch = (
            map(int, place.numbers) if place.numbers else (0, -1)
        )  # -1: its steps, 0: between, then `catch`
        inner = place.within[0] if place.within else Place()
        while branch < 0 or (branch == 0 and node.between is not None):
            if branch == 0 and node.between is not None:
                inner, outcome = self._run(node.between, inner)
                if outcome != DONE:
                    return Place((attempt, branch), (inner,)), outcome
                branch, inner = -1, Place()
            self._tries.append(node)
            inner, outcome = self._run(node.steps, inner)
            self._tries.pop()
            if outcome in ("", DONE) or outcome.startswith("!"):
                return Place((attempt, branch), (inner,)), outcome
            names, inner = node.names(outcome), Place()
            if node.tries_again(outcome) and attempt < node.retries:
                attempt, branch = attempt + 1, 0 if node.between is not None else -1
                self._tell("retry", node.path, f"{attempt} of {node.retries} after {outcome}")
                continue
            caught = [name for name, _ in node.catch]
            branch = next((1 + caught.index(name) for name in names if name in caught), -1)
            if branch < 0:
                return Place(), outcome
            self._tell("caught", node.path, outcome)
        inner, outcome = self._run(node.catch[branch - 1][1], inner)
        return Place((attempt, branch), (inner,)), outcome

    def _during(self, node: During, place: Place) -> tuple[Place, str]:
        spent, fired, *armed = place.numbers or (0.0, -1, *[1] * len(node.when))
        within = place.within or (Place(),)
        spent, fired = float(spent) + self._facts.dt, int(fired)
        now = [self._holds(watch.condition) for watch in node.when]
        armed = [armed if true else 1 for armed, true in zip(armed, now, strict=True)]
        if fired < 0 and place.numbers:
            fired = next((index for index, true in enumerate(now) if true and armed[index]), -1)
            if fired >= 0:
                armed[fired] = 0
                self._tell("fired", node.path, node.when[fired].text)
            elif node.at_most is not None and spent >= node.at_most:
                fired = len(node.when)
                self._tell("expired", node.path, f"{node.at_most:g} s")
        body, branch = within[0], within[1] if len(within) > 1 else None
        if fired >= 0:
            steps, then = (node.when[fired].steps, node.when[fired].then) if fired < len(node.when) else (None, TIMEOUT)
            if branch is None and not self._stands:
                self._rests = True
                body, outcome = self._run(node.steps, body)
                return Place((spent, fired, *armed), (body,)), outcome
            outcome = DONE
            if steps is not None:
                branch, outcome = self._run(steps, branch or Place())
            if outcome != DONE:
                return Place((spent, fired, *armed), (body, branch or Place())), outcome
            if then == DONE:  # the condition is a behaviour's own: its step ends
                self._tell("ended", node.path, DONE)
            if then not in (RESUME, RESTART):
                return Place(), then
            fired, body = -1, body if then == RESUME else Place()
        body, outcome = self._run(node.steps, body)
        return Place((spent, fired, *armed), (body,)), outcome

    def _choose(self, node: Choose, place: Place) -> tuple[Place, str]:
        index, inner = (int(place.numbers[0]), place.within[0]) if place.numbers else (-1, Place())
        if index < 0:
            index = next((i for i, (if_, _) in enumerate(node.branches) if if_ is None or self._holds(if_)), -1)
            if index < 0:
                return Place(), DONE
        inner, outcome = self._run(node.branches[index][1], inner)
        return Place((index,), (inner,)), outcome

    def _together(self, node: Together, place: Place) -> tuple[Place, str]:
        places = list(place.within) or [Place()] * (1 + len(node.beside))
        running = [int(number) for number in place.numbers[: len(node.beside)]] or [1] * len(node.beside)
        bad = str(*place.numbers[len(node.beside) :])  # how a step beside ended, while the robot comes to rest
        running_before = dict(self._running)
        before, self._beside = self._beside, True
        for index, steps in enumerate(node.beside):
            if running[index] and not bad:
                places[1 + index], outcome = self._run(steps, places[1 + index])
                running[index] = int(not outcome)
                bad = outcome if outcome != DONE else ""
        self._beside = before
        if bad and self._stands:
            self._running = running_before
            return Place(), bad
        self._rests = self._rests or bool(bad)
        places[0], outcome = self._run(node.steps, places[0])
        if outcome:
            self._running = running_before
            if bad and (bad.startswith("!") or not outcome.startswith("!")):  # it came first; but an `end` is one
                outcome = bad
        return Place((*running, *([bad] if bad else [])), tuple(places)), outcome


def told_after(position: Position, acted: Mapping[int, Acted]) -> tuple[SignalValue, ...]:
    """What is known of the behaviours' signals after a tick in which they published some."""
    known = {signal.name: signal for signal in position.told}
    for told in acted.values():
        known |= {signal.name: signal for signal in told.signals}
    return tuple(known.values())


def _leaf_place(number: int, done: float, state: str) -> Place:
    """The place in a step: how much of it is done; and of one that a behaviour does, number and state."""
    return Place((done, number, state) if state else (done,))


def states_in(position: Position) -> Iterator[tuple[int, str]]:
    """The steps that behaviours have begun at a position, by number, each with the state of its behaviour."""
    if position.state:
        yield position.step, position.state
    places = [_DECODER.decode(position.place)] if position.place else []
    while places:
        place = places.pop()
        places += place.within
        if not place.within and len(place.numbers) == 3 and isinstance(state := place.numbers[2], str):
            yield int(place.numbers[1]), state
