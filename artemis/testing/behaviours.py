"""What every behaviour must do, as tests, like those in `artemis.testing.contracts`."""

from __future__ import annotations

import math
from dataclasses import dataclass

from artemis.motion.limits import is_sane
from artemis.plugins.acting import Answered, answered, state_from
from artemis.plugins.contracts import Behaviour, declared
from artemis.plugins.guard import LATE
from artemis.plugins.registry import BEHAVIOURS
from artemis.testing.contracts import BEYOND, PERIOD, TRIES, PluginContract, TrialCar, quickest
from artemis.values import DriveCommand, Pose, Snapshot


@dataclass(frozen=True, slots=True)
class TrialStep:
    """A step that a behaviour did: what it was shown, what it answered, and where the robot came to rest."""

    steps: list[tuple[Snapshot, Answered]]
    end: Pose

    @property
    def outcome(self) -> str:
        """How it ended; empty: it did not."""
        return self.steps[-1][1].outcome


class BehaviourContract(PluginContract):
    """A behaviour: inherit, set `plugin`, and `options` and `files` if it has any.

    The robot's pose is known exactly; it obeys one tick late and within the gate's limits. The condition of a key
    `until` never holds here.
    """

    group = BEHAVIOURS
    duration: float = 60.0
    """So long it is asked at most [s], of run time: nothing waits for it."""
    ends: str | None = None
    """The outcome that it has to end with in this time; None: any, or none."""

    def shown(self, snapshot: Snapshot) -> Snapshot:
        """Override: what the behaviour sees, with the devices that it needs; the same for the same snapshot."""
        return snapshot

    def done(self, behaviour: Behaviour | None = None, begin: Pose | None = None) -> TrialStep:
        """A step, from its start to its outcome; `begin`: where the robot stands first."""
        car = TrialCar(self.robot, begin or Pose())
        behaviour = behaviour or self.make()
        behaviour.start(self.shown(car.snapshot()))
        steps: list[tuple[Snapshot, Answered]] = []
        while len(steps) * PERIOD < self.duration:
            snapshot = self.shown(car.snapshot())
            answer = self._answer(behaviour, snapshot)
            steps.append((snapshot, answer))
            if answer.outcome:
                break
            car.obey(answer.command or DriveCommand(steering=snapshot.set_points.steering))
        while not car.stands:
            car.obey(DriveCommand(steering=car.snapshot().set_points.steering))
        return TrialStep(steps, car.pose)

    def test_answers_are_whole(self) -> None:
        """Each is an Acting with the right types in it; outcomes and signals are declared, the state is small."""
        self.done()

    def test_ends(self) -> None:
        """With the outcome `ends`, where the test names one."""
        found = self.done()
        if self.ends is not None:
            after = len(found.steps) * PERIOD
            assert found.outcome == self.ends, f"after {after:.0f} s its outcome is {found.outcome or 'none'!r}"

    def test_commands_are_possible(self) -> None:
        """They are numbers, and within the robot's limits: the gate would hold them back, and warn."""
        limits = self.robot.limits
        for _, answer in self.done().steps:
            if (command := answer.command) is None:
                continue
            assert is_sane(command), f"not finite: {command} (RUN-11)"
            assert abs(command.speed) <= BEYOND * limits.speed_m_s, f"faster than the robot: {command} (RUN-12)"
            assert abs(command.steering) <= BEYOND * math.radians(limits.steering_deg), (
                f"steered further than the robot can: {command} (RUN-12)"
            )

    def test_same_snapshots_give_same_answers(self) -> None:
        """Nothing but the snapshots counts: a run must replay."""
        self._assert_repeats(self.done(), self.make(), "a second behaviour")

    def test_start_begins_anew(self) -> None:
        """The same behaviour, started again, knows nothing of the first time."""
        behaviour: Behaviour = self.make()
        self._assert_repeats(self.done(behaviour), behaviour, "the same behaviour, started again,")

    def test_resumes_from_its_state(self) -> None:
        """One that is resumable resumes anywhere as if nothing had happened, from what it returned last."""
        if not declared(self.plugin).resumable:
            return
        steps = self.done().steps
        for stop in {1, len(steps) // 3, 2 * len(steps) // 3} - {0}:
            other: Behaviour = self.make()
            other.start(steps[stop][0], state_from(steps[stop - 1][1].state))
            for snapshot, first in steps[stop:]:
                again = self._answer(other, snapshot)
                assert again == first, (
                    f"step() at {snapshot.time:.2f} s gave {first}; one that resumed from the state "
                    f"{steps[stop - 1][1].state} gave {again}"
                )

    def test_step_does_not_wait(self) -> None:
        """It runs inside the tick."""
        behaviour: Behaviour = self.make()
        snapshots = [snapshot for snapshot, _ in self.done(behaviour).steps]
        behaviour.start(snapshots[0])
        took = quickest(behaviour.step, snapshots[:TRIES])
        assert took <= LATE, f"step() takes {took * 1000:.0f} ms, {LATE * 1000:.0f} are allowed (PLG-03)"

    def _answer(self, behaviour: Behaviour, snapshot: Snapshot) -> Answered:
        given = behaviour.step(snapshot)
        answer = answered(given, declared(self.plugin))
        assert not isinstance(answer, str), f"step() gave {given!r}: {answer} (PLG-06)"
        return answer

    def _assert_repeats(self, done: TrialStep, behaviour: Behaviour, who: str) -> None:
        behaviour.start(done.steps[0][0])
        for snapshot, first in done.steps:
            again = self._answer(behaviour, snapshot)
            assert again == first, f"step() at {snapshot.time:.2f} s gave {first}; {who} gave {again}"
