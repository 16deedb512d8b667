"""What a simulated LMS100 answers, in which states it is, and what it streams; in process and over TCP."""

from __future__ import annotations

import asyncio
from contextlib import suppress

import pytest
from scanner_rig import spiral

from artemis import clock
from artemis.devices.lms1xx.telegrams import TelegramReader, framed, scan_from
from artemis.devices.tcp import ByteStream, dial
from artemis.sim.lms100 import SPIN_UP, Lms100
from artemis.sim.lms100_server import serve_lms100

LOGIN = "sMN SetAccessMode 03 F4724744"
SECTOR = "+5000 -450000 +2250000"


class Client:
    """Asks, and reads what comes."""

    def __init__(self, device: Lms100, stream: ByteStream) -> None:
        self.device, self.stream = device, stream
        self._reader, self._waiting = TelegramReader(), list[bytes]()

    async def read(self) -> str:
        while not self._waiting:
            try:
                data = await self.stream.read()
            except ConnectionError:
                data = b""
            if not data:
                raise EOFError
            self._waiting = self._reader.feed(data)
        return self._waiting.pop(0).decode()

    async def ask(self, request: str) -> str:
        self.stream.write(framed(request))
        return await self.read()


async def ended(client: Client) -> None:
    """Read until the device has hung up."""
    with suppress(EOFError):
        while True:
            await client.read()
    client.stream.close()


async def connected() -> Client:
    device = Lms100(spiral)
    return Client(device, await device.dial("", 0))


def test_answers_in_the_order_of_a_session() -> None:
    async def main() -> None:
        client = await connected()
        for request, answer in (
            (LOGIN, "sAN SetAccessMode 1"),
            ("sRN STlms", "sRA STlms 7 0 8 00:00:00 8 01.01.00 0 0 0"),
            ("sMN LMCstopmeas", "sAN LMCstopmeas 0"),
            ("sRN STlms", "sRA STlms 3 0 8 00:00:00 8 01.01.00 0 0 0"),
            (f"sMN mLMPsetscancfg +5000 +1 {SECTOR}", "sAN mLMPsetscancfg 0 1388 1 1388 FFF92230 225510"),
            ("sMN mLMPsetscancfg 1388 +1 1388 FFF92230 225510", "sAN mLMPsetscancfg 0 1388 1 1388 FFF92230 225510"),
            ("sRN LMPscancfg", "sRA LMPscancfg 1388 1 1388 FFF92230 225510"),
            ("sWN LMDscandatacfg 01 00 0 1 0 00 00 0 0 0 0 +1", "sWA LMDscandatacfg"),
            (f"sWN LMPoutputRange 1 {SECTOR}", "sWA LMPoutputRange"),
            ("sMN mEEwriteall", "sAN mEEwriteall 1"),
            ("sMN LMCstartmeas", "sAN LMCstartmeas 0"),
            ("sRN STlms", "sRA STlms 5 0 8 00:00:00 8 01.01.00 0 0 0"),
            ("sMN Run", "sAN Run 1"),
            ("sMN LMCstopmeas", "sFA 1"),
            ("sWN LMPoutputRange 1 1388 0 1388", "sFA A"),
            ("sEN LMDscandata 1", "sEA LMDscandata 1"),
        ):
            assert await client.ask(request) == answer, request
        scan = scan_from((await client.read()).encode())
        assert scan.channels[0].millimetres()[:4] == bytes([0xE8, 3, 0xEB, 3])
        client.stream.close()
        client.stream.close()

    clock.run(main(), simulated=True)


@pytest.mark.parametrize(
    ("pair", "code"),
    [("+2500 +1 +2500", 0), ("+2500 +1 +5000", 0), ("+5000 +1 +2500", 2), ("+1500 +1 +5000", 1), ("+1500 +1 +100", 3)],
)
def test_pairs_of_frequency_and_resolution(pair: str, code: int) -> None:
    async def main() -> None:
        client = await connected()
        await client.ask(LOGIN)
        answer = await client.ask(f"sMN mLMPsetscancfg {pair} -450000 +2250000")
        assert answer.split()[2] == str(code)
        assert (client.device.frequency != 5000) is (code == 0)

    clock.run(main(), simulated=True)


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("sMN SetAccessMode 03 12345678", "sAN SetAccessMode 0"),
        ("sMN LMCstopmeas", "sFA 1"),
        ("sMN mLMPsetscancfg +5000 +1 +5000 -450000 +2250000", "sFA 1"),
        ("sWN LMDscandatacfg 01 00 0 1 0 00 00 0 0 0 0 +1", "sFA A"),
        ("sMN Dance", "sFA 2"),
        ("sRN DeviceMood", "sFA 3"),
        ("sRN", "sFA 3"),
        ("sRN LMPoutputRange", "sRA LMPoutputRange 1 1388 FFF92230 225510"),
        ("sRN FREchoFilter", "sRA FREchoFilter 0"),
        ("sRN LFPmeanfilter", "sRA LFPmeanfilter 0 2 0"),
        ("sRN LFPparticle", "sFA 3"),
        ("sWN LFPmeanfilter 1 +10 0", "sFA A"),
        ("sWN LFPparticle 0 +500", "sFA 3"),
        ("", "sFA 5"),
        ("sEN LMDscandata", "sFA 5"),
        ("sEN LMDscandata ?", "sFA 5"),
    ],
)
def test_what_it_refuses(request_: str, answer: str) -> None:
    async def main() -> None:
        assert await (await connected()).ask(request_) == answer

    clock.run(main(), simulated=True)


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("sMN mLMPsetscancfg +5000 +1 +5000 -450001 +2250000", "sAN mLMPsetscancfg 4 1388 1 1388 FFF92230 225510"),
        ("sMN mLMPsetscancfg +5000", "sFA 5"),
        ("sWN LMPoutputRange 1 +5000 +10 +5", "sFA 5"),
        ("sWN LMPoutputRange", "sFA 5"),
        ("sMN LMCstandby", "sAN LMCstandby 0"),
        ("sWN LFPmeanfilter 1 +10 0", "sWA LFPmeanfilter"),
        ("sWN LFPmeanfilter 1", "sFA 5"),
    ],
)
def test_what_it_refuses_who_is_logged_in(request_: str, answer: str) -> None:
    async def main() -> None:
        client = await connected()
        await client.ask(LOGIN)
        assert await client.ask(request_) == answer

    clock.run(main(), simulated=True)


