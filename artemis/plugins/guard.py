"""The guard around foreign code: plugins are asked here, and whatever they do instead of an answer becomes a fault.

The Python exceptions of a plugin are all caught here, each becomes a fault with its text; so is its wish to end the
program. An answer goes on as plain values: numbers are floats, whatever the plugin computes with.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Set
from os.path import basename
from traceback import walk_tb
from typing import ClassVar

from msgspec.structs import replace

from artemis.config import Config
from artemis.errors import DeviceLost
from artemis.motion.path import Path
from artemis.plugins.answers import is_in_range, is_whole_input, plain_input
from artemis.plugins.contracts import (
    Acting,
    Behaviour,
    Follower,
    Following,
    InputDevice,
    Localizer,
    SeesTicks,
    ShowsState,
    State,
    TakesInitialPose,
    TellsProblems,
)
from artemis.plugins.fixes import plain_fixes
from artemis.plugins.process import AskedPlugin
from artemis.values import LocatedPose, OperatorInput, PoseFix, Request, Snapshot, Tick

LATE = 0.015
"""A plugin has this long for an answer [s]."""
MISSES = 3
"""As many late answers in a row are a fault."""
BAD_SAMPLES, BAD_TIME = 5, 1.0
"""As many samples out of range within this time [s] are a fault."""
LOST, OUT_OF_RANGE, NOT_SHOWN = "INP-01", "INP-06", "INP-16"
RAISED, LATE_INPUT, GARBAGE, LATE_FOLLOWER = "PLG-02", "PLG-03", "PLG-06", "PTH-09"
IMPOSSIBLE, SLOW = "LOC-04", "LOC-06"
LONGEST = 200
"""Of a text of a plugin [characters]."""
NETWORK = frozenset(f"NET-{number:02}" for number in range(1, 16))
OF_LOCALIZER = frozenset(["LOC-07"])
"""What an input, and a localizer, may say of itself."""

LOCALIZER, FOLLOWER = "localizer", "follower"
"""Their names in faults."""

PLUGIN_ERRORS = (BaseException,)
"""What a plugin raises is only its own fault, also what is derived of BaseException alone: a cancelled future, the
panic of a library. While a run asks it a signal raises nothing (`Attendance`)."""

_HERE = "artemis/plugins/guard.py"

Problem = tuple[str, str, str]
"""Row of the fault table, plugin, what was seen."""


class PluginGuard:
    """Asks the inputs and the localizer of a run, and measures how long each plugin takes."""

    def __init__(
        self,
        inputs: Mapping[str, InputDevice],
        clock: Callable[[], float],
        localizer: Localizer | None = None,
        asked: AskedPlugin | None = None,
    ) -> None:
        """`clock` measures the plugins [s]; `asked` is told which one is asked."""
        self.inputs, self._clock, self._localizer = inputs, clock, localizer
        self._asked = asked or AskedPlugin()
        self._showing = {name: device for name, device in inputs.items() if isinstance(device, ShowsState)}
        self._telling = {name: device for name, device in inputs.items() if isinstance(device, TellsProblems)}
        self._last: dict[str, tuple[float, OperatorInput]] = {}
        self._late: dict[tuple[str, str], int] = {}
        self._bad: dict[str, list[float]] = {}
        self._problems: list[Problem] = []
        self._seeing = localizer if isinstance(localizer, SeesTicks) else None
        self._localizer_tells = localizer if isinstance(localizer, TellsProblems) else None
        self._impossible = 0
        """Fixes in a row that cannot be true."""
        self._behaviours = 0

    def read(self, now: float) -> tuple[OperatorInput, ...]:
        """The newest sample of each input at run time `now` [s]; those that gave none, or garbage, are missing."""
        samples = tuple(sample for name in self.inputs if (sample := self._ask(name, now)) is not None)
        for sample in samples:
            if sample.initial_pose is not None:
                self._begin_at(sample.initial_pose)
        return samples

    def fixes(self, now: float) -> tuple[PoseFix, ...]:
        """What the localizer found since the last call, at run time `now` [s]; nothing if it gave garbage."""
        if self._localizer is None:
            return ()
        begun = self._clock()
        self._asked.begin(LOCALIZER)
        try:
            found = self._localizer.fixes(now)
        except DeviceLost:  # how old the newest fix is tells
            return ()
        except PLUGIN_ERRORS as error:
            self._problems.append((RAISED, LOCALIZER, told(error)))
            return ()
        finally:
            self._asked.end()
        self._judge_time(LATE_INPUT, LOCALIZER, self._clock() - begun)
        if self._localizer_tells is not None:
            self._problems += _told_of_itself(self._localizer_tells, LOCALIZER, OF_LOCALIZER)
        if (fixes := plain_fixes(found)) is None:
            self._problems.append((GARBAGE, LOCALIZER, told(found)))
            return ()
        for number, fix in enumerate(fixes):
            self._impossible = 0 if fix is not None else self._impossible + 1
            if self._impossible >= MISSES:
                self._problems.append((IMPOSSIBLE, LOCALIZER, told(found[number])))
        return tuple(fix for fix in fixes if fix is not None)

    def _begin_at(self, initial: LocatedPose) -> None:
        """Tell the localizer about where the robot is; one that cannot use it is not told."""
        if not isinstance(self._localizer, TakesInitialPose):
            return
        self._asked.begin(LOCALIZER)
        try:
            self._localizer.begin_at(initial)
        except PLUGIN_ERRORS as error:
            self._problems.append((RAISED, LOCALIZER, told(error)))
        finally:
            self._asked.end()

    def _let_see(self, localizer: SeesTicks, tick: Tick) -> None:
        """Hand the tick to a localizer that finds the robot by what it senses."""
        begun = self._clock()
        self._asked.begin(LOCALIZER)
        try:
            problem = localizer.see(tick)
        except PLUGIN_ERRORS as error:
            self._problems.append((RAISED, LOCALIZER, told(error)))
            return
        finally:
            self._asked.end()
        self._judge_time(LATE_INPUT, LOCALIZER, self._clock() - begun, "localizer sees")
        if not isinstance(problem, str):
            self._problems.append((GARBAGE, LOCALIZER, told(problem)))
        elif problem:
            self._problems.append((SLOW, LOCALIZER, one_line(problem)))

    def show(self, tick: Tick) -> None:
        """Have every input show what the tick did, and the localizer see it; an input that fails is not asked again."""
        if self._seeing is not None:
            self._let_see(self._seeing, tick)
        for name, device in list(self._showing.items()):
            begun = self._clock()
            self._asked.begin(name)
            try:
                problem = device.show(tick)
                fails = not isinstance(problem, str)
            except PLUGIN_ERRORS as error:
                problem, fails = told(error), True
            finally:
                self._asked.end()
            place, took = (NOT_SHOWN, name), self._clock() - begun
            self._late[place] = self._late.get(place, 0) + 1 if took > LATE else 0
            if self._late[place] >= MISSES:
                problem, fails = f"showing takes it {took * 1000:.0f} ms", True
            if fails:
                del self._showing[name]
            if fails or problem:
                self._problems.append(
                    (NOT_SHOWN, name, one_line(problem) if isinstance(problem, str) else told(problem))
                )

    def take_problems(self) -> list[Problem]:
        """What plugins did wrong since the last call."""
        problems, self._problems = self._problems, []
        return problems

    def watched(self, follower: Follower) -> Follower:
        """The follower, its time measured."""
        return _WatchedFollower(follower, self._clock, self._judge_time, self._asked)

    def watched_behaviour(self, name: str, behaviour: Behaviour) -> Behaviour:
        """The behaviour of that name, its time measured."""
        self._behaviours += 1
        key = f"{name} {self._behaviours}"  # several steps may be of one behaviour, and an input have its name

        def judge(took: float) -> None:
            self._judge_time(LATE_INPUT, name, took, key)

        return _WatchedBehaviour(name, behaviour, self._clock, judge, self._asked)

    def close(self) -> list[Problem]:
        """Give every device back, whatever the others do; what they did wrong."""
        devices: dict[str, InputDevice | Localizer] = {**self.inputs}
        if self._localizer is not None:
            devices[LOCALIZER] = self._localizer
        problems = []
        for name, device in devices.items():
            self._asked.begin(name)
            try:
                device.close()
            except PLUGIN_ERRORS as error:
                problems.append((RAISED, name, told(error)))
            finally:
                self._asked.end()
        return problems

    def _ask(self, name: str, now: float) -> OperatorInput | None:
        begun = self._clock()
        self._asked.begin(name)
        try:
            sample = self.inputs[name].read(now)
        except DeviceLost as error:
            self._problems.append((LOST, name, one_line(error.problem)))
            return None
        except PLUGIN_ERRORS as error:
            self._problems.append((RAISED, name, told(error)))
            return None
        finally:
            self._asked.end()
        self._judge_time(LATE_INPUT, name, self._clock() - begun)
        if name in self._telling:
            self._problems += _told_of_itself(self._telling[name], name, NETWORK)
        if not is_whole_input(sample):
            self._problems.append((GARBAGE, name, told(sample)))
            return None
        if sample.source != name:
            self._problems.append((GARBAGE, name, f"source {told(sample.source):.70}: write context.name there"))
            return None
        if not is_in_range(sample):
            return self._instead_of(sample, name, now)
        sample = plain_input(sample)
        self._last[name] = now, sample
        return sample

    def _instead_of(self, sample: OperatorInput, name: str, now: float) -> OperatorInput:
        """The last good sample, grown older; too many bad ones are a fault. A stop is obeyed whatever comes with it."""
        bad = self._bad[name] = [time for time in self._bad.get(name, []) if time > now - BAD_TIME] + [now]
        if len(bad) >= BAD_SAMPLES:
            self._problems.append((OUT_OF_RANGE, name, told(sample)))
        stops = (Request.QUICKSTOP,) if Request.QUICKSTOP in sample.requests else ()
        then, last = self._last.get(name, (now, OperatorInput(source=name)))
        return replace(last, requests=stops, age=None if last.age is None else last.age + now - then)

    def _judge_time(self, id: str, name: str, took: float, key: str = "") -> None:
        place = id, key or name
        late = self._late[place] = self._late.get(place, 0) + 1 if took > LATE else 0
        if late >= MISSES:
            self._problems.append((id, name, f"{took * 1000:.0f} ms, {late} times in a row"))


class _WatchedFollower:
    """A follower whose answers are timed."""

    Config: ClassVar[type[Config]] = Config

    def __init__(
        self,
        follower: Follower,
        clock: Callable[[], float],
        judge: Callable[[str, str, float], None],
        asked: AskedPlugin,
    ) -> None:
        self._follower, self._clock, self._judge, self._asked = follower, clock, judge, asked

    def start(self, path: Path, snapshot: Snapshot) -> None:
        self._asked.begin(FOLLOWER)
        try:
            self._follower.start(path, snapshot)
        finally:
            self._asked.end()

    def step(self, snapshot: Snapshot) -> Following:
        begun = self._clock()
        self._asked.begin(FOLLOWER)
        try:
            return self._follower.step(snapshot)
        finally:
            self._asked.end()
            self._judge(LATE_FOLLOWER, FOLLOWER, self._clock() - begun)


class _WatchedBehaviour:
    """A behaviour whose answers are timed."""

    Config: ClassVar[type[Config]] = Config

    def __init__(
        self,
        name: str,
        behaviour: Behaviour,
        clock: Callable[[], float],
        judge: Callable[[float], None],
        asked: AskedPlugin,
    ) -> None:
        self._name, self._behaviour, self._clock, self._judge, self._asked = name, behaviour, clock, judge, asked

    def start(self, snapshot: Snapshot, state: State | None = None) -> None:
        self._asked.begin(self._name)
        try:
            self._behaviour.start(snapshot, state)
        finally:
            self._asked.end()

    def step(self, snapshot: Snapshot) -> Acting:
        begun = self._clock()
        self._asked.begin(self._name)
        try:
            return self._behaviour.step(snapshot)
        finally:
            self._asked.end()
            self._judge(self._clock() - begun)


def _told_of_itself(device: TellsProblems, name: str, rows: Set[str]) -> list[Problem]:
    """What an input or a localizer says is wrong with it, by one of these rows."""
    try:
        found = [(row, one_line(str(seen))) for row, seen in device.take_problems()]
    except PLUGIN_ERRORS as error:
        return [(RAISED, name, told(error))]
    return [(row, name, seen) if row in rows else (GARBAGE, name, told(row)) for row, seen in found]


def told(value: object) -> str:
    """How a value or an error of foreign code looks, for people: short, whatever its own `repr` does.

    Of an error also where it was raised, and the line that called that.
    """
    try:
        text = repr(value)[:LONGEST]
    except Exception:  # noqa: BLE001
        text = f"a {type(value).__name__} that cannot be shown"
    if not isinstance(value, BaseException):
        return text
    calls = [(frame.f_code.co_filename, line) for frame, line in walk_tb(value.__traceback__)][
        1:
    ]  # first: of the plugin
    places = [f"{basename(file)}:{line}" for file, line in calls[-2:] if not file.endswith(_HERE)]
    return f"{text} at {', called at '.join(reversed(places))}" if places else text


def one_line(text: str) -> str:
    """A text of foreign code: short, and without signs that move a terminal's cursor."""
    if not text.isprintable():
        text = "".join(sign if sign.isprintable() else sign.encode("unicode_escape").decode() for sign in text)
    return text[:LONGEST]
