"""What other programs ask of the robot, between its arrival and the tick that takes it."""

from __future__ import annotations

from artemis.bridges.commands import Command
from artemis.bridges.received import MOST, Asked, Mailbox, Received
from artemis.values import LocatedPose, Pose, Request


def test_of_each_sender_the_newest_command_is_taken_in_the_order_of_arrival() -> None:
    mailbox = Mailbox()
    for at, sender, speed in ((1.0, "one", 0.1), (1.1, "other", 0.2), (1.2, "one", 0.3)):
        mailbox.command(sender, at, Command(speed=speed))
    assert mailbox.take().commands == [("other", 1.1, Command(speed=0.2)), ("one", 1.2, Command(speed=0.3))]
    assert mailbox.take() == Received()


def test_a_crowd_of_senders_takes_no_more_room_than_some_and_keeps_none_out_that_was_there() -> None:
    mailbox = Mailbox()
    for number in range(3 * MOST):
        mailbox.command(str(number), 1.0, Command())
        mailbox.problem("NET-04", str(number))
    mailbox.command("0", 2.0, Command(speed=0.5))
    taken = mailbox.take()
    assert (len(taken.commands), len(taken.problems)) == (MOST, MOST)
    assert taken.commands[-1] == ("0", 2.0, Command(speed=0.5))


def test_requests_of_many_are_one_as_new_as_the_newest_and_all_who_called_are_known() -> None:
    mailbox = Mailbox()
    numbers = [mailbox.ask(Request.ARM, 1.0 + number, called=True) for number in range(3)]
    mailbox.ask(Request.ARM, 0.5)
    mailbox.ask(Request.DONE, 0.5)
    assert mailbox.take().asked == [Asked(Request.ARM, 3.0, numbers), Asked(Request.DONE, 0.5, [])]
    assert len(set(numbers)) == 3


def test_what_arrived_in_another_process_is_as_if_it_had_arrived_here() -> None:
    news: list[None] = []
    woken: list[None] = []
    there, here = Mailbox(), Mailbox(lambda: woken.append(None), lambda: news.append(None))
    pose = LocatedPose(pose=Pose(x=1.0), frame="map", source="remote")
    there.command("one", 1.0, Command(speed=0.1))
    there.enable(1.1, True)
    there.pose("goal_pose", 1.2, pose)
    there.problem("NET-14", "no pose")
    there.garbled()
    there.ask(Request.QUICKSTOP, 1.3, called=True)
    received = there.take()
    here.absorb(received)
    here.absorb(Received())
    assert (len(woken), len(news)) == (1, 1)
    taken = here.take()
    assert taken == received
    assert (taken.enable, taken.poses, taken.bad) == ((1.1, True), {"goal_pose": (1.2, pose)}, True)