def test_one_that_starts_takes_connections_and_does_nothing_yet() -> None:
    async def main() -> None:
        client = await connected()
        client.device.restart(2.0)
        client = Client(client.device, await client.device.dial("", 0))
        for request, answer in (
            ("sRN STlms", "sRA STlms 1 0 8 00:00:00 8 01.01.00 0 0 0"),
            (LOGIN, "sAN SetAccessMode 1"),
            ("sMN LMCstopmeas", "sAN LMCstopmeas 1"),
            ("sMN LMCstartmeas", "sFA 4"),
            ("sWN FREchoFilter 0", "sFA 4"),
        ):
            assert await client.ask(request) == answer
        await asyncio.sleep(2.5)
        assert (await client.ask("sRN STlms")).split()[2] == "7"
        assert await client.ask("sMN LMCstopmeas") == "sAN LMCstopmeas 0"

    clock.run(main(), simulated=True)


def test_another_frequency_takes_the_motor_some_seconds() -> None:
    async def main() -> None:
        client, loop = await connected(), asyncio.get_running_loop()
        await client.ask(LOGIN)
        await client.ask("sMN mLMPsetscancfg +2500 +1 +2500 -450000 +2250000")
        begun, states = loop.time(), list[str]()
        while not states or states[-1] != "7":
            states.append((await client.ask("sRN STlms")).split()[2])
            await asyncio.sleep(0.1)
        assert list(dict.fromkeys(states)) == ["4", "5", "7"]
        assert SPIN_UP < loop.time() - begun < SPIN_UP + 1.0

    clock.run(main(), simulated=True)


def test_scans_that_are_asked_for_are_the_newest_whole_ones() -> None:
    async def main() -> None:
        client, counters = await connected(), []
        await asyncio.sleep(1.0)
        for _ in range(5):
            counters.append(scan_from((await client.ask("sRN LMDscandata")).encode()).scan_counter)
            await asyncio.sleep(0.018)
        assert counters == [49, 50, 51, 52, 53]

    clock.run(main(), simulated=True)


def test_part_of_the_view_every_other_scan_and_intensities() -> None:
    async def main() -> None:
        client = await connected()
        await client.ask(LOGIN)
        await client.ask("sWN LMPoutputRange 1 +5000 +0 +10000")
        for bits in (8, 16):
            await client.ask(f"sWN LMDscandatacfg 01 00 1 {bits // 16} 0 00 00 0 0 0 0 +2")
            await client.ask("sEN LMDscandata 1")
            scans = [scan_from((await client.read()).encode()) for _ in range(3)]
            assert await client.ask("sEN LMDscandata 0") == "sEA LMDscandata 0"
            assert {scan.scan_counter % 2 for scan in scans} == {0}
            distances, strengths = scans[0].channels
            assert (distances.content, strengths.content) == ("DIST1", "RSSI1")
            assert (distances.start, len(distances.values)) == (0, 2 * 3)
            assert distances.millimetres()[:2] == (1000 + 3 * 90).to_bytes(2, "little")
            assert strengths.meant() == b"\x64\x00" * 3

    clock.run(main(), simulated=True)


def test_telegrams_may_be_split_and_joined() -> None:
    async def main() -> None:
        client = await connected()
        for byte in framed("sRN STlms") * 2:
            client.stream.write(bytes([byte]))
        assert await client.read() == await client.read()

    clock.run(main(), simulated=True)


@pytest.mark.realtime
def test_many_clients_over_the_network() -> None:
    async def main() -> None:
        device = Lms100(spiral)
        server = await serve_lms100(device, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        clients = [Client(device, await dial("127.0.0.1", port)) for _ in range(3)]
        for client in clients:
            assert await client.ask("sEN LMDscandata 1") == "sEA LMDscandata 1"
        counters = [scan_from((await client.read()).encode()).scan_counter for client in clients for _ in range(3)]
        assert counters[0] + 2 == counters[2]
        clients[0].stream.close()
        device.unplug()
        for client in clients[1:]:
            await ended(client)
        refused = Client(device, await dial("127.0.0.1", port))
        await ended(refused)
        server.close()
        await server.wait_closed()

    clock.run(main(), simulated=False)
