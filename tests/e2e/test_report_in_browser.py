"""The page of a run in a real browser, as a person uses it: Debian's chromium, where it is installed."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import zlib
from pathlib import Path
from typing import Any

import pytest
from command_line import PATIENCE

sys.path.append(str(Path(__file__).parents[1] / "unit"))
import synthetic_run

from artemis.recording.mcap_reader import Recording
from artemis.report.page import write_report

CHROMIUM = shutil.which("chromium")
pytestmark = [
    pytest.mark.exhaustive,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Debian's chromium and fonts-dejavu-core"),
]
BY_HAND = """
<script>
addEventListener("load", () => {
  const overs = [...document.querySelectorAll(".u-over")], told = {};
  const at = (over, kind, share) => {
    const box = over.getBoundingClientRect();
    const where = { clientX: box.left + share * box.width, clientY: box.top + 50, bubbles: true, movementX: 9 };
    (kind === "mouseup" ? document : over).dispatchEvent(new MouseEvent(kind, where));
  };
  const numbers = () => [...document.querySelectorAll(".u-series:not(:first-child) .u-value")]
    .map((cell) => cell.textContent).filter(Boolean).length;
  const settled = () => new Promise((done) => setTimeout(done, 50));
  (async () => {
    const chart = overs[1];
    told.before = numbers();
    for (const over of overs) at(over, "mouseenter", 0.5);
    at(chart, "mousemove", 0.5);
    await settled();
    told.readout = document.getElementById("readout").textContent;
    told.values = numbers();
    told.arrow = getComputedStyle(document.querySelector(".map .here")).display;
    for (const [kind, share] of [["down", 0.5], ["move", 0.6], ["move", 0.75], ["up", 0.75]]) {
      at(chart, `mouse${kind}`, share);
      await settled();
    }
    at(chart, "mousemove", 0.5);
    await settled();
    told.zoomed = document.getElementById("readout").textContent;
    at(chart, "dblclick", 0.5);
    await settled();
    at(chart, "mousemove", 0.5);
    await settled();
    told.reset = document.getElementById("readout").textContent;
    told.charts = document.querySelectorAll(".plot canvas").length;
    told.unscripted = document.getElementById("unscripted") !== null;
    told.wide = document.documentElement.scrollWidth > document.documentElement.clientWidth;
    const result = document.createElement("pre");
    result.id = "told";
    result.textContent = JSON.stringify(told);
    document.body.append(result);
  })();
});
</script>
"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    path = synthetic_run.record(folder / "recording.mcap", synthetic_run.run(hz=10.0, fault_at=20.0))
    write_report(Recording(path), folder / "report.html")
    return folder / "report.html"


def chromium(page: Path, *options: str) -> tuple[str, list[str]]:
    """What it prints, and what its console says."""
    words = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--virtual-time-budget=5000"]
    command = [str(CHROMIUM), *words, f"--user-data-dir={page.parent / 'profile'}", *options, page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=True)
    return done.stdout, re.findall(r"CONSOLE.*", done.stderr)


def used(page: Path, *options: str) -> Any:  # noqa: ANN401  JSON
    """What the page shows while a person points, drags and clicks."""
    copy = page.with_name("used.html")
    html = re.sub(r"script-src '[^']*'", "script-src 'unsafe-inline'", page.read_text())
    copy.write_text(html.replace("</body>", f"{BY_HAND}</body>"))
    shown, said = chromium(copy, "--dump-dom", *options)
    assert said == []
    return json.loads(re.findall(r'<pre id="told">(.*?)</pre>', shown)[0])


@pytest.mark.parametrize("width", [1200, 500])
def test_one_cursor_and_one_zoom_for_all_charts(page: Path, width: int) -> None:
    told = used(page, f"--window-size={width},900")

    assert told["charts"] == 8
    assert not told["unscripted"]
    assert not told["wide"], "the page would have to be moved to the side"
    assert told["before"] == 0
    time, zoomed, reset = (float(told[name].split(" s")[0]) for name in ("readout", "zoomed", "reset"))
    assert time == pytest.approx(10.5, abs=0.2), "the middle of the run"
    assert told["readout"].endswith("robot follow · drives operation enable")
    assert told["values"] == 11, "every line over time has a value"
    assert told["arrow"] == "inline"
    assert zoomed == pytest.approx(10.5 * 1.25, abs=0.4), "the middle of the third quarter"
    assert reset == pytest.approx(time, abs=0.01)


def test_a_page_opens_without_complaint_and_prints_its_charts(page: Path) -> None:
    shown, said = chromium(page, "--dump-dom")
    assert said == []
    assert shown.count("<canvas") == 8
    chromium(page, f"--print-to-pdf={page.with_suffix('.pdf')}")
    streams = re.findall(rb"FlateDecode.*?stream\r?\n(.*?)endstream", page.with_suffix(".pdf").read_bytes(), re.DOTALL)
    drawn = b"".join(zlib.decompressobj().decompress(stream) for stream in streams)
    lines = len(re.findall(rb"^[-.0-9]+ [-.0-9]+ l$", drawn, re.MULTILINE))
    assert lines > 1500, "the map alone has a third of them"
