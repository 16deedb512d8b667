"""A real browser: Debian's Chromium, driven by playwright. Tests are skipped with the reason where there is none."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from page_rig import PageRig, Recorded, page_rig, recorded

INSTALL = "scripts/browser"


def missing() -> str:
    """What keeps a browser from being driven; empty: nothing."""
    try:
        import playwright.sync_api
    except ImportError:
        return f"needs the Python package playwright: {INSTALL}"
    return "" if shutil.which("chromium") else f"needs Debian's package chromium: {INSTALL}"


@pytest.fixture(scope="module")
def chromium(run: Recorded) -> Iterator[Any]:
    """A browser without a window.

    While playwright is there, its loop runs in this thread: the run is over before, and other modules come after.
    """
    if reason := missing():
        pytest.skip(reason)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.fixture(autouse=True)
def own_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """A figure eight."""
    return recorded("figure_eight.yaml", 20.0, tmp_path_factory.mktemp("runs"))


@pytest.fixture(autouse=True)
def closed_after(request: pytest.FixtureRequest) -> Iterator[None]:
    """No page of one test is open in the next."""
    yield
    if "chromium" in request.fixturenames:
        for context in request.getfixturevalue("chromium").contexts:
            context.close()


@pytest.fixture
def rig(run: Recorded, tmp_path: Path) -> Iterator[PageRig]:
    """The page of that run, while it follows its path."""
    with page_rig(run, tmp_path) as made:
        made.show(900)
        yield made
