"""Past runs for browsers that have paired: their list, what is made of one on request, and all of its files."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec
from starlette.requests import HTTPConnection, Request
from starlette.responses import JSONResponse, RedirectResponse, Response, StreamingResponse
from starlette.routing import Mount, Route

from artemis.page.paired import HEADERS, file_answer
from artemis.page.runs import REPLAY, find, runs_of
from artemis.page.runs_making import Making, Works
from artemis.recording.run_folder import RunFolder

ON_A_PAGE, MOST_ON_A_PAGE = 40, 100
"""Runs of the list in one answer."""
REPORT = "report"
REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
"""A report has its script inside, named by its digest in a policy of its own. Here it is of no origin: it has no
cookie, and asks nobody for anything."""
_WORKS = (REPORT, REPLAY)

Answer = Callable[[Request], Any]


class PastRuns:
    """Routes of the page's server, all of them below `/runs`."""

    def __init__(self, roots: Sequence[Path], is_paired: Callable[[HTTPConnection], bool]) -> None:
        """Begin.

        Args:
            roots: folders with runs; each is known by its number.
            is_paired: whether a browser may see them.
        """
        self._roots, self._is_paired = tuple(roots), is_paired
        self._works: Works | None = None
        one = "/{root}/{name}"
        self.routes = Mount(
            "/runs",
            routes=[
                Route("/", self._own("runs.html")),
                Route("/replay", self._own("runs_replay.html")),
                Route("/list", self._list),
                Route(one + "/run.zip", self._archive),
                Route(one + "/report.html", self._report),
                Route(one + "/replay/{file}", self._piece),
                Route(one + "/{what}", self._state, methods=["GET", "POST"]),
            ],
        )

    @property
    def works(self) -> Works:
        """What is being made; started by a request."""
        if self._works is None:
            self._works = Works()
        return self._works

    def _own(self, name: str) -> Answer:
        async def answer(request: Request) -> Response:
            if not self._is_paired(request):
                return RedirectResponse("/pair", 303, HEADERS)
            return file_answer(request, name)

        return answer

    def _json(self, content: object, status: int = 200) -> Response:
        headers = {**HEADERS, "Cache-Control": "no-store"}
        return Response(msgspec.json.encode(content), status, headers, media_type="application/json")

    async def _list(self, request: Request) -> Response:
        """Some of the runs, the newest first: `skip` of them, then `count`."""
        if not self._is_paired(request):
            return self._json({}, 403)
        skip = _number(request.query_params.get("skip"), 0, 1 << 20)
        count = _number(request.query_params.get("count"), ON_A_PAGE, MOST_ON_A_PAGE)
        found = [
            (name, root) for root, folder in enumerate(self._roots) for name in await asyncio.to_thread(runs_of, folder)
        ]
        shown = sorted(found, reverse=True)[skip : skip + count]
        facts = self.works.facts([self._roots[root] / name for name, root in shown])
        runs = [
            {"id": f"{root}/{name}", "name": name, "facts": known}
            for (name, root), known in zip(shown, facts, strict=True)
        ]
        return self._json({"all": len(found), "runs": runs})

    def _run(self, request: Request) -> Path | None:
        """The folder that a request is about, if the client may see it."""
        if not self._is_paired(request):
            return None
        return find(self._roots, request.path_params["root"], request.path_params["name"])

    def _none(self, request: Request) -> Response:
        return self._json({}, 404 if self._is_paired(request) else 403)

    async def _state(self, request: Request) -> Response:
        """How far the report or the replay is; POST: have it made."""
        what, folder = request.path_params["what"], self._run(request)
        if folder is None or what not in _WORKS:
            return self._none(request)
        if request.method == "POST":
            return self._json(self.works.make(what, folder))
        return self._json(self.works.state(what, folder) or Making("none"))

    async def _report(self, request: Request) -> Response:
        if (folder := self._run(request)) is None:
            return self._none(request)
        content = await asyncio.to_thread(_content, RunFolder(path=folder).report)
        if content is None:
            return self._none(request)
        headers = {**HEADERS, "Content-Security-Policy": REPORT_POLICY, "Cache-Control": "no-cache"}
        return Response(content, headers=headers, media_type="text/html")

    async def _piece(self, request: Request) -> Response:
        """One of the files that a replay is made from; they are packed as browsers take it."""
        folder, file = self._run(request), request.path_params["file"]
        if folder is None or not (file in ("index", "map") or (file.isascii() and file.isdecimal())):
            return self._none(request)
        content = await asyncio.to_thread(_content, folder / REPLAY / f"{file}.json.gz")
        if content is None:
            return self._none(request)
        headers = {**HEADERS, "Cache-Control": "no-cache", "Content-Encoding": "gzip"}
        return Response(content, headers=headers, media_type="application/json")

    async def _archive(self, request: Request) -> Response:
        if (folder := self._run(request)) is None:
            return self._none(request)
        works = self.works
        if not works.can_pack:
            return JSONResponse({"problem": "others download runs now: try again later"}, 503, HEADERS)
        plain = re.sub(r"[^A-Za-z0-9_.-]", "_", folder.name)
        headers = {**HEADERS, "Content-Disposition": f'attachment; filename="{plain}.zip"'}
        return StreamingResponse(works.packed(folder), headers=headers, media_type="application/zip")


def _number(text: str | None, otherwise: int, most: int) -> int:
    return min(int(text), most) if text is not None and re.fullmatch("[0-9]{1,9}", text) else otherwise


def _content(file: Path) -> bytes | None:
    try:
        return None if file.is_symlink() else file.read_bytes()
    except OSError:
        return None
