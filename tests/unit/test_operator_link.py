"""Both ends of an operator's link as functions of bytes and times: what counts, what stops, who has the seat."""

from __future__ import annotations

import itertools
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from link_rig import DRIVING, NEUTRAL, SECRET, TICK, Net, Seen, driving, welcome
from msgspec.structs import replace

from artemis.bridges.operator import frames
from artemis.bridges.operator.frames import Claim, ForgedFrame, MalformedFrame, SentCommand, Splitter
from artemis.bridges.operator.link_process import _ENCODER, LARGEST
from artemis.bridges.operator.operator_end import OperatorEnd, RefusedLink
from artemis.bridges.operator.robot_end import MOST_WAITING, RobotEnd
from artemis.bridges.operator.session import BEAT_EVERY, DEAD, FRESH
from artemis.commands.operator_drive import NEWS_RATE, SEND_EVERY
from artemis.values import Request

TO_STOP = FRESH + TICK
"""From a cut to the tick that stops, at most [s]: a command quotes a beat that came before it."""


def first(seen: list[Seen], row: str) -> float:
    """When a row is first told [s]."""
    return next(each.time for each in seen if row in each.rows)


def rows(seen: list[Seen]) -> set[str]:
    return set().union(*(each.rows for each in seen))


def drives(seen: Seen) -> bool:
    sample = seen.sample
    return sample.enabled and sample.age is not None and sample.age <= FRESH


def test_what_the_hand_wishes_arrives_with_its_age() -> None:
    net, operator = driving(max_speed_m_s=0.3)
    seen = net.run(1.0)
    assert all(drives(each) and not each.problems for each in seen)
    assert {each.sample.speed for each in seen} == {0.3}, "cut to what the mission allows"
    assert {(each.sample.steering, each.sample.axes) for each in seen} == {(0.2, (0.1, 0.8))}
    ages = [each.sample.age for each in seen if each.sample.age is not None]
    assert max(ages) <= BEAT_EVERY + 2 * TICK + 0.01, "a beat's period, a command's, and a tick's"
    assert operator.end.beat.round_trip is not None
    assert operator.end.beat.round_trip < 0.01


def test_a_held_button_counts_only_after_a_release() -> None:
    net = Net()
    operator = net.operator()
    operator.hand = DRIVING
    assert not any(each.sample.enabled or each.sample.neutral for each in net.run(1.0))
    operator.hand = NEUTRAL
    assert net.run(0.2)[-1].sample.neutral
    operator.hand = DRIVING
    assert drives(net.run(0.2)[-1])


def test_nobody_has_connected() -> None:
    seen = Net().run(1.0)
    assert {(each.sample.age, each.sample.neutral, bool(each.problems)) for each in seen} == {(None, False, False)}


# ------------------------------------------------------------------------------------------ damage


@pytest.mark.parametrize("direction", ["to_robot", "to_operator", "both"])
@pytest.mark.parametrize("phase", [0.0, 0.013, 0.031])
def test_a_cut_link_stops_by_the_age_alone(direction: str, phase: float) -> None:
    net, operator = driving()
    net.advance(net.now + phase)
    cut = net.now
    for damage in (operator.to_robot, operator.to_operator):
        damage.cut = direction == "both" or damage is getattr(operator, direction)
    seen = net.run(0.6)
    row = "NET-02" if direction == "to_operator" else "NET-01"  # his commands come, but quote old beats
    assert first(seen, row) - cut <= TO_STOP
    assert not any(drives(each) for each in seen if each.time - cut > TO_STOP)
    later = net.run(1.0)
    assert all(row in each.rows for each in later), "as long as nobody is there"
    assert (net.robot.owner is None) == (direction != "to_operator"), "the seat of a dead link is free"


def test_a_closed_connection_stops_in_the_next_tick() -> None:
    net, operator = driving()
    operator.close()
    seen = net.run(TICK)
    assert (seen[0].rows, seen[0].sample.enabled) == ({"NET-01"}, False)


def test_delay_up_to_the_limit_drives_and_beyond_it_stops_as_latency() -> None:
    net, operator = driving()
    operator.to_robot.delay_s = 0.12
    net.run(1.0)
    assert all(drives(each) and not each.problems for each in net.run(1.0))
    for delay in range(13, 40):
        operator.to_robot.delay_s = delay / 100
        net.run(0.1)
    seen = net.run(1.0)
    assert rows(seen) == {"NET-02"}
    assert not any(drives(each) for each in seen)
    assert "commands are 4" in seen[-1].problems[0][1], "0.4 s and more"


