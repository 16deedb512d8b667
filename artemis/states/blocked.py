"""What a mode does while an obstacle stops the robot: it reports LAS-08, and ends its step after some time."""

from __future__ import annotations

from msgspec.structs import replace

from artemis.progress import BLOCKED
from artemis.states.mode import stand
from artemis.states.plan import GotoStep, Shared
from artemis.supervision import catalogue
from artemis.values import Event, Mode, Snapshot, Wish

REPLAN_AFTER = 2.5
"""A robot under way to a place looks for another route after standing for so long [s]: what stands for 2 s is real."""


def is_blocked(snapshot: Snapshot) -> bool:
    """Whether the robot stands for an obstacle, or waits for a scan."""
    clearance = snapshot.set_points.clearance
    return clearance is not None and clearance.holds


def heeded(shared: Shared, mode: Mode, wish: Wish, snapshot: Snapshot) -> Wish:
    """The wish of a mode that heeds what is in the way.

    Before the robot drives on along a planned route after it stood for some time, that is checked for new zones.
    """
    route = shared.route
    if is_blocked(snapshot):
        return _held_up(shared, mode, wish, snapshot)
    if not route.stood:
        return wish
    long, route.stood = route.stood >= REPLAN_AFTER, 0.0
    if not long or mode is not Mode.FOLLOW or not snapshot.standing or wish.event is not None:
        return wish
    route.check()
    return replace(stand(snapshot, event=Event.DONE, tracking=wish.tracking), done=wish.done)


def _held_up(shared: Shared, mode: Mode, wish: Wish, snapshot: Snapshot) -> Wish:
    """The wish of a mode whose robot is blocked, with the fault LAS-08; after too long the end of its step.

    On a planned route another one is sought first. Where the robot stands because ground was not seen, the step ends
    at once: waiting does not make it known.
    """
    clearance = snapshot.set_points.clearance
    assert clearance is not None
    if clearance.no_scan:  # LAS-01 says so if it takes too long
        return replace(wish, phase="waiting for a scan")
    seen = f"{max(clearance.distance, 0.0):.2f} m are free"
    if clearance.unseen:
        seen = f"the ground {'ahead' if wish.command.speed >= 0.0 else 'behind'} was not seen"
    fault = wish.fault or catalogue.fault("LAS-08", "", seen)
    step, route = shared.current, shared.route
    if isinstance(step, GotoStep) and route.planned:
        route.stood = clearance.blocked
    if mode is not Mode.TELEOP and snapshot.standing:
        ended = stand(snapshot, event=Event.DONE, tracking=wish.tracking)
        done = wish.done or 0.0
        waited = route.waited(done)
        most = step.replans if isinstance(step, GotoStep) else 0
        in_vain = waited and route.unseen
        if clearance.unseen and not in_vain and route.replan(most, done, clearance.blocked, unseen=True):
            return replace(ended, done=wish.done)
        if clearance.unseen or clearance.blocked + waited >= shared.rules.blocked_after:
            return replace(ended, acted=wish.acted, done=wish.done, outcome=BLOCKED, fault=fault)
        if clearance.blocked >= REPLAN_AFTER and route.replan(most, done, clearance.blocked):
            return replace(ended, done=wish.done)
    return replace(wish, fault=fault, phase="waiting for a free path")
