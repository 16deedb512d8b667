"""Robot modes and what changes them: the table, and the machine that runs it. Only file importing transitions."""

from __future__ import annotations

from transitions import Machine

from artemis.values import Event, Mode

STEP_MODES = (Mode.CALIBRATE, Mode.TELEOP, Mode.FOLLOW, Mode.ACT)
"""In which a step of the mission is done."""

TRANSITIONS: dict[tuple[Mode, Event], Mode] = {
    (Mode.INIT, Event.ALIGNED): Mode.READY,
    (Mode.READY, Event.CALIBRATE): Mode.CALIBRATE,
    (Mode.READY, Event.TELEOP): Mode.TELEOP,
    (Mode.READY, Event.FOLLOW): Mode.FOLLOW,
    (Mode.READY, Event.ACT): Mode.ACT,
    **{(mode, Event.DONE): Mode.READY for mode in STEP_MODES},
    **{(mode, Event.STOP): Mode.QUICKSTOP for mode in (Mode.INIT, Mode.READY, *STEP_MODES)},
    **{(mode, Event.FAULT): Mode.FAULT for mode in (Mode.INIT, Mode.READY, Mode.QUICKSTOP, *STEP_MODES)},
    (Mode.QUICKSTOP, Event.STOP): Mode.QUICKSTOP,  # asked for again: begins anew, and drops a re-arm under way
    (Mode.QUICKSTOP, Event.REARMED): Mode.READY,
    (Mode.QUICKSTOP, Event.ACKNOWLEDGED): Mode.INIT,  # stopped before the wheels were aligned: bring up again
    (Mode.FAULT, Event.ACKNOWLEDGED): Mode.INIT,
    **{(mode, Event.END): Mode.END for mode in Mode if mode is not Mode.END},
}
"""(mode, event) -> next mode. A pair that is not here is refused: the mode stays."""


class _Model:
    """Carries the state for `transitions`, which writes `state` and the triggers into it."""

    state: Mode


class ModeMachine:
    """The robot's mode. Changes only by `fire`, only along the table."""

    def __init__(self) -> None:
        self._model = _Model()
        self._machine = Machine(
            model=self._model,
            states=Mode,
            initial=Mode.INIT,
            transitions=[
                {"trigger": event.name.lower(), "source": mode, "dest": target}
                for (mode, event), target in TRANSITIONS.items()
            ],
            auto_transitions=False,
        )

    @property
    def mode(self) -> Mode:
        """The present mode."""
        return self._model.state

    def fire(self, event: Event) -> bool:
        """Change the mode as the table says; False where the present mode does not expect `event`."""
        if (self.mode, event) not in TRANSITIONS:  # `transitions` would log a warning, at every tick
            return False
        return bool(self._machine.dispatch(event.name.lower()))


def mermaid() -> str:
    """The table as a Mermaid state diagram."""
    arrows: dict[tuple[Mode, Mode], list[str]] = {}
    for (source, event), target in TRANSITIONS.items():
        arrows.setdefault((source, target), []).append(event.value)
    return "\n".join(
        [
            "stateDiagram-v2",
            *(f'    state "{mode.value}" as {mode.name}' for mode in Mode),  # `end` is a word of Mermaid's own
            "    [*] --> INIT",
            *(f"    {source.name} --> {target.name}: {', '.join(names)}" for (source, target), names in arrows.items()),
            "    END --> [*]",
        ]
    )
