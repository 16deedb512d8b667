"""The independent monitor: judges a run by its frames, the true vehicle, its journal, and what was done to it.

It shares no decoding, no table and no verdict with what it judges. Its invariants, as far as they can be seen so:

I0  A sound robot that nobody disturbs does its whole mission; the program does not fail.
I1  In init, fault and end no target speed but zero is on the wire; in ready, calibrate and quickstop targets only
    fall. In fault and quickstop the true speed stays below the ramp. A robot that nobody drives comes to rest, or is
    stopped.
I2  After the loss of the input (from the end of its worst case on), or the release of its enable button, targets only
    fall, and are zero after the ramp.
I3  Every injected fault that has to be noticed in its situation is in the journal within its worst case and one tick,
    by its own name (or one as which it shows) before any other. No fault stops a robot to which nothing happened.
I4  From the injection to standstill the robot goes no further than v (detect + react) + v²/2a. A wheel whose drive cut
    its power is braked by friction alone.
I5  A drive is enabled only when since its last start or fault its identity was read, its watchdog set and proven, its
    mode seen, and a harmless target sent; traction only with the wheels straight; driving by hand only begins with the
    controls released.
I6  After an acknowledgment nothing moves until the robot is armed.
I7  Whatever becomes of the host, each drive begins to stop 200 ms after its last heartbeat; and no heartbeat is sent
    without a tick.
I8  A driven wheel does not push for longer than 120 ms while the other's drive is off. No steering drive is switched
    off while the robot moves.
I9  Speed, acceleration, steering angle and rate of the set-points stay within the robot's limits + 2 %; the true speed,
    too, unless the injected fault makes the machine misbehave. All wheels are sent about one turning point.
I10 Faults that need a person wait for one, final ones for ever; automatic recoveries stay within budget.
I11 The journal has no gaps; each change of the mode is one that may be, and has its cause. (That a replay gives the
    same commands, I12, that nothing grows from run to run, and I13, that a run which was killed is resumed as if it had
    not been, is checked by whoever does the runs.)
I14 A robot with scanners touches nothing that stands; somebody who walks touches it at most while it stands. It stands
    for what is near, and for nothing else. While its scans come late it is as much slower.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from artemis_lab.campaign.monitor import contacts, faults, frames, motion, set_points
from artemis_lab.campaign.monitor.evidence import Evidence, Violation

INVARIANTS: tuple[Callable[[Evidence], Iterator[Violation]], ...] = (
    faults.ends,
    frames.targets_at_rest,
    motion.slows_down,
    motion.rests,
    frames.loss_of_input,
    faults.noticed,
    motion.stops,
    frames.enabling,
    motion.aligned,
    frames.controls_released,
    motion.moves_after_acknowledgment,
    motion.drives_watch,
    motion.heartbeats_of_ticks,
    motion.pushes_alone,
    motion.steering_holds,
    set_points.limits,
    faults.recoveries,
    faults.journal_whole,
    contacts.touches_nothing,
    contacts.stands_in_time,
    contacts.stands_for_something,
)


def judge(evidence: Evidence) -> list[Violation]:
    """Every invariant that a run broke, in the order of time."""
    found = [violation for invariant in INVARIANTS for violation in invariant(evidence)]
    return sorted(found, key=lambda violation: violation.time)
