"""`artemis calibrate gains --auto`: finds the gains to try, tries them several times both ways, and compares."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import radians, tau
from pathlib import Path

import numpy as np

from artemis.commands.calibrate_gains import FAILED, Wanted, announced, attempt, decide, say, trial_from
from artemis.commands.gains_trial import Findings, Trial
from artemis.commands.terminal import confirmed
from artemis.devices.epos_objects import Units
from artemis.errors import CalibrationError, ConfigError
from artemis.mission.actions import NewGains
from artemis.mission.gains import MOST
from artemis.mission.loading import load_mission
from artemis.motion.gain_tuning import (
    ControlLoop,
    MovedLoad,
    Proposal,
    StepRecord,
    followed,
    identified,
    in_order,
    loop_of,
    obstacle,
    proposals,
)
from artemis.motion.step_response import SWING, StepResponse, compared, quickness, reversals, slope
from artemis.planning import check_drivable, is_simulated
from artemis.recording.mcap_reader import Recording
from artemis.report.drawing import check_figures
from artemis.report.responses import REST, Trace, read_traces
from artemis.vehicle import RobotFile

REPETITIONS = 3
WORTH = 0.6
"""Gains that settle within so many times the time are what this is for; of others it is told why not."""
VOLTAGE_SHARE = 0.9
"""Of the no-load speed: what the drives' highest output voltage allows (EPOS hardware reference, 6.1)."""


def calibrate_auto(mission: Path, wanted: Wanted) -> int:
    """Identify what drives move, propose gains, try them, and keep them if they are better. Returns the exit status.

    Raises:
        ConfigError: the mission is refused, or the options are wrong; nothing has moved.
        DeviceError: the bus cannot be opened; nothing has moved.
        RecordingError: the run's folder cannot be made; nothing has moved.
    """
    if wanted.gains or wanted.tried:
        raise ConfigError("calibrate gains: --auto finds the gains itself: no others, and no --try")
    check_figures("calibrate gains")
    loaded = load_mission(mission)
    simulated = is_simulated(loaded, wanted.simulate)
    check_drivable(loaded, mission, simulated)
    trial = trial_from(loaded, wanted)
    asks = not (simulated or wanted.yes)
    if asks and not confirmed("calibrate gains", f"{announced(trial)}: go?"):
        say("nothing was moved")
        return FAILED
    status, _, outcome = attempt(loaded, mission, trial, wanted.simulate)
    if status:
        return status
    machine = Identified(loaded.robot, trial)
    try:
        machine.identify(answers(Recording(outcome.run.path), trial)["now"])
    except CalibrationError as error:
        say(f"proposed    nothing: {error}")
        return FAILED
    for line in machine.lines():
        say(line)
    tried: list[tuple[Trial, Findings]] = []

    def measured(proposal: Proposal) -> dict[str, list[Answer]]:
        new = NewGains.model_validate({machine.kind: machine.told(proposal)})
        again = replace(trial, new=new, repetitions=REPETITIONS)
        say(f"proposed    {machine.words(proposal)}")
        if asks and not confirmed("calibrate gains", f"{announced(again)}, {REPETITIONS} times each: go?"):
            say("kept        nothing: the new gains were not tried")
            raise _Ended(FAILED)
        status, found, outcome = attempt(loaded, mission, again, wanted.simulate, machine.predicted(proposal))
        if status or found is None:
            raise _Ended(status)
        tried.append((again, found))
        return answers(Recording(outcome.run.path), again)

    try:
        better = machine.best(measured)
    except _Ended as ended:
        return ended.status
    except CalibrationError as error:
        say(f"kept        nothing: {error}")
        return FAILED
    if better is None or simulated:
        said = machine.reason if better is None else "simulated drives do not know what gains do to a machine"
        say(f"kept        nothing: {said}")
        return 0
    return decide(loaded, *tried[-1], wanted.yes)


class _Ended(Exception):
    """A trial ended the command."""

    def __init__(self, status: int) -> None:
        super().__init__()
        self.status = status


# ---------------------------------------------------------------------------------------------- what was measured


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """One drive, one way."""

    trace: Trace
    response: StepResponse

    @property
    def swings(self) -> int:
        """How often the error turned back after the set-point was there."""
        time = self.trace.time - self.response.begin
        rest = (time >= self.response.ramp) & (time <= self.response.watched)
        return reversals((self.trace.set_point - self.trace.value)[rest], SWING * abs(self.response.step))


