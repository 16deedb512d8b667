"""Take the pictures of the page for operators, in a real browser, from simulated runs: `make page-pictures`.

Needs what `scripts/browser` installs.
"""

from __future__ import annotations

import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1] / "tests"))

from page_rig import MISSIONS, PageRig, page_rig, recorded  # noqa: E402

from artemis.values import Mode, Tick  # noqa: E402
from artemis_lab.bench.ports import free_port  # noqa: E402

PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True, "device_scale_factor": 2}
DESKTOP = {"viewport": {"width": 1280, "height": 800}}
HALL, LOOP, FAULT, GOAL = "patrol_hall.yaml", "figure_eight.yaml", "fault_recovery_by_hand.yaml", "page_goto.yaml"
EPOS4 = "figure_eight_epos4.yaml"
UNTIL = {HALL: 45.0, LOOP: 40.0, FAULT: 25.0, GOAL: 12.0, EPOS4: 35.0}
"""Seconds of each run."""
REPLAYED = "Boolean(window.artemis?.shown) && document.getElementById('making').hidden"
MOVING = 22.0, 45.0, 0.5, 120
"""The moving picture: begin and end in the run, time from picture to picture [s], and each is shown so long [ms]."""


def at(time: float) -> Callable[[Tick], bool]:
    """The tick at a run time [s]."""
    return lambda tick: tick.snapshot.time >= time


@contextmanager
def shown(mission: str, wanted: Callable[[Tick], bool], home: Path) -> Iterator[PageRig]:
    """The page of a run, at the first tick that is as wanted."""
    run = recorded(mission, UNTIL[Path(mission).name], home)
    with page_rig(run, home) as rig:
        rig.show(run.at(wanted))
        yield rig


def opened(browser: Any, rig: PageRig, options: Mapping[str, Any], scheme: str = "light") -> Any:  # noqa: ANN401 (of playwright)
    """A paired page that shows it."""
    page = browser.new_context(color_scheme=scheme, **options).new_page()
    page.set_default_timeout(120_000)
    page.goto(rig.pairing())
    page.wait_for_url(f"{rig.url}/")
    page.wait_for_selector("body[data-link=ok]")
    until(page, "artemis.control.trip !== null && Boolean(artemis.state)")
    return page


def until(page: Any, wanted: str) -> None:  # noqa: ANN401
    """Wait: the page's content policy keeps playwright's own way of waiting out."""
    for _ in range(120 * 20):
        if page.evaluate(wanted):
            return
        page.wait_for_timeout(50)
    raise TimeoutError(wanted)


def take_control(page: Any, *, hold: bool) -> None:  # noqa: ANN401
    """Take control, where nobody has it any more; and hold the stick."""
    until(page, "document.getElementById('seat').textContent === 'No operator has control.'")
    page.click("#take")
    until(page, "artemis.control.mine")
    page.wait_for_selector("#stick", state="visible")
    box = page.locator("#stick").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    while hold and not page.evaluate("artemis.hand().held"):
        page.mouse.up()
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x - 34, y - 50, steps=3)


def picture(page: Any, name: str) -> None:  # noqa: ANN401
    """Keep what is seen."""
    page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    page.screenshot(path=HERE / f"page_{name}.png")


def moving_picture(browser: Any, home: Path) -> None:  # noqa: ANN401
    """Keep what the page shows of some seconds, about four times as fast."""
    begin, end, step, duration = MOVING
    with shown(HALL, at(begin), home) as rig:
        page = opened(browser, rig, {"viewport": {"width": 960, "height": 600}})
        take_control(page, hold=False)
        pictures = []
        for number in range(round((end - begin) / step)):
            place = rig.run.at(at(begin + number * step))
            rig.show(place)
            until(page, f"artemis.state.n >= {rig.run.ticks[place - 1][0].snapshot.sensed.index}")
            page.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
            pictures.append(Image.open(io.BytesIO(page.screenshot())).convert("RGB"))
    palette = pictures[0].quantize(64)
    first, *others = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in pictures]
    first.save(HERE / "page.gif", save_all=True, append_images=others, duration=duration, loop=0, optimize=True)


