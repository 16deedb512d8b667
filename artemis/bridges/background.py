"""Tasks that are not awaited: a running loop alone keeps none of them from being collected (asyncio.create_task)."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any


class BackgroundTasks(set[asyncio.Task[None]]):
    """Those that have not ended."""

    def begin(self, work: Coroutine[Any, Any, None]) -> None:
        """Have it done on the running loop."""
        task = asyncio.get_running_loop().create_task(work)
        self.add(task)
        task.add_done_callback(self.discard)
