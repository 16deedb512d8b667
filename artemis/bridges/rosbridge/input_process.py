"""The process of an input `rosbridge`: no tick waits for its clients, whatever they send.

It understands what arrives, and hands the newest on: at most 200 times a second, a stop at once.
"""

from __future__ import annotations

import socket
import sys
import threading
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from multiprocessing.connection import Connection

import msgspec
from msgspec import Struct

from artemis.bridges.answers import Answers
from artemis.bridges.json_messages import JsonMessages, full_name
from artemis.bridges.kept_process import LOOK, KeptProcess
from artemis.bridges.names import absolute
from artemis.bridges.received import CommandRules, Mailbox, Received, Receiver
from artemis.bridges.rosbridge.server import RosbridgeServer
from artemis.bridges.rosbridge.session import Message, Offer
from artemis.bridges.rosbridge.settings import ServerConfig

APART = 0.005
"""Between two times that what arrived is handed on [s]."""
_ENCODE = msgspec.msgpack.Encoder().encode
Answer = tuple[list[int], bool, str]
"""Numbers of calls, whether the requests have an effect, and texts."""


class InputSetup(Struct, frozen=True):
    """What is sent to the process first."""

    config: str
    """A `ServerConfig` as JSON."""
    rules: CommandRules


class RosbridgeProcess(KeptProcess):
    """The process as the run sees it. The socket that listens outlives it."""

    module = "artemis.bridges.rosbridge.input_process"

    def __init__(self, setup: InputSetup, listening: socket.socket, mailbox: Mailbox) -> None:
        """What arrives goes to the `mailbox`."""
        super().__init__(setup.rules.source, [listening.fileno()])
        self._setup, self._listening, self._mailbox = setup, listening, mailbox

    def answer(self, numbers: Sequence[int], taken: bool, words: str) -> None:
        """Answer calls of services."""
        self._send(_ENCODE((numbers, taken, words)))

    def close(self) -> None:
        """End it, and listen no more; harmless when repeated."""
        super().close()
        self._listening.close()

    def _first(self) -> bytes:
        return _ENCODE(self._setup)

    def _hear(self, block: bytes) -> str:
        self._mailbox.absorb(msgspec.msgpack.decode(block, type=Received))
        return ""


class InputServer:
    """The process itself."""

    def __init__(self, setup: InputSetup, connection: Connection, listening: socket.socket) -> None:
        """Serve clients from now on."""
        self._connection, self._sending = connection, threading.Lock()
        self._news, self._ended = threading.Event(), threading.Event()
        self._mailbox, self._answers = Mailbox(wake=self._hand_on, news=self._news.set), Answers()
        config, rules = ServerConfig.model_validate_json(setup.config), setup.rules
        receiver = self._receiver = Receiver(rules, JsonMessages(config.ros), self._mailbox)
        heard = {absolute(topic): (full_name(type), take) for topic, (type, take) in receiver.topics().items()}
        offer = Offer(
            heard=heard,
            services={f"/{name}": partial(self._called, name) for name in rules.requests},
            early={topic: self._refuser(topic) for topic in heard if topic != "/stop"},
        )
        self._server = RosbridgeServer(rules.source, listening, offer, config, relayed=True)
        self._server.start()

    def run(self) -> None:
        """Hand on what arrives until the run closes the other end."""
        threading.Thread(target=self._obey, daemon=True).start()
        while not self._ended.is_set() and not self._server.problem:
            self._news.wait(LOOK)
            self._news.clear()
            self._hand_on()
            self._ended.wait(APART)
        problem = self._server.problem
        self._server.close()
        sys.exit(problem or None)

    def _hand_on(self) -> None:
        """Send the run what has arrived; and if nothing has, that this process works."""
        try:
            with self._sending:
                self._connection.send_bytes(_ENCODE(self._mailbox.take()))
        except OSError:
            self._ended.set()

    def _obey(self) -> None:
        """Answer calls with the results of the run."""
        with suppress(EOFError, OSError):
            while True:
                answer = msgspec.msgpack.decode(self._connection.recv_bytes(), type=Answer)
                self._server.soon(self._answers.give, *answer)
        self._ended.set()
        self._news.set()

    async def _called(self, name: str, _: Message) -> Message:
        """The response of a Trigger."""
        taken, words = await self._answers.of(self._receiver.call(name))
        return {"success": taken, "message": words}

    def _refuser(self, topic: str) -> partial[str]:
        """What refuses something on a topic: a refused request or pose is reported to the run, too."""
        name = topic.removeprefix("/")
        reports = name in (*self._receiver.rules.requests, *self._receiver.rules.poses)
        return partial(self._receiver.too_old if reports else self._receiver.without_effect, name)


def main(listening: int, port: int) -> None:
    """Be the process: file descriptors of the socket that listens and of the connection to the run."""
    with socket.socket(fileno=listening) as bound, Connection(port) as connection:
        setup = msgspec.msgpack.decode(connection.recv_bytes(), type=InputSetup)
        InputServer(setup, connection, bound).run()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