def test_delay_near_the_limit_is_told() -> None:
    net, operator = driving()
    operator.to_robot.delay_s = 0.18
    net.run(1.0)
    seen = net.run(1.0)
    assert (rows(seen), all(drives(each) for each in seen)) == ({"NET-15"}, True)
    ages = [int(words.split(": ")[1].split()[0]) for each in seen for _, words in each.problems]
    assert (min(ages) >= 200, max(ages) <= 250) == (True, True)


def test_jitter_is_told_while_commands_are_fresh() -> None:
    net, operator = driving()
    seen = []
    for _ in range(25):  # waves: what waits for 0.12 s comes at once
        operator.to_robot.stall = True
        seen += net.run(0.12)
        operator.to_robot.stall = False
        seen += net.run(0.02)
    assert (rows(seen), all(drives(each) for each in seen)) == ({"NET-03"}, True)
    assert rows(net.run(4.0)[120:]) == set(), "it clears"


def test_a_burst_after_a_stall_has_no_effect() -> None:
    net, operator = driving()
    operator.to_robot.stall = True
    net.run(0.7)
    operator.to_robot.stall = False
    seen = net.run(0.4)
    assert "NET-04" in rows(seen)
    told = next(text for each in seen for row, text in each.problems if row == "NET-04")
    assert int(told.split(": ")[1].split()[0]) >= 15
    assert not any(each.sample.enabled for each in seen), "held all the while: released and pressed first"
    operator.hand = NEUTRAL
    net.run(0.1)
    operator.hand = DRIVING
    assert drives(net.run(0.1)[-1])


def test_an_operator_whose_program_hangs_does_not_drive_on_by_what_waited() -> None:
    net, operator = driving()
    operator.hangs = True
    seen = net.run(0.6)
    assert first(seen, "NET-01") - seen[0].time <= TO_STOP
    operator.hangs = False
    assert not any(each.sample.enabled for each in net.run(0.5))


def test_loss_is_told_while_commands_are_fresh() -> None:
    net, operator = driving()
    operator.to_robot.loss = 0.3
    seen = net.run(2.0)
    assert rows(seen) == {"NET-05"}
    assert all(drives(each) for each in seen)


@pytest.mark.parametrize("damage", ["duplicate", "reorder"])
def test_what_comes_twice_or_too_late_has_no_effect_and_closes_the_link(damage: str) -> None:
    net, operator = driving()
    setattr(operator.to_robot, damage, 1.0)
    seen = net.run(0.5)
    assert "NET-06" in rows(seen)
    assert net.robot.owner is None
    assert "NET-01" in seen[-1].rows


def test_a_recorded_command_is_worth_nothing() -> None:
    net, operator = driving()
    operator.hand = replace(DRIVING, speed=0.1)
    net.run(0.5)
    operator.to_robot.replay = 2
    seen = net.run(0.2)
    assert {each.sample.speed for each in seen} == {0.1}
    assert not rows(seen), "two are dropped"
    operator.to_robot.replay = 50  # with those of 0.4 m/s
    seen = net.run(0.1)
    assert "NET-06" in rows(seen)
    assert {each.sample.speed for each in seen} <= {0.1, 0.0}


def test_a_recorded_session_is_refused() -> None:
    """All bytes of an operator, sent to another session, do not even take the seat."""
    sent = bytearray()
    end, robot = OperatorEnd(SECRET, "alice", random=random.Random(1).randbytes), RobotEnd(SECRET, b"{}")
    link = robot.connected("10.0.0.2", 0.0)
    for step in range(20):
        robot.beat(step * 0.05)
        end.receive(bytes(link.output), step * 0.05)
        link.output.clear()
        end.command(DRIVING, step * 0.05)
        sent += end.output
        link.receive(bytes(end.output), step * 0.05)
        end.output.clear()
    assert robot.report.newest is not None
    again = RobotEnd(SECRET, b"{}")
    again.connected("10.0.0.3", 0.0).receive(bytes(sent), 0.0)
    assert again.owner is None
    assert again.report.problems == [("NET-07", "10.0.0.3 has another secret")]


def test_forged_frames_have_no_effect_and_close_the_link() -> None:
    net, operator = driving()
    operator.to_robot.forge = 0.1
    seen = net.run(1.0)
    assert "NET-07" in rows(seen)
    assert {each.sample.speed for each in seen} <= {0.4, 0.0}
    operator.to_robot.forge = 1.0
    net.run(0.5)
    assert net.robot.owner is None


def test_a_wrong_key_takes_no_seat_and_disturbs_nobody() -> None:
    net, _ = driving()
    stranger = net.operator("mallory", bytes(32))
    seen = net.run(0.5)
    assert all(drives(each) for each in seen)
    assert rows(seen) == {"NET-07"}
    assert stranger.refused == "the robot has another secret: pair both sides again"


