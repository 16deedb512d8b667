"""Clients of rosbridge that say as much as they may: what that costs the ticks of a run."""

from __future__ import annotations

import asyncio
import json
import sys
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from artemis.bridges.rosbridge.server import MOST_MESSAGE, RATE
from artemis.clock import stopwatch, until
from artemis.errors import ArtemisError
from artemis_lab.bench.operator_link import Ticks, run_beside
from artemis_lab.bench.ports import free_port

SHARE = 0.95
"""Of what a client may say: of more it is closed."""
WINDOW = 2.0
"""Flood and quiet alternate [s]."""
PAUSE = 5.0
"""The run has this long to begin to wait for commands [s]."""


def flooded(robot: Path, clients: int, windows: int) -> Ticks:
    """A run in real time on simulated drives that waits for commands, with so many floods of so many clients.

    Raises:
        ArtemisError: the run failed, or the clients.
    """
    ticks = Ticks()
    with TemporaryDirectory() as made:
        folder, port = Path(made), free_port()
        mission, out = folder / "mission.yaml", folder / "floods.json"
        (folder / "robot.yaml").write_bytes(robot.read_bytes())
        remote = {"plugin": "rosbridge", "port": port, "allow": ["done"]}
        steps = [{"teleop": {"input": "remote", "until": {"button": "done"}}}]
        words = {"mission": "flood", "robot": "robot.yaml", "bus": "simulation", "inputs": {"remote": remote}}
        mission.write_text(json.dumps({**words, "steps": steps}))
        command = [sys.executable, "-m", __name__, str(port), str(clients), str(windows), str(out)]
        errors = run_beside(command, mission, ticks)
        if not out.exists():
            raise ArtemisError(f"the clients failed: {errors[-500:]}")
        ticks.floods = [tuple(each) for each in json.loads(out.read_text())]
    return ticks


async def pour(port: int, clients: int, windows: int) -> list[tuple[float, float]]:
    """Flood, again and again, then end the step; from when to when [s]."""
    from websockets.asyncio.client import ClientConnection, connect

    options = {"compression": None, "proxy": None}
    url, loop = f"ws://127.0.0.1:{port}", asyncio.get_running_loop()
    message = json.dumps({"op": "publish", "topic": "/cmd_vel", "msg": {"linear": {"x": 0.0}}})
    message += " " * (MOST_MESSAGE * 3 // 4 - len(message))

    async def flood(link: ClientConnection, end: float) -> None:
        begun, sent = loop.time(), 0
        while loop.time() < end:
            await link.send(message)
            sent += 1
            await until(begun + sent / (SHARE * RATE))

    links: list[ClientConnection] = []
    while len(links) < clients:
        with suppress(OSError):
            links.append(await connect(url, **options))  # type: ignore[arg-type]
        await until(loop.time() + 0.05)
    await until(loop.time() + PAUSE)
    floods = []
    for _ in range(windows):
        await until(loop.time() + WINDOW)
        begun = stopwatch()
        await asyncio.gather(*(flood(link, loop.time() + WINDOW) for link in links))
        floods.append((begun, stopwatch()))
    while True:
        await links[0].send(json.dumps({"op": "call_service", "service": "/done", "id": "done"}))
        if json.loads(await links[0].recv()).get("values", {}).get("success"):
            return floods


def main(port: str, clients: str, windows: str, out: str) -> None:
    """Be the clients; write down when they flooded."""
    floods = asyncio.run(pour(int(port), int(clients), int(windows)))
    Path(out).write_text(json.dumps(floods))


if __name__ == "__main__":
    main(*sys.argv[1:])
