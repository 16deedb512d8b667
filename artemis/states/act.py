"""Mode act: a behaviour plugin does the present step; and behaviours that observe beside the step."""

from __future__ import annotations

from msgspec.structs import replace

from artemis.drive_states import Goal
from artemis.plugins.acting import Answered, answered, state_from
from artemis.plugins.guard import PLUGIN_ERRORS, told
from artemis.progress import DONE, Acted
from artemis.states.follow import place_fault
from artemis.states.mode import stand
from artemis.states.plan import BehaviourStep, Shared
from artemis.supervision import catalogue
from artemis.values import Event, Fault, Snapshot, Wish


def ask(step: BehaviourStep, snapshot: Snapshot, state: str, *, start: bool) -> Answered | Fault:
    """The answer of a step's behaviour, which is started first where that is wanted; or what it did instead."""
    doing = "start: "
    try:
        if start:
            step.behaviour.start(snapshot, state_from(state))
        doing = ""
        answer = step.behaviour.step(snapshot)
        found = answered(answer, step.declared)
    except PLUGIN_ERRORS as error:
        return catalogue.fault("PLG-02", step.name, f"{doing}{told(error)}")
    return catalogue.fault("PLG-06", step.name, f"{found}: {told(answer)}") if isinstance(found, str) else found


def _acted(number: int, answer: Answered, outcome: str = "") -> Acted:
    return Acted(step=number, outcome=outcome, state=answer.state, signals=answer.signals)


class ActMode:
    """Asks the behaviour at each tick. One that has ended, or is to come to rest, is not asked any more."""

    def __init__(self, shared: Shared) -> None:
        self.shared = shared
        self._entry: int | None = None
        self._outcome = ""

    def enter(self, snapshot: Snapshot) -> None:
        """A step begins, or resumes after it was interrupted: then its behaviour is not started again."""

    def step(self, snapshot: Snapshot) -> Wish:
        """The behaviour's command; its outcome once it has ended and the robot stands."""
        shared, step = self.shared, self.shared.current
        if not isinstance(step, BehaviourStep):
            return stand(snapshot, event=Event.DONE)
        if self._entry != shared.entry:
            self._outcome = ""
        if self._outcome:
            return self._end(snapshot)
        if shared.rests:
            return _stop(snapshot, Event.DONE if snapshot.standing else None)
        if step.declared.moves and (misplaced := place_fault(snapshot, localized=shared.plan.localized)):
            return stand(snapshot, fault=misplaced)
        position = shared.position
        answer = ask(step, snapshot, position.state, start=self._entry != shared.entry)
        if isinstance(answer, Fault):
            return stand(snapshot, fault=answer)
        self._entry, self._outcome = shared.entry, answer.outcome
        wish = self._end(snapshot) if answer.outcome else stand(snapshot)
        if answer.command is not None and not answer.outcome:
            wish = Wish(command=answer.command, traction=Goal.ENABLED, steering=Goal.ENABLED)
        acted, done = _acted(position.step, answer), position.done + snapshot.dt
        phase = wish.phase if answer.outcome else answer.phase or step.name
        return replace(wish, acted=(acted,), done=done, phase=phase)

    def _end(self, snapshot: Snapshot) -> Wish:
        """Come to rest; standing, the step is over."""
        if not snapshot.standing:
            return _stop(snapshot)
        over = self._outcome == DONE
        return replace(_stop(snapshot, Event.DONE), over=over, outcome="" if over else self._outcome)


def _stop(snapshot: Snapshot, event: Event | None = None) -> Wish:
    return replace(stand(snapshot, event=event), phase="stopping")


class Observing:
    """Behaviours that observe beside the present step: asked at each tick in which the mission runs."""

    def __init__(self, shared: Shared) -> None:
        self._shared = shared
        self._started: set[int] = set()

    def ask(self, snapshot: Snapshot, wish: Wish) -> Wish:
        """The mode's wish, with what they reported; or with the first fault of theirs, if it has none."""
        running, steps = self._shared.beside, self._shared.plan.steps
        self._started &= running.keys()
        for number, state in running.items():
            step = steps[number]
            if not isinstance(step, BehaviourStep):
                continue
            answer = ask(step, snapshot, state, start=not state or number not in self._started)
            if isinstance(answer, Fault):
                wish = replace(wish, fault=wish.fault or answer)
                continue
            self._started.add(number)
            wish = replace(wish, acted=(*wish.acted, _acted(number, answer, answer.outcome)))
        return wish