def test_a_robot_without_the_secret_is_no_robot() -> None:
    end = OperatorEnd(SECRET, "alice")
    end.receive(frames.framed(frames.hello(bytes(16))), 0.0)
    with pytest.raises(RefusedLink, match="did not prove the secret"):
        end.receive(frames.sealed(bytes(32), bytes((frames.WELCOME,)) + welcome()), 0.0)


def test_a_second_operator_is_refused_by_name_until_the_first_releases() -> None:
    net, alice = driving()
    bob = net.operator("bob")
    seen = net.run(0.5)
    assert bob.refused == "alice at 10.0.0.2 has the robot"
    assert (rows(seen), all(drives(each) for each in seen)) == ({"NET-08"}, True)
    alice.leave()
    seen = net.run(0.2)
    assert (alice.end.over, rows(seen[5:])) == ("the robot is free", set())
    assert {(each.sample.neutral, each.sample.age) for each in seen[3:]} == {(True, 0.0)}, "free: the robot stands"
    bob = net.operator("bob")
    bob.hand = DRIVING
    assert not any(each.sample.enabled for each in net.run(0.3)), "take: not with a pressed button"
    bob.hand = NEUTRAL
    net.run(0.1)
    bob.hand = DRIVING
    assert drives(net.run(0.1)[-1])
    assert not rows(net.seen[-10:])


def test_everybody_with_the_secret_may_stop() -> None:
    net, _ = driving()
    visitor = net.operator("bob", role=frames.STOP)
    seen = net.run(0.1)
    assert [each.sample.requests for each in seen if each.sample.requests] == [(Request.QUICKSTOP,)]
    assert (visitor.end.over, net.woken) == ("a quick stop was asked for", 1)
    assert net.robot.owner is not None


def test_requests_come_once_and_only_those_that_are_allowed() -> None:
    net, operator = driving(allow=["acknowledge"])
    asked = (Request.QUICKSTOP, Request.ACKNOWLEDGE, Request.ARM, Request.END, Request.DONE, Request.RECORD)
    operator.hand = replace(DRIVING, requests=asked)
    seen = net.run(0.3)
    found = [request for each in seen for request in each.sample.requests]
    assert found == [Request.QUICKSTOP, Request.ACKNOWLEDGE, Request.DONE, Request.RECORD]
    assert [text for each in seen for row, text in each.problems if row == "NET-08"] == [
        "alice at 10.0.0.2 asked to arm: the mission does not allow it"
    ]


def test_a_stop_that_comes_late_still_stops_and_nothing_else_does() -> None:
    net, operator = driving(allow=["acknowledge", "arm"])
    operator.to_robot.delay_s = 0.6
    operator.hand = replace(DRIVING, requests=(Request.QUICKSTOP, Request.ARM))
    seen = net.run(1.5)
    assert [each.sample.requests for each in seen if each.sample.requests] == [(Request.QUICKSTOP,)]


def test_a_flood_is_dropped_and_the_rest_drives() -> None:
    net, operator = driving()
    seen = []
    for _ in range(50):
        for _ in range(200):  # 10,000 a second
            operator.end.command(DRIVING, net.now)
        seen += net.run(TICK)
    assert rows(seen) == {"NET-10"}
    assert all(drives(each) for each in seen)


@pytest.mark.parametrize("role", [frames.STOP, frames.DRIVE])
def test_connections_that_prove_nothing_keep_nobody_out(role: int) -> None:
    net = Net()
    idle = [net.robot.connected("10.0.0.9", 0.0) for _ in range(MOST_WAITING)]
    other = net.robot.connected("10.0.0.7", 0.0)
    operator = net.operator("bob", role=role)
    flood = [net.robot.connected("10.0.0.9", net.now) for _ in range(3 * MOST_WAITING)]
    seen = net.run(0.3)
    if role == frames.STOP:
        assert Request.QUICKSTOP in [request for each in seen for request in each.sample.requests]
    else:
        assert net.robot.owner is operator.link is not None
    assert all(link.closing for link in idle)
    assert [link.closing for link in flood[-3:]] == [False] * 3
    assert not other.closing
    assert "NET-10" in rows(seen)


def test_connections_that_prove_nothing_are_few_and_short() -> None:
    net, _ = driving()
    idle = [net.operator(str(number), bytes(32)) for number in range(MOST_WAITING + 3)]
    for operator in idle:
        operator.hangs = True
    seen = net.run(0.5)
    assert sum(operator.link is not None for operator in idle) == MOST_WAITING
    assert rows(seen) == {"NET-10"}
    seen = net.run(2.0)
    assert not any(operator.link for operator in idle)
    assert all(drives(each) for each in seen)


