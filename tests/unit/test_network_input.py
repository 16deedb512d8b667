"""The input `network`: its keys and files, its process, and what it says of itself to the guard."""

from __future__ import annotations

import asyncio
import errno
import math
import os
import signal
import socket
import subprocess
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

import msgspec
import pytest
from lateness import BACK
from link_rig import DRIVING, NEUTRAL, ROBOT, SECRET, Net, driving
from msgspec.structs import replace

from artemis import clock
from artemis.bridges import child_process
from artemis.bridges.child_process import ChildProcess
from artemis.bridges.operator import frames, link_process
from artemis.bridges.operator.link_process import _ENCODER, LinkProcess
from artemis.bridges.operator.operator_end import RefusedLink
from artemis.bridges.operator.pairing import write_secret
from artemis.bridges.operator.session import LinkReport
from artemis.bridges.operator.status import RobotStatus
from artemis.clock import until
from artemis.commands.operator import trusted
from artemis.commands.operator_drive import _connected, _RobotProtocol
from artemis.config import Config
from artemis.errors import ConfigError, DeviceLost
from artemis.mission.loading import load_mission
from artemis.plugins.contracts import InputDevice, PluginContext
from artemis.plugins.guard import GARBAGE, RAISED, PluginGuard
from artemis.plugins.inputs.gamepad import GamepadInput
from artemis.plugins.inputs.network import NetworkConfig, NetworkInput
from artemis.plugins.stated import stale_limit
from artemis.testing.contracts import InputContract
from artemis.testing.observers import ObserverContract
from artemis.values import OperatorInput, Request
from artemis_lab.bench.ports import free_port

TICKS = list(ObserverContract().ticks())
MISSIONS = Path(__file__).parents[2] / "missions"
PATIENCE = 20.0
"""For anything on a busy computer [s]."""


class Linked(NetworkInput):
    """On virtual time, with an operator who is there at once."""

    def __init__(self, config: NetworkConfig, context: PluginContext) -> None:
        self.net = Net()
        super().__init__(config, context, self.net, lambda: self.net.now)
        self.hand = self.net.operator()

    def read(self, now: float) -> OperatorInput:
        self.net.advance(now)
        return super().read(now)


class TestNetworkInput(InputContract):
    plugin = NetworkInput
    options: Mapping[str, object] = {"max_speed_m_s": 0.5}
    duration = 20.0

    def make(self) -> Linked:
        return Linked(NetworkConfig.model_validate(dict(self.options)), self.given())

    def move(self, device: Any) -> None:  # noqa: ANN401
        """Until a command quotes a beat that has just been sent: the age counts from there."""
        device.hand.hand = DRIVING
        device.net.advance(device.net.now + 0.1)
        while device.read(0.0).age > 0.01:
            device.net.advance(device.net.now + 0.002)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    write_secret(tmp_path / "secret", SECRET)
    return tmp_path


def context(folder: Path, *, real_time: bool = True, wake: Callable[[], None] = lambda: None) -> PluginContext:
    return PluginContext(name="remote", robot=ROBOT, folder=folder, real_time=real_time, wake=wake)


def make(folder: Path, *, real_time: bool = True, **keys: object) -> NetworkInput:
    given = {"port": free_port(), "secret": "secret", **keys}
    return NetworkInput(NetworkConfig.model_validate(given), context(folder, real_time=real_time))


def certificate(folder: Path) -> None:
    """A robot's, made as the docs say."""
    words = "req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days 2 -subj /CN=robot"
    command = ["openssl", *words.split(), "-keyout", "robot.key", "-out", "robot.pem"]
    try:
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
    except FileNotFoundError:
        pytest.skip("openssl is not installed")


# ------------------------------------------------------------------------------------------ what is refused


@pytest.mark.parametrize("real_time", [False, True])
def test_a_secret_that_others_can_read_is_refused_before_the_run_and_at_its_start(
    folder: Path, real_time: bool
) -> None:
    (folder / "secret").chmod(0o644)
    with pytest.raises(ConfigError, match=r"remote: secret: .*: its mode is 0644, so others can read it: chmod 600"):
        make(folder, real_time=real_time)


def test_a_missing_secret_is_refused_at_the_start_alone(folder: Path) -> None:
    make(folder, real_time=False, secret="none").close()
    with pytest.raises(ConfigError, match="there is no secret yet: artemis operator pair"):
        make(folder, secret="none")


