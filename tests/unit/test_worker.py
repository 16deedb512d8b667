"""What takes longer than a tick is done in a process of its own, which ends with the run and is replaced once."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from artemis.clock import SimulatedLoop
from artemis.devices.worker import ENDED, Worker, WorkerEnded
from artemis.motion.planned_route import PLANNER
from artemis.supervision.catalogue import ROWS
from artemis.values import Job, JobKind


def square(number: int) -> int:
    return number * number


def die(*_given: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def die_once(mark: str) -> str:
    file = Path(mark)
    if not file.exists():
        file.touch()
        die()
    return f"{os.getpid()}"


def think_for_ever() -> None:
    while True:
        pass


def test_on_virtual_time_work_is_done_at_once_in_the_same_process() -> None:
    worker = Worker(virtual=True)
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        assert runner.run(worker.do(os.getpid)) == os.getpid()
    worker.close()


def test_a_process_that_ends_is_replaced_once_and_the_work_done(tmp_path: Path) -> None:
    async def main() -> None:
        worker = Worker(virtual=False)
        try:
            assert await worker.do(square, 7) == 49
            assert await worker.do(os.getpid) != os.getpid()
            other = await worker.do(die_once, str(tmp_path / "mark"))
            assert int(other) == await worker.do(os.getpid)
        finally:
            worker.close()

    asyncio.run(main())


def test_a_second_end_is_a_fault_of_the_table_and_the_next_work_gets_a_process_again() -> None:
    job = Job(id=4, kind=JobKind.PLAN, drive=PLANNER)

    async def main() -> None:
        worker = Worker(virtual=False)
        try:
            with pytest.raises(WorkerEnded) as raised:
                await worker.do(die)
            result = raised.value.result(job)
            assert (result.id, result.kind, result.ok, result.fault) == (4, JobKind.PLAN, False, ENDED)
            assert ENDED in ROWS
            assert await worker.do(square, 3) == 9
        finally:
            worker.close()

    asyncio.run(main())


@pytest.mark.timeout(60)
def test_closing_ends_work_that_is_under_way() -> None:
    async def main() -> None:
        worker = Worker(virtual=False)
        process = await worker.do(os.getpid)
        endless = asyncio.ensure_future(worker.do(think_for_ever))
        while not endless.done() and b"R" not in Path(f"/proc/{process}/stat").read_bytes().split()[2]:
            await asyncio.sleep(0)
        endless.cancel()
        worker.close()
        assert not Path(f"/proc/{process}").exists()

    asyncio.run(main())


def test_the_process_ends_with_a_run_that_is_killed() -> None:
    program = """
import asyncio, os, signal
from artemis.devices.worker import Worker

async def main():
    worker = Worker(virtual=False)
    process = await worker.do(os.getpid)
    os.kill(process, signal.SIGTERM)
    assert await worker.do(os.getpid) == process
    os.kill(os.getpid(), signal.SIGKILL)

if __name__ == "__main__":
    asyncio.run(main())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, timeout=60)
    assert done.returncode == -signal.SIGKILL, "and nobody holds its output any more"
