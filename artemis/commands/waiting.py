"""`artemis page FOLDER`: the robot waits for an operator, who chooses a mission of the folder."""

from __future__ import annotations

import asyncio
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from artemis.bridges.operator.server import files_of_tls
from artemis.commands.page import announce
from artemis.errors import ConfigError
from artemis.mission.problems import checked
from artemis.notify import ServiceManager
from artemis.page.mission_folder import CheckedMission
from artemis.page.observer import PageObserverConfig, check_installed

ARTEMIS = (sys.executable, "-P", "-m", "artemis")


def wait_for_operators(folder: Path, options: dict[str, Any]) -> int:
    """Serve the page of a folder of missions until a signal ends it; a run that goes on is ended in order before.

    Raises:
        ConfigError: there is no such folder, the extra is not installed, the port is in use, or the page's options are
            wrong.
    """
    if not folder.is_dir():
        raise ConfigError(f"{folder}: expected a folder of missions, or pair, or certificate with names")
    check_installed("artemis page")
    folder, config = folder.absolute(), checked(PageObserverConfig, options)
    tls = files_of_tls(config.tls, folder, "artemis page")
    from artemis.page.waiting_page import WaitingPage

    async def main() -> None:
        check = [*ARTEMIS, "check", "--json", "--page", "--"]
        page = WaitingPage(folder, config, tls, check, _run(config), ServiceManager())
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            asyncio.get_running_loop().add_signal_handler(number, page.end)
        try:
            announce(config)
            await page.wait()
        finally:
            await page.close()

    with asyncio.Runner(loop_factory=asyncio.SelectorEventLoop) as runner:
        runner.run(main())
    return 0


def _run(config: PageObserverConfig) -> Callable[[CheckedMission], Sequence[str]]:
    """How a mission is run whose page has the port of this one."""

    def command(mission: CheckedMission) -> Sequence[str]:
        page = ["--page-port", str(config.port), "--page-address", config.listen]
        if config.tls is not None:
            page += ["--page-tls", config.tls.certificate, config.tls.key]
        return [*ARTEMIS, "run", *page, "--started-by-page", mission.hash, "--", mission.file]

    return command