def answers(recording: Recording, trial: Trial) -> dict[str, list[Answer]]:
    """Every repetition, both ways, of all drives, by gains.

    Raises:
        CalibrationError: a step was not seen whole.
        RecordingError: the recording is not understood.
    """
    tests = trial.tests
    found = read_traces(recording, trial.drives, [step for steps in tests.values() for step in steps])
    return {
        label: [
            Answer(trace=part, response=part.response())
            for step in steps
            for drive in trial.drives
            if (drive, step) in found
            for part in ways(found[drive, step])
        ]
        for label, steps in tests.items()
    }


def ways(trace: Trace) -> Iterator[Trace]:
    """A step, and the step back where the same trace has it; a path has a trace of its own for each."""
    if trace.unit != "deg":
        yield trace
        return
    away = np.abs(trace.set_point - trace.set_point[0])
    back = int(np.flatnonzero(away >= np.max(away) - 1e-9)[-1])
    for kept in slice(0, back + 1), slice(max(0, back - REST), None):
        yield replace(
            trace,
            time=trace.time[kept],
            set_point=trace.set_point[kept],
            value=trace.value[kept],
            current=trace.current[kept],
            position=trace.position[kept],
        )


# ---------------------------------------------------------------------------------------------- what follows from it


class Identified:
    """What the drives of a trial move, and the gains that suit it."""

    def __init__(self, robot: RobotFile, trial: Trial) -> None:
        """Nothing is identified yet."""
        self.kind = "position" if trial.role == "steering" else "velocity"
        self.reason = ""
        """Why there are no proposals, or none that is better."""
        self._robot, self._trial = robot, trial
        self._family = robot.drives[trial.drives[0]].tables
        scale = self._family.gain_scale
        assert scale is not None  # the trial was checked, and all of its drives have it
        self._scale = scale
        self._present: dict[str, ControlLoop] = {}
        self._loads: dict[str, MovedLoad] = {}
        self._first: dict[str, Trace] = {}
        self._most = tuple(
            min(scale.largest, *(MOST * self._gains(name)[index] or scale.largest for name in trial.drives))
            for index in range(len(self._gains(trial.drives[0])))
        )

    def _gains(self, name: str) -> tuple[int, ...]:
        return self._robot.drives[name].gain_numbers[self.place]

    def _observed(self) -> list[str]:
        """Drives of the trial whose velocity regulator has an observer."""
        known = {name: self._robot.drives[name].si_gains for name in self._trial.drives}
        return [name for name, gains in known.items() if gains is not None and gains.observer]

    @property
    def place(self) -> slice:
        """Where these gains are among all of a drive."""
        return slice(4, 7) if self.kind == "position" else slice(2, 4)

    def told(self, proposal: Proposal) -> tuple[float, ...]:
        """Its gains as the robot file has them."""
        return self._family.told_gains(proposal.gains, self.place.start)

    def words(self, proposal: Proposal) -> str:
        """A proposal for people."""
        return (
            f"{self.kind} {','.join(map(str, self.told(proposal)))}: phase margin {proposal.phase_margin:.0f} degrees, "
            f"gain margin {proposal.gain_margin:.1f} (at half of the inertia, too); "
            f"predicted to settle within 5 % after {proposal.settled:.3f} s"
        )

    def _per_unit(self, name: str) -> float:
        """Radians of the motor per metre or radian of the wheel."""
        drive = self._robot.drives[name]
        return abs(Units(self._robot, drive).counts) * tau / drive.sensor.counts_per_turn

    def identify(self, measured: Sequence[Answer]) -> None:
        """Fit a load to what each drive did.

        Raises:
            CalibrationError: a drive followed as no such load does.
        """
        for name in self._trial.drives:
            traces = [each.trace for each in measured if each.trace.drive == name]
            motor = self._robot.drives[name].motor
            top = VOLTAGE_SHARE * motor.max_speed_rpm * tau / 60.0
            self._present[name] = loop_of(self._gains(name), self._scale, 1e-3 * motor.output_current_ma, top)
            self._first[name] = traces[0]
            try:
                # the first alone surely begins at rest: a loop that swings still does when it goes back
                self._loads[name] = identified([self._record(traces[0])], self._present[name])
            except CalibrationError as error:
                raise CalibrationError(f"{name}: {error}") from error

    def _record(self, trace: Trace) -> StepRecord:
        per_unit = self._per_unit(trace.drive)
        told = per_unit * (trace.set_point * radians(1.0) if trace.unit == "deg" else trace.set_point)
        current = -trace.current if self._robot.drives[trace.drive].mirrored else trace.current  # it is the motor's
        return StepRecord(time=trace.time, told=told, position=per_unit * trace.position, current=current)

    def _expected(self, name: str, load: MovedLoad, loop: ControlLoop) -> Trace:
        """The first trace of a drive, as the model has it with other gains."""
        trace, per_unit = self._first[name], self._per_unit(name)
        record = self._record(trace)
        position, current = followed(load, loop, record.time, record.told - record.told[0])
        position = position / per_unit + trace.position[0]
        if trace.unit == "deg":
            value = position / radians(1.0)
        else:
            value = slope(trace.time, position, trace.width)
        current = -current if self._robot.drives[name].mirrored else current
        return replace(trace, value=value, position=position, current=current)

    def lines(self) -> Iterator[str]:
        """What was identified, for people."""
        for name, load in self._loads.items():
            per_unit = self._per_unit(name)
            unit = "A s²/rad" if self.kind == "position" else "A s²/m"
            yield (
                f"{name:<16}inertia {load.inertia * per_unit:.3g} {unit}, friction {load.friction:.2f} A, "
                f"dead time {1e3 * load.delay:.1f} ms; {load.unexplained:.0%} of the lag unexplained"
            )
        if self.kind == "velocity" and (observed := self._observed()):
            names = ", ".join(observed)
            yield f"            {names}: computed as a plain PI loop, without the observer (si_gains.observer)"
        yield "            the current regulator is too fast to be identified from one sample a tick: it stays as it is"

    def proposals(self) -> list[Proposal]:
        """Gains to try, in that order."""
        names = list(self._loads)
        by_load = {id(load): name for name, load in self._loads.items()}

        def settled(load: MovedLoad, loop: ControlLoop) -> float | None:
            return quickness(self._expected(by_load[id(load)], load, loop).response())

        found = proposals(
            [self._loads[name] for name in names], self._most, self._scale, self._present[names[0]], settled
        )
        present = [self._first[name].response() for name in names]
        order = in_order(found, [each.settled_5 for each in present])
        if not found:
            self.reason = "no gains within the limits of a trial have the margins, and settle"
        elif not order:
            best, now = min(each.settled for each in found), max(each.settled_5 or 0.0 for each in present)
            self.reason = f"no gains are predicted to settle sooner than now, {now:.3f} s (the best: {best:.3f} s); "
            self.reason += self.obstacle(present)
        return order

    def best(self, measured: Callable[[Proposal], Mapping[str, Sequence[Answer]]]) -> Proposal | None:
        """The first proposal that is better where it was tried, beside the present gains; None: `reason` says why.

        `measured` tries one, and gives the answers by gains, `now` and `new`.
        """
        for proposal in self.proposals():
            self.compare(measured(proposal))
            if not self.reason:
                return proposal
        return None

    def obstacle(self, responses: Sequence[StepResponse]) -> str:
        """Why they do not settle sooner."""
        slowest = max(responses, key=lambda each: each.settled_5 or 0.0)
        return obstacle(slowest, slowest.settled_5 or 0.0, min(loop.limit for loop in self._present.values()))

    def compare(self, measured: Mapping[str, Sequence[Answer]]) -> None:
        """Tell what several repetitions showed, and why the new gains are not kept, if so."""
        for label, each in measured.items():
            times = [answer.response.settled_5 for answer in each]
            settled = [time for time in times if time is not None]
            missing = f", {len(times) - len(settled)} not settled" if len(settled) < len(times) else ""
            span = f"{min(settled):.3f} to {max(settled):.3f} s" if settled else "-"
            turns = max(answer.swings for answer in each)
            say(f"{label:<12}{len(times)} responses: settled within 5 % after {span}{missing}; {turns} swings at most")
        now, new = ([answer.response for answer in measured[label]] for label in ("now", "new"))
        self.reason = compared(now, new, [answer.swings for answer in measured["new"]])
        if self.reason:
            say(f"not better  {self.reason}")
            return
        before = [each.settled_5 for each in now if each.settled_5 is not None]
        if len(before) < len(now):
            say("better      the present gains did not settle each time")
            return
        share = max(each.settled_5 or 0.0 for each in new) / min(before)
        say(f"better      settles in {share:.0%} of the time" + f"; not less: {self.obstacle(new)}" * (share > WORTH))

    def predicted(self, proposal: Proposal) -> Findings:
        """What the model says of gains, as a trial would show it."""
        traces = []
        for name, load in self._loads.items():
            present = self._present[name]
            traces.append(self._expected(name, load, loop_of(proposal.gains, self._scale, present.limit, present.top)))
        return Findings(traces={"predicted": traces}, responses={"predicted": [trace.response() for trace in traces]})
