"""Past runs over real connections: who may see them, what the third process makes of them, and how it ends."""

from __future__ import annotations

import asyncio
import fcntl
import io
import os
import subprocess
import zipfile
from collections.abc import AsyncIterator, Iterator, Sequence
from pathlib import Path
from typing import Any

import httpx
import pytest
from page_rig import PageRig, page_rig, recorded
from test_page_runs import made

from artemis.page import runs_making
from artemis.page.runs import REPLAY
from artemis.page.runs_making import MOST_WAITING, Works
from artemis.page.runs_replay import write_replay
from artemis.page.runs_work import NICE, command

BROKEN, CIRCLE = "20260301T130000Z-circle", "20260301T120000Z-circle"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    made(folder, CIRCLE)
    made(folder, BROKEN, fault_at=4.0)
    return folder


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory, runs: Path) -> Iterator[PageRig]:
    folder = tmp_path_factory.mktemp("page")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CONFIG_HOME", str(folder))
        with page_rig(recorded("figure_eight.yaml", 1.0, folder), folder, runs=runs) as made:
            made.show(2)
            yield made


@pytest.fixture(scope="module")
def paired(rig: PageRig) -> Iterator[httpx.Client]:
    with rig.client() as client:
        assert client.post("/pair", json={"code": rig.pairing().split("#")[1]}).status_code == 200
        yield client


def until_ready(client: httpx.Client, place: str) -> dict[str, Any]:
    """Have something made, and wait for it."""
    state: dict[str, Any] = client.post(place).json()
    while state["state"] in ("waiting", "making"):
        state = client.get(place).json()
    return state


def test_who_has_not_paired_sees_no_run(rig: PageRig) -> None:
    with rig.client() as stranger:
        assert stranger.get("/runs/").headers["location"] == "/pair"
        assert stranger.get("/runs/replay").headers["location"] == "/pair"
        for path in ("list", f"0/{CIRCLE}/run.zip", f"0/{CIRCLE}/report", f"0/{CIRCLE}/report.html"):
            assert stranger.get(f"/runs/{path}").status_code == 403
        assert stranger.get(f"/runs/0/{CIRCLE}/replay/index").status_code == 403
        assert stranger.post(f"/runs/0/{CIRCLE}/report").status_code == 403


def test_other_sites_have_nothing_made(rig: PageRig, paired: httpx.Client) -> None:
    answer = paired.post(f"/runs/0/{CIRCLE}/report", headers={"origin": "http://evil.example"})
    assert answer.status_code == 403
    assert paired.get(f"/runs/0/{CIRCLE}/report").json()["state"] == "none"


@pytest.mark.parametrize(
    "path",
    ["1/" + CIRCLE, "0/nothing", "0/%2e%2e", "x/" + CIRCLE, "0/%2e%2e%2f" + CIRCLE],
)
@pytest.mark.parametrize("what", ["report", "replay", "replay/index", "report.html", "run.zip"])
def test_nothing_else_is_given(paired: httpx.Client, path: str, what: str) -> None:
    assert paired.get(f"/runs/{path}/{what}").status_code == 404


@pytest.mark.parametrize("what", ["journal.jsonl", "facts", "replay/made.json", "replay/..%2findex", "replay/x"])
def test_no_other_file_is_given(paired: httpx.Client, what: str) -> None:
    assert paired.get(f"/runs/0/{CIRCLE}/{what}").status_code == 404


def test_the_list_comes_newest_first_and_in_parts(paired: httpx.Client) -> None:
    told = paired.get("/runs/list").json()
    while any(run["facts"] is None for run in told["runs"]):
        told = paired.get("/runs/list").json()
    assert [run["id"] for run in told["runs"]] == [f"0/{BROKEN}", f"0/{CIRCLE}"]
    assert [run["facts"]["outcome"] for run in told["runs"]] == ["done", "done"]
    assert [len(run["facts"]["faults"]) for run in told["runs"]] == [1, 0]
    part = paired.get("/runs/list", params={"skip": 1, "count": 1}).json()
    assert (part["all"], part["runs"]) == (2, told["runs"][1:])
    assert paired.get("/runs/list", params={"skip": "-1", "count": "x"}).json() == told


@pytest.mark.slow
def test_a_replay_is_made_once_and_comes_in_pieces(paired: httpx.Client, runs: Path) -> None:
    place = f"/runs/0/{CIRCLE}/replay"
    assert paired.get(place).json()["state"] == "none"
    assert until_ready(paired, place) == {"state": "ready", "share": 1.0, "problem": ""}
    index = paired.get(f"{place}/index")
    assert index.headers["content-encoding"] == "gzip"
    assert "default-src 'self'" in index.headers["content-security-policy"]
    assert index.json()["about"]["mission"] == "circle"
    assert paired.get(f"{place}/{len(index.json()['pieces']) - 1}").status_code == 200
    assert paired.get(f"{place}/{len(index.json()['pieces'])}").status_code == 404
    made_at = (runs / CIRCLE / REPLAY / "made.json").stat().st_mtime_ns
    assert paired.post(place).json()["state"] == "ready"
    assert (runs / CIRCLE / REPLAY / "made.json").stat().st_mtime_ns == made_at


@pytest.mark.slow
def test_a_report_is_of_no_origin(paired: httpx.Client) -> None:
    assert until_ready(paired, f"/runs/0/{BROKEN}/report")["state"] == "ready"
    report = paired.get(f"/runs/0/{BROKEN}/report.html")
    policy = report.headers["content-security-policy"]
    assert policy.startswith("sandbox allow-scripts; default-src 'none'")
    assert "DRV-25" in report.text