@pytest.mark.parametrize("offset", [1e6, -1e6])
def test_clocks_of_the_operator_mean_nothing(offset: float) -> None:
    net, operator = driving()
    operator.own_time = lambda now: now + offset
    net.run(0.1)
    jumps = itertools.cycle([0.0, 3600.0, -7200.0, 1e-3, -0.5])
    seen = []
    for jump in itertools.islice(jumps, 25):
        operator.own_time = lambda now, jump=jump: offset + 0.5 * now + jump  # type: ignore[misc]
        seen += net.run(0.08)
    assert all(drives(each) and not each.problems for each in seen)


def test_a_device_that_is_silent_or_gone_stops() -> None:
    net, operator = driving()
    operator.hand = replace(DRIVING, age=0.3)
    seen = net.run(0.2)[5:]
    assert (rows(seen), any(drives(each) for each in seen)) == (set(), False), "INP-03: it is no fault of the link"
    operator.hand = replace(DRIVING, age=None)
    assert net.run(0.2)[-1].sample.age is None
    operator.hand = DRIVING
    assert not any(each.sample.enabled for each in net.run(0.2)), "released first"


def test_a_link_that_is_lost_is_no_frozen_device_though_both_ages_count() -> None:
    net, operator = driving()
    operator.hand = replace(DRIVING, age=0.1)
    net.run(0.2)
    operator.to_robot.cut = True
    for seen in net.run(0.4):
        assert seen.sample.age is not None
        assert ("NET-01" in seen.rows) == (seen.sample.age > FRESH)


def test_a_silent_operator_loses_the_seat() -> None:
    net, operator = driving()
    operator.to_robot.cut = operator.to_operator.cut = True
    net.run(DEAD + 0.1)
    bob = net.operator("bob")
    net.run(0.2)
    assert bob.end.welcome is not None


# ------------------------------------------------------------------------------------------ bytes


@pytest.mark.parametrize(
    "rubbish",
    [b"\0\0", b"\xff\xff", b"GET / HTTP/1.1\r\n\r\n", frames.framed(bytes(40)), frames.framed(frames.hello(bytes(16)))],
)
def test_rubbish_before_the_claim_closes_the_connection(rubbish: bytes) -> None:
    net, _ = driving()
    link = net.robot.connected("10.0.0.9", net.now)
    link.receive(rubbish, net.now)
    assert link.closing
    seen = net.run(0.1)
    assert (rows(seen), all(drives(each) for each in seen)) == ({"NET-09"}, True)


def test_rubbish_in_a_session_ends_it() -> None:
    net, operator = driving()
    operator.to_robot.rubbish = b"\xff\xff\xff"
    seen = net.run(0.1)
    assert {"NET-09", "NET-01"} <= rows(seen)


@pytest.mark.parametrize(
    "body",
    [
        bytes((frames.COMMAND,)),
        frames.command(SentCommand(1, 1)) + b"\0",
        frames.command(SentCommand(1, 1, speed=float("nan"))),
        frames.command(SentCommand(1, 1, axes=(float("inf"),))),
        frames.command(SentCommand(1, 10**6)),
        frames.command(SentCommand(1, 0)),
        frames.release(1) + b"\0",
        frames.beat(frames.Beat(1, None, None, b"")),
        bytes((99,)),
    ],
)
def test_a_body_that_cannot_be_ends_the_session_though_it_is_sealed(body: bytes) -> None:
    net, operator = driving()
    assert operator.end._keys is not None
    assert operator.link is not None
    if body[0] == frames.COMMAND and len(body) > 20:
        body = body[:1] + (10**6).to_bytes(8, "big") + body[9:]
    operator.link.receive(frames.sealed(operator.end._keys.operator, body), net.now)
    assert net.robot.owner is None
    assert net.robot.report.problems[0][0] == "NET-09"


@given(
    st.builds(
        SentCommand,
        sequence=st.integers(0, 2**64 - 1),
        beat=st.integers(0, 2**64 - 1),
        heard=st.booleans(),
        enabled=st.booleans(),
        neutral=st.booleans(),
        age=st.integers(0, 65534).map(lambda ms: ms / 1e3),
        hold=st.integers(0, 65534).map(lambda tenths: tenths / 1e4),
        requests=st.lists(st.sampled_from(frames.REQUESTS), unique=True).map(
            lambda found: tuple(request for request in frames.REQUESTS if request in found)
        ),
        speed=st.floats(allow_nan=False, allow_infinity=False),
        steering=st.floats(allow_nan=False, allow_infinity=False),
        axes=st.lists(st.floats(-1, 1), max_size=16).map(tuple),
    )
)
def test_a_command_survives_its_bytes(wanted: SentCommand) -> None:
    assert frames.command_from(frames.command(wanted)) == wanted
    assert len(frames.sealed(SECRET, frames.command(wanted))) <= frames.MOST_FROM_OPERATOR