def take(browser: Any, home: Path) -> None:  # noqa: ANN401
    """All of them."""
    with shown(HALL, at(40.0), home) as rig:
        page = opened(browser, rig, DESKTOP)
        take_control(page, hold=False)
        picture(page, "desktop")
        page.context.close()
        page = opened(browser, rig, PHONE)
        take_control(page, hold=True)
        picture(page, "phone")
    with shown(LOOP, at(39.0), home) as rig:
        page = opened(browser, rig, DESKTOP, "dark")
        page.click("#tab-charts")
        page.wait_for_selector("#charts .uplot canvas")
        page.wait_for_timeout(700)
        picture(page, "charts")
    with shown(EPOS4, at(34.0), home) as rig:
        page = opened(browser, rig, DESKTOP)
        page.click("#tab-drives")
        page.click("#signs summary")
        until(page, "document.querySelector('#drives th.temperature').checkVisibility()")
        picture(page, "drives")
    zones = home / "missions/maps/hall.zones.yaml"
    zones.write_text("zones:\n- {name: loading bay, kind: keep-out, corners: [[9, 4.5], [12, 4.5], [12, 7], [9, 7]]}\n")
    with shown(str(home / "missions" / GOAL), at(11.0), home) as rig:
        page = opened(browser, rig, DESKTOP)
        take_control(page, hold=False)
        page.click("#tab-zones")
        page.click("#tool-goal")
        for name, number in (("x", "3"), ("y", "-1"), ("heading", "30")):
            page.fill(f"#act-{name}", number)
        picture(page, "acts")
    with shown(FAULT, lambda tick: tick.mode is Mode.FAULT and "acknowledge" in tick.wish.phase, home) as rig:
        page = opened(browser, rig, DESKTOP)
        take_control(page, hold=False)
        page.click("#tab-faults")
        picture(page, "fault")


def take_waiting(browser: Any, home: Path) -> None:  # noqa: ANN401
    """The page of a robot that waits, with a mission of each kind."""
    missions, folder = HERE.parents[1] / "missions", home / "waiting/missions"
    for part in ("robots", "paths", "maps"):
        shutil.copytree(missions / part, folder / part)
    for name in (LOOP, "page_teleop.yaml", "figure_eight_socketcan.yaml"):
        shutil.copy(missions / name, folder)
    broken = (missions / LOOP).read_text().replace("figure-eight", "figure-eight-fast").replace("0.2}", "5.0}")
    (folder / "figure_eight_fast.yaml").write_text(broken.replace("at 0.2 m/s", "at 5 m/s"))
    command = [sys.executable, "-m", "artemis", "page", str(folder), "--page-port", str(free_port())]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as serving:
        assert serving.stdout is not None
        (address,) = re.findall(r"http\S+#\w+", serving.stdout.readline())
        page = browser.new_context(**DESKTOP).new_page()
        page.set_default_timeout(120_000)
        page.goto(address)
        page.wait_for_selector("body.waiting[data-link=ok]")
        page.click("#take")
        page.wait_for_selector("body.mine")
        until(page, "document.querySelectorAll('.mission').length === 4 && !document.querySelector('.mission.unknown')")
        picture(page, "waiting")
        serving.terminate()


def take_past(browser: Any, home: Path) -> None:  # noqa: ANN401
    """Those of past runs: the list, and a replay of two over each other."""
    run = recorded(LOOP, UNTIL[LOOP], home)
    with page_rig(run, home, runs=home) as rig:
        rig.show(100)
        page = opened(browser, rig, DESKTOP)
        page.goto(f"{rig.url}/runs/")
        until(page, f"document.querySelectorAll('.run dl').length === {len(UNTIL) + 1}")
        picture(page, "runs")
        newest = [row.get_attribute("data-run") for row in page.locator(".run").all()]
        hall = next(name for name in newest if "patrol" in name)
        fault = next(name for name in newest if "fault" in name)
        whole, part = [name for name in newest if name.endswith("figure-eight")]
        page.goto(f"{rig.url}/runs/replay?run={hall}&at=36")
        until(page, REPLAYED)
        picture(page, "replay")
        page.goto(f"{rig.url}/runs/replay?run={whole}&with={part}&at=30")
        until(page, f"{REPLAYED} && Boolean(artemis.beside?.state)")
        picture(page, "replay_two")
        page = opened(browser, rig, PHONE)
        page.goto(f"{rig.url}/runs/replay?run={fault}&at=16")
        until(page, REPLAYED)
        page.click("#fault-before")
        picture(page, "replay_phone")


def main() -> None:
    """Compute the runs, then show them: the browser's driver has a loop of its own in this thread."""
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        os.environ["XDG_CONFIG_HOME"] = folder
        shutil.copytree(MISSIONS, home / "missions", ignore=shutil.ignore_patterns("runs"))
        for mission, until in UNTIL.items():
            recorded(str(home / "missions" / mission) if mission == GOAL else mission, until, home)
        recorded(LOOP, 200.0, home)  # to its end
        with sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
            if "past" not in sys.argv:
                take_waiting(browser, home)
                take(browser, home)
                moving_picture(browser, home)
            take_past(browser, home)
            browser.close()


if __name__ == "__main__":
    main()