def test_a_mission_names_key_line_and_column(folder: Path) -> None:
    (folder / "secret").chmod(0o604)
    mission = folder / "mission.yaml"
    (folder / "robot.yaml").write_bytes((MISSIONS / "robots/artemis.yaml").read_bytes())
    text = (
        "mission: far\nrobot: robot.yaml\nbus: simulation\ninputs:\n"
        "  remote: {plugin: network, secret: secret}\nsteps:\n  - teleop: {input: remote, until: {button: done}}\n"
    )
    mission.write_text(text)
    with pytest.raises(ConfigError, match=r"mission.yaml:5:29: inputs.remote.secret: .*: its mode is 0604"):
        load_mission(mission)
    (folder / "secret").chmod(0o600)
    assert load_mission(mission).mission.mission == "far"
    mission.write_text(text.replace("secret: secret", "listen: robot"))
    with pytest.raises(
        ConfigError, match=r"mission.yaml:5:\d+: inputs.remote.listen: expected an IPv4 or IPv6 address"
    ):
        load_mission(mission)


def test_a_port_in_use_or_a_foreign_address_is_refused_at_the_start(folder: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(ConfigError, match=rf"remote: 127.0.0.1, port {port}: Address already in use"):
            make(folder, port=port)
    with pytest.raises(ConfigError, match=r"remote: 192.0.2.1, port \d+: Cannot assign requested address"):
        make(folder, listen="192.0.2.1")


def test_a_bad_certificate_is_refused(folder: Path) -> None:
    (folder / "bad.pem").write_text("none")
    for real_time in (False, True):
        with pytest.raises(ConfigError, match=r"remote: tls: .*none\.pem"):
            make(folder, real_time=real_time, tls={"certificate": "none.pem", "key": "none.pem"})
        with pytest.raises(ConfigError, match=r"remote: tls: .*bad\.pem"):
            make(folder, real_time=real_time, tls={"certificate": "bad.pem", "key": "bad.pem"})
    with pytest.raises(ConfigError, match=r"--tls .*bad\.pem"):
        trusted(folder / "bad.pem")


def test_without_real_time_there_is_no_operator(folder: Path) -> None:
    device = make(folder, real_time=False)
    with pytest.raises(DeviceLost, match="an operator needs real time: leave `pace: fast` out"):
        device.read(0.0)
    device.close()


def test_nothing_but_loopback_unless_the_mission_says_so() -> None:
    assert NetworkConfig().listen == "127.0.0.1"
    assert NetworkInput.may_share(NetworkConfig(), NetworkConfig(listen="0.0.0.0"), {})
    assert not NetworkInput.may_share(NetworkConfig(), NetworkConfig(port=7483), {})


def test_the_stopping_distance_allows_for_the_later_notice(folder: Path) -> None:
    mission = folder / "mission.yaml"
    (folder / "robot.yaml").write_bytes((MISSIONS / "robots/artemis.yaml").read_bytes())
    for plugin, refused in (("keyboard", False), ("network", True)):
        mission.write_text(
            "mission: far\nrobot: robot.yaml\nbus: simulation\ninputs:\n"
            f"  remote: {{plugin: {plugin}, max_speed_m_s: 0.7}}\n"
            "steps:\n  - teleop: {input: remote, until: {button: done}}\nsupervision: {stop_distance_m: 0.3}\n"
        )
        if refused:
            with pytest.raises(ConfigError, match=r"0.7 m/s cannot be stopped in time: 0.22 s to react"):
                load_mission(mission)
        else:
            load_mission(mission)


def test_limits_of_age() -> None:
    assert (stale_limit(NetworkInput), stale_limit(GamepadInput)) == (0.25, 0.15)
    for stated in ("soon", True, None, math.nan, 0, -1, 5):
        with pytest.raises(ConfigError, match=r"stale_s is .*; expected more than 0, at most 1 s"):
            stale_limit(type("Odd", (), {"stale_s": stated}))


# ------------------------------------------------------------------------------------------ what it says


def test_somebody_is_present_where_acknowledge_and_arm_are_allowed() -> None:
    def live(*allow: str) -> bool:
        return Net(allow=allow).input.live

    assert [live(), live("arm"), live("acknowledge", "arm"), live("end", "arm", "acknowledge")] == [
        False,
        False,
        True,
        True,
    ]
    assert NetworkInput.live, "the class needs real time in any case"


def test_a_quick_stop_wakes_the_tick() -> None:
    net, operator = driving()
    operator.hand = replace(DRIVING, requests=(Request.QUICKSTOP,))
    net.run(0.1)
    assert net.woken == 1


def test_the_state_is_told_at_once_where_it_is_news_and_else_ten_times_a_second() -> None:
    net, operator = driving()
    told = []
    net.tell = lambda status: told.append(msgspec.json.decode(status, type=RobotStatus))  # type: ignore[method-assign]
    for tick in TICKS[:50]:
        assert net.input.show(tick) == ""
    news = [one for one, other in zip(told[1:], told, strict=False) if one.differs(other)]
    assert 9 <= len(told) <= 10 + len(news)
    operator.leave()
    net.run(0.1)
    told.clear()
    net.input.show(TICKS[50])
    assert not told, "nobody is there"


class Talking:
    """An input that says something of itself."""

    Config = Config

    def __init__(self, problems: Any) -> None:  # noqa: ANN401 (whatever a plugin says)
        self._problems = problems

    def read(self, now: float) -> OperatorInput:
        return replace(NEUTRAL, source="remote")

    def take_problems(self) -> Any:  # noqa: ANN401
        if isinstance(self._problems, Exception):
            raise self._problems
        return self._problems

    def close(self) -> None: ...


def guarded(says: object) -> PluginGuard:
    return PluginGuard({"remote": cast(InputDevice, Talking(says))}, lambda: 0.0)


@pytest.mark.parametrize(
    ("says", "becomes"),
    [
        ([], []),
        ([("NET-01", "gone")], [("NET-01", "remote", "gone")]),
        ([("NET-04", 7)], [("NET-04", "remote", "7")]),
        ([("DRV-01", "a drive")], [(GARBAGE, "remote", "'DRV-01'")]),
        ([("NET-99", "")], [(GARBAGE, "remote", "'NET-99'")]),
        (ZeroDivisionError("mine"), [(RAISED, "remote", "ZeroDivisionError('mine')")]),
    ],
)
def test_what_an_input_says_of_itself_is_a_fault_of_its_own_rows(says: object, becomes: list[Any]) -> None:
    guard = guarded(says)
    assert len(guard.read(0.0)) == 1
    assert [(id, name, words.partition(" at test_")[0]) for id, name, words in guard.take_problems()] == becomes


def test_what_is_no_list_of_problems_is_an_error_of_the_plugin() -> None:
    for says in (None, [1], [("NET-01",)], 7):
        guard = guarded(says)
        guard.read(0.0)
        assert [(row, who) for row, who, _ in guard.take_problems()] == [(RAISED, "remote")]


def test_a_quick_stop_that_was_heard_outlives_the_link_s_process(monkeypatch: pytest.MonkeyPatch) -> None:
    net, operator = driving(allow=["arm"])
    operator.hand = replace(DRIVING, requests=(Request.QUICKSTOP, Request.ARM))
    net.advance(net.now + 0.1)
    net.input._hear()

    def ended() -> list[LinkReport]:
        raise DeviceLost("operator link", "its process has ended")

    monkeypatch.setattr(net, "take", ended)
    sample = net.input.read(net.now)
    assert (sample.requests, sample.enabled, sample.neutral, sample.age) == ((Request.QUICKSTOP,), False, False, None)
    with pytest.raises(DeviceLost, match="its process has ended"):
        net.input.read(net.now)


def test_the_last_reports_of_a_process_are_taken_before_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(child_process, "SOONEST", 1000.0)
    link = LinkProcess.__new__(LinkProcess)
    link._loop, link._process, link._last = None, ChildProcess(["-c", "raise SystemExit('no room')"], []), LinkReport()
    link._restarts = child_process.Restarts()
    assert link._process.wait(PATIENCE)
    link._ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    link._ours.setblocking(False)
    with its:
        its.send(_ENCODER.encode(LinkReport(requests=[Request.QUICKSTOP])))
    reports = link.take()
    assert [report.requests for report in reports] == [[Request.QUICKSTOP], [], []]
    assert reports[-1].problems == [("NET-13", "the link's process: ended with status 1: no room; it is started again")]
    assert link.take() == [], "it had worked: the next one is begun soon"


# ------------------------------------------------------------------------------------------ its process


async def see(condition: Callable[[], object], device: NetworkInput) -> OperatorInput:
    """Tick until it holds."""
    loop = asyncio.get_running_loop()
    async with asyncio.timeout(PATIENCE):
        while True:
            sample = device.read(loop.time())
            if condition():
                return sample
            await until(loop.time() + 0.02)


async def met(port: int, tls: Path | None = None) -> _RobotProtocol:
    return await _connected("127.0.0.1", port, SECRET, trusted(tls), "alice", frames.DRIVE)


@pytest.mark.realtime
@pytest.mark.parametrize("encrypted", [False, True])
def test_its_process_brings_commands_in_and_states_out(folder: Path, encrypted: bool) -> None:
    keys: dict[str, Any] = {"port": free_port()}
    if encrypted:
        certificate(folder)
        keys["tls"] = {"certificate": "robot.pem", "key": "robot.key"}
    trusts = folder / "robot.pem" if encrypted else None

    async def drive() -> None:
        loop, device = asyncio.get_running_loop(), make(folder, **keys)
        process = device._port._process  # type: ignore[union-attr]
        protocol = None
        try:
            protocol = await met(int(str(keys["port"])), trusts)
            end = protocol.end
            hand = NEUTRAL

            def driven() -> bool:
                end.command(hand, loop.time())
                protocol.flush()
                device.show(TICKS[60])
                return device._arrived is not None and device._arrived.speed == hand.speed

            assert (await see(driven, device)).neutral
            hand = DRIVING
            await see(driven, device)
            await see(lambda: driven() and end.status, device)
            assert msgspec.json.decode(end.status, type=RobotStatus).mode == TICKS[60].mode.value
        finally:
            device.close()
            assert process.end() == "ended with status 0"
            if protocol is not None:
                await protocol.closed
        assert end.over == frames.RUN_OVER
        device.close()

    clock.run(drive(), simulated=False)


@pytest.mark.realtime
def test_a_robot_with_another_certificate_or_without_one_is_refused(folder: Path) -> None:
    certificate(folder)
    os.rename(folder / "robot.pem", folder / "other.pem")
    certificate(folder)

    async def knock() -> None:
        port = free_port()
        device = make(folder, port=port, tls={"certificate": "robot.pem", "key": "robot.key"})
        try:
            for trusts in ("other.pem", None):
                with pytest.raises((RefusedLink, DeviceLost), match=r"TLS|closed|no answer|reset"):
                    await met(port, None if trusts is None else folder / trusts)
        finally:
            device.close()

    clock.run(knock(), simulated=False)


@pytest.mark.realtime
def test_a_process_that_is_killed_is_back_on_the_same_port_and_sessions_begin_anew(folder: Path) -> None:
    met_with: list[object] = []
    port = free_port()

    async def die() -> None:
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda loop, context: met_with.append(context))
        device = make(folder, port=port)
        link = device._port
        assert isinstance(link, LinkProcess)
        try:
            for _ in range(3):
                protocol = await met(port)

                def driven() -> bool:
                    protocol.end.command(NEUTRAL, loop.time())  # noqa: B023 (called here)
                    protocol.flush()  # noqa: B023
                    return device._report.seat == "held" and device._arrived is not None

                await see(driven, device)
                device.take_problems()
                os.kill(link._process.pid, signal.SIGKILL)
                killed = loop.time()
                sample = await see(lambda: device._report.seat == "lost", device)
                assert (sample.enabled, sample.neutral) == (False, False)
                problems = device.take_problems()
                assert ("NET-01", "alice at 127.0.0.1: the link's process: killed by SIGKILL") in problems
                assert ("NET-13", "the link's process: killed by SIGKILL; it is started again") in problems
                await protocol.closed
                ticking = asyncio.ensure_future(see(lambda: False, device))
                after = await met(port)
                ticking.cancel()
                assert loop.time() - killed <= BACK
                after.abort()
                await after.closed
            said: list[str] = []

            def is_said() -> bool:
                said.extend(words for _, words in device.take_problems())
                return "it is back after" in "".join(said)

            await see(is_said, device)
        finally:
            device.close()
        with pytest.raises(ConnectionRefusedError):
            await loop.create_connection(asyncio.Protocol, "127.0.0.1", port)

    clock.run(die(), simulated=False)
    assert not met_with, "nothing but `read` says so: an error in the run's loop would end the run"


@pytest.mark.realtime
def test_an_input_without_a_process_is_lost(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def die() -> None:
        device = make(folder)
        link = device._port
        assert isinstance(link, LinkProcess)
        await see(lambda: link._restarts._works, device)

        def full(*arguments: object) -> None:
            raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")

        monkeypatch.setattr(link_process, "ChildProcess", full)
        link._process.end()
        try:
            why = "its process has ended: (killed by SIGKILL|it cannot be started: Resource temporarily unavailable)"
            with pytest.raises(DeviceLost, match=why):
                await see(lambda: False, device)
            monkeypatch.setattr(link_process, "ChildProcess", ChildProcess)

            def back() -> bool:
                with suppress(DeviceLost):
                    device.read(0.0)
                return link._restarts._works

            async with asyncio.timeout(PATIENCE):
                while not back():
                    await until(asyncio.get_running_loop().time() + 0.02)
        finally:
            device.close()

    clock.run(die(), simulated=False)