@given(st.binary(max_size=200))
def test_no_bytes_are_more_than_malformed(data: bytes) -> None:
    for parse in (frames.claim_from, frames.command_from, frames.beat_from, frames.sequence_of_release):
        try:
            parse(data)
        except MalformedFrame:
            continue
    with pytest.raises(ForgedFrame):
        frames.opened(SECRET, data)


@given(st.lists(st.binary(min_size=1, max_size=60), max_size=8), st.lists(st.integers(1, 40), max_size=30))
def test_pieces_of_a_stream_do_not_matter(bodies: list[bytes], cuts: list[int]) -> None:
    stream, splitter, found, place = b"".join(map(frames.framed, bodies)), Splitter(60), [], 0
    for length in [*cuts, len(stream)]:
        found += splitter.feed(stream[place : place + length])
        place += length
    assert found == bodies


@given(st.integers(0, 2**32), st.binary(min_size=frames.TAG, max_size=frames.TAG))
def test_a_claim_of_another_session_proves_nothing(seed: int, nonce: bytes) -> None:
    one, other = random.Random(seed).randbytes(16), random.Random(seed + 1).randbytes(16)
    assert frames.proof_of(SECRET, one, nonce, "a", 0) != frames.proof_of(SECRET, other, nonce, "a", 0)
    assert frames.proof_of(SECRET, one, nonce, "a", 0) != frames.proof_of(SECRET, one, nonce, "a", 1)
    keys = frames.session_keys(SECRET, one, nonce, "a")
    assert keys != frames.session_keys(SECRET, other, nonce, "a")
    assert keys.robot != keys.operator


def test_a_claim_survives_its_bytes() -> None:
    wanted = Claim(frames.DRIVE, bytes(range(16)), "älice", bytes(range(32)))
    assert frames.claim_from(frames.claim(wanted)) == wanted
    for name in ("", "x" * 41, "a\nb"):
        with pytest.raises(MalformedFrame):
            frames.claim_from(frames.claim(wanted._replace(name=name)))


@given(st.lists(st.binary(max_size=300), max_size=10))
def test_strangers_bytes_neither_raise_nor_take_the_seat(pieces: list[bytes]) -> None:
    end = RobotEnd(SECRET, b"{}")
    link = end.connected("10.0.0.9", 0.0)
    for number, piece in enumerate(pieces):
        link.receive(piece, number * 0.1)
        end.beat(number * 0.1)
    assert (end.owner, end.report.newest, end.report.requests) == (None, None, [])


@given(
    st.lists(st.binary(min_size=1, max_size=200) | st.binary(max_size=40).map(lambda rest: b"\x08" + rest), max_size=5)
)
def test_an_operators_sealed_rubbish_raises_nothing(bodies: list[bytes]) -> None:
    net, operator = driving()
    assert operator.end._keys is not None
    link = operator.link
    assert link is not None
    for body in bodies:
        link.receive(frames.sealed(operator.end._keys.operator, body), net.now)
    assert net.robot.owner is None or net.robot.owner is link
    net.run(0.1)


def test_a_report_that_nobody_takes_stays_as_small_as_a_message_between_the_processes() -> None:
    end = RobotEnd(SECRET, welcome())
    for beat in range(100_000):
        end.tell(f"NET-{3 + beat % 8:02}", "x" * 100, beat * BEAT_EVERY)
        end.ask(Request.QUICKSTOP)
    assert len(_ENCODER.encode(end.report)) < 4096 < LARGEST
    assert len(end.report.problems) == 8, "each row is told"


def test_a_stop_at_the_end_of_what_a_stalled_link_delivers_at_once_is_heard() -> None:
    net, operator = driving()
    for speed in range(int(DEAD * (NEWS_RATE + 1 / SEND_EVERY))):
        operator.send(replace(DRIVING, speed=speed / 1000))
    operator.send(replace(DRIVING, requests=(Request.QUICKSTOP,)))
    seen = net.run(0.1)
    assert [each.sample.requests for each in seen if each.sample.requests] == [(Request.QUICKSTOP,)]
    assert "NET-10" not in rows(seen)