def test_all_files_of_a_run_come_as_one(paired: httpx.Client, runs: Path) -> None:
    answer = paired.get(f"/runs/0/{BROKEN}/run.zip")
    assert answer.headers["content-disposition"] == f'attachment; filename="{BROKEN}.zip"'
    archive = zipfile.ZipFile(io.BytesIO(answer.content))
    assert archive.testzip() is None
    assert archive.read(f"{BROKEN}/recording.mcap") == (runs / BROKEN / "recording.mcap").read_bytes()


# ---------------------------------------------------------------------------------------------------- the process


@pytest.mark.slow
def test_a_damaged_recording_is_said_and_may_be_tried_again(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "recording.mcap").write_bytes(b"rubbish" * 10)

    async def twice() -> list[str]:
        works, problems = Works(), []
        for _ in range(2):
            making = works.make(REPLAY, folder)
            while making.state in ("waiting", "making"):
                await asyncio.sleep(0.01)
            problems.append(making.problem)
        return problems

    assert asyncio.run(twice()) == ["recording.mcap: not an MCAP file; nothing of a run can be read"] * 2


def _says(monkeypatch: pytest.MonkeyPatch, code: str) -> None:
    """Let other programs stand for the third process."""
    words = [*command("x")[:2], "-c", code]
    monkeypatch.setattr(runs_making, "command", lambda what, *arguments: [*words, *arguments])


def test_a_process_that_fails_is_said_and_the_run_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _says(monkeypatch, "print('said by a library'); raise MemoryError('no room')")

    async def both() -> tuple[str, str]:
        works = Works()
        making = works.make(REPLAY, tmp_path)
        while making.state in ("waiting", "making"):
            await asyncio.sleep(0.01)
        while (facts := works.facts([tmp_path])[0]) is None:
            await asyncio.sleep(0.01)
        return making.problem, facts.problem

    words = "its process ended with status 1: MemoryError: no room"
    assert asyncio.run(both()) == (words, f"it could not be read: {words}")


def test_one_is_made_at_a_time_and_not_too_many_wait(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _says(monkeypatch, "import sys; print('{\"share\":0.5}', flush=True); sys.stdin.read()")

    async def states() -> list[str]:
        works = Works()
        found = [works.make(REPLAY, tmp_path / str(number)) for number in range(MOST_WAITING + 1)]
        assert works.make(REPLAY, tmp_path / "0") is found[0]
        while found[0].share is None:
            await asyncio.sleep(0.01)
        return [making.state for making in found]

    assert asyncio.run(states()) == ["making", *["waiting"] * (MOST_WAITING - 1), "failed"]


def test_a_browser_that_leaves_ends_its_download(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _says(monkeypatch, "import sys\nwhile True: sys.stdout.write('x' * 4096)")

    async def taken() -> tuple[int, bool, bool]:
        works = Works()
        first, second = works.packed(tmp_path), works.packed(tmp_path)
        size = len(await anext(first)) + len(await anext(second))
        full = works.can_pack
        await _closed([first, second])
        return size, full, works.can_pack

    size, full, again = asyncio.run(taken())
    assert (size > 0, full, again) == (True, False, True)


async def _closed(pieces: Sequence[AsyncIterator[bytes]]) -> None:
    for each in pieces:
        await each.aclose()  # type: ignore[attr-defined]


@pytest.mark.slow
def test_the_process_is_nice_and_leaves_with_who_began_it(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "journal.jsonl")  # whoever reads that waits for ever
    worker = subprocess.Popen(command("facts", str(tmp_path)), stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)
    while os.getpriority(os.PRIO_PROCESS, worker.pid) < NICE:
        assert worker.poll() is None
    assert worker.stdin is not None
    worker.stdin.close()
    assert worker.wait(60) == 0


@pytest.mark.slow
@pytest.mark.parametrize("what", [REPLAY, "report"])
def test_two_pages_do_not_make_the_same_at_once(tmp_path: Path, what: str) -> None:
    folder = made(tmp_path, CIRCLE)
    lock = os.open(folder, os.O_RDONLY)
    fcntl.flock(lock, fcntl.LOCK_EX)
    worker = subprocess.Popen(command(what, str(folder)), stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    while not any(
        " -> FLOCK " in line and f" {worker.pid} " in line for line in Path("/proc/locks").read_text().splitlines()
    ):
        assert worker.poll() is None, "it waits"
    if what == REPLAY:
        write_replay(folder, folder / REPLAY)
    else:
        (folder / "report.html").write_text("of the other page")
    by_the_other = _times(folder)
    os.close(lock)
    assert worker.stdout is not None
    said = worker.stdout.read()
    worker.communicate()
    assert (worker.returncode, said) == (0, b'{"share":1.0}\n')
    assert _times(folder) == by_the_other, "it is not made again"


def _times(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in sorted(folder.rglob("*"))}


def test_a_run_that_is_gone_is_said_without_its_place(tmp_path: Path) -> None:
    async def problem() -> str:
        making = Works().make(REPLAY, tmp_path / "gone")
        while making.state in ("waiting", "making"):
            await asyncio.sleep(0.01)
        return making.problem

    assert asyncio.run(problem()) == "gone: No such file or directory"
