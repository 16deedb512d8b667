"""The tab Drives in a real browser."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser import chromium, closed_after, own_key
from page_rig import MISSIONS, PageRig, Recorded, page_rig, recorded
from test_page import opened, until

pytestmark = [pytest.mark.realtime, pytest.mark.timeout(180)]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """A tricycle whose drives have names that say nothing of what they do."""
    folder = tmp_path_factory.mktemp("tricycle")
    (folder / "robots").mkdir()
    head, _, drives = (MISSIONS / "robots/tricycle.yaml").read_text().partition("\ndrives:")
    drives = drives.replace("\n  steering:\n", "\n  front:\n").replace("\n  traction:\n", "\n  steered-wheel:\n")
    (folder / "robots/tricycle.yaml").write_text(f"{head}\ndrives:{drives}")
    shutil.copytree(MISSIONS / "paths", folder / "paths")
    shutil.copy(MISSIONS / "figure_eight_tricycle.yaml", folder)
    return recorded(str(folder / "figure_eight_tricycle.yaml"), 20.0, folder)


@pytest.fixture(scope="module", autouse=True)
def warm(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Drives that measure the temperature of their power stages; computed before the browser's driver is there."""
    return recorded("figure_eight_epos4.yaml", 20.0, tmp_path_factory.mktemp("warm"))


@pytest.fixture
def rig(run: Recorded, tmp_path: Path) -> Iterator[PageRig]:
    with page_rig(run, tmp_path) as made:
        made.show(900)
        yield made


def rows(page: Any) -> dict[str, list[str]]:
    """The text of each drive's cells, by its name."""
    told = page.eval_on_selector_all(
        "#drives tbody tr", "all => all.map(row => [...row.children].map(cell => cell.textContent))"
    )
    return {name.split()[0]: cells for name, *cells in told}


def test_a_drive_has_the_unit_of_what_it_does_whatever_its_name(chromium: Any, rig: PageRig) -> None:
    page = opened(chromium, rig)
    page.click("#tab-drives")
    until(page, "document.querySelectorAll('#drives td.on').length === 2")
    told = rows(page)
    assert told["front"][3].endswith("°")
    assert not page.locator("#drives th.temperature").is_visible(), "these drives do not measure theirs"
    assert told["steered-wheel"][3].endswith(" m")


def test_a_drive_shows_its_temperature_where_that_is_known(chromium: Any, warm: Recorded, tmp_path: Path) -> None:
    with page_rig(warm, tmp_path) as shown:
        shown.show(980)
        page = opened(chromium, shown)
        page.click("#tab-drives")
        until(page, "document.querySelectorAll('#drives td.on').length === 4")
        until(page, "document.querySelector('#drives th.temperature').checkVisibility()")
        assert {cells[2] for cells in rows(page).values()} <= {"25 °C", "26 °C"}
        page.set_viewport_size({"width": 390, "height": 844})
        assert page.locator("#drives th.temperature").is_visible()
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        assert page.troubles == []
