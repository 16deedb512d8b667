"""Whether the controls of the inputs rest: one that gives nothing is not at rest, it is waited for. Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from artemis.values import OperatorInput, Snapshot

RELEASE = "release the controls"
WAITED = 5.0
"""An input whose loss is only a warning is waited for so long [s] after it was lost: then others drive without it."""


def hands_on(inputs: Iterable[OperatorInput], lost: Collection[str] = ()) -> str | None:
    """What a person has to do before every control rests; None: nothing. Of some devices nothing is known at first.

    Of the `lost` inputs there is no sample.
    """
    held = [sample for sample in inputs if not sample.neutral]
    if not held and not lost:
        return None
    silent = [sample.source for sample in held if sample.age is None]
    told = [f"{', '.join(silent)} was not heard yet: move it once"] if silent else []
    told += [f"no reports from {', '.join(lost)}"] if lost else []
    return "; ".join([RELEASE, *told])


class OperatorHands:
    """The controls of the inputs by which a mission is driven.

    Attributes:
        released: Inputs whose controls were seen at rest when mode teleop was asked for: the others have to be released
            before they may drive.
    """

    def __init__(self, names: Iterable[str], spare: Collection[str]) -> None:
        """Of these inputs; `spare` are those whose loss is only a warning."""
        self._names, self._spare = tuple(dict.fromkeys(names)), spare
        self._lost: dict[str, float] = {}
        self.released: frozenset[str] = frozenset()

    def see(self, snapshot: Snapshot) -> None:
        """Which of them give nothing, and since when; at every tick."""
        given = {sample.source for sample in snapshot.sensed.inputs}
        self._lost = {name: self._lost.get(name, snapshot.time) for name in self._names if name not in given}

    def held(self, snapshot: Snapshot, names: Collection[str] | None = None) -> str | None:
        """What a person has to do before the controls rest, of all inputs or of those with these `names`."""
        lost = [name for name, since in self._lost.items() if self._is_awaited(name, snapshot.time - since)]
        if names is None:
            return hands_on(snapshot.sensed.inputs, lost)
        inputs = [sample for sample in snapshot.sensed.inputs if sample.source in names]
        return hands_on(inputs, [name for name in lost if name in names])

    def _is_awaited(self, name: str, lost: float) -> bool:
        """Whether an input is waited for that was `lost` so long ago [s]."""
        return name not in self._spare or lost <= WAITED
