"""Between a run and its browsers: what is told and kept while the run is not reached."""

from __future__ import annotations

import asyncio
import json
import os
from typing import Any

from artemis.bridges.page.port import PagePort
from artemis.page.hub import Hub
from artemis.values import Request

NAME = "hub of a test"


def test_stop_is_confirmed_and_control_is_given_only_while_the_run_is_reached() -> None:
    async def main() -> None:
        hub, told = Hub((os.getpid(),), NAME), list[dict[str, Any]]()
        session = hub.connected("phone", told.append)

        def said(**words: object) -> list[str]:
            """What is answered."""
            told.clear()
            session.receive(json.dumps(words), hub.now)
            hub.flush()
            return [message["t"] for message in told]

        assert said(t="take") == ["refused"]
        assert said(t="stop", id="unheard") == []
        port = PagePort(NAME)
        try:
            port.watch(lambda: None)
            hub.begin()
            while not (reports := port.take()):
                await asyncio.sleep(0)  # it accepts the connection
            assert reports[0].requests == [Request.QUICKSTOP], "it is not lost"
            assert said(t="stop", id="heard") == ["stopping"]
            assert said(t="take") == ["seat"]
            told.clear()
        finally:
            port.close()
        while hub.reaches_run:
            await asyncio.sleep(0)
        assert [message["mine"] for message in told if message["t"] == "seat"][-1] is False
        assert hub.seats.owner is None
        hub.close()

    asyncio.run(main())
