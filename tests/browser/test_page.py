"""The page in a real browser: who is let in, what is shown, what drives the robot, and what stops it."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from typing import Any

import pytest
from browser import chromium, closed_after, own_key, rig, run
from page_rig import PageRig

from artemis.bridges.page.session import FRESH
from artemis.values import OperatorInput, Request

pytestmark = pytest.mark.realtime
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True, "device_scale_factor": 2}
TAKES = 30_000
"""Milliseconds for anything on a busy computer."""


def opened(chromium: Any, rig: PageRig, **options: Any) -> Any:
    """A browser that is paired, at the page."""
    context = chromium.new_context(**options)
    context.set_default_timeout(TAKES)
    page = context.new_page()
    page.troubles = []
    page.on("pageerror", lambda error: page.troubles.append(str(error)))
    page.on("console", lambda said: page.troubles.append(said.text) if said.type == "error" else None)
    page.goto(rig.pairing())
    page.wait_for_url(f"{rig.url}/")
    page.wait_for_selector("body[data-link=ok]")
    return page


def in_control(chromium: Any, rig: PageRig, **options: Any) -> Any:
    page = opened(chromium, rig, **options)
    page.click("#take")
    page.wait_for_selector("#hand", state="attached")
    page.wait_for_selector("#stick", state="visible")
    return page


def until(page: Any, wanted: str, takes: int = TAKES) -> None:
    """Wait for so long [ms]: the page's content policy keeps playwright's own way of waiting out."""
    for _ in range(takes // 50):
        if page.evaluate(wanted):
            return
        page.wait_for_timeout(50)
    raise AssertionError(wanted)


def middle(page: Any, selector: str) -> tuple[float, float]:
    box = page.locator(selector).bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def held(rig: PageRig, press: Callable[[], None], let_go: Callable[[], None]) -> OperatorInput:
    """Press until it counts: on a busy computer a page may be held up, and has to be released then."""
    for _ in range(20):
        press()
        try:
            return rig.wait(lambda sample: sample.enabled, 3.0)
        except TimeoutError:
            let_go()
            rig.wait(lambda sample: sample.neutral)  # as a hand does, which presses again later
    raise AssertionError("it never counted")


class Mouse:
    """Holds the stick forward and to the left."""

    def __init__(self, page: Any) -> None:
        self._page = page

    def press(self) -> None:
        x, y = middle(self._page, "#stick")
        self._page.mouse.move(x, y)
        self._page.mouse.down()
        self._page.mouse.move(x - 40, y - 60, steps=3)

    def let_go(self) -> None:
        self._page.mouse.up()


class Finger:
    """Likewise on a touch screen."""

    def __init__(self, page: Any) -> None:
        self._cdp, self._page = page.context.new_cdp_session(page), page

    def _touch(self, kind: str, *points: dict[str, float]) -> None:
        self._cdp.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": list(points)})

    def press(self) -> None:
        x, y = middle(self._page, "#stick")
        self._touch("touchStart", {"x": x, "y": y})
        self._touch("touchMove", {"x": x - 40, "y": y - 60})

    def let_go(self) -> None:
        self._touch("touchEnd")

    def cancel(self) -> None:
        self._touch("touchCancel")


# ---------------------------------------------------------------------------------------------------- pairing


def test_a_browser_is_paired_by_a_code_that_is_good_once(chromium: Any, rig: PageRig) -> None:
    address = rig.pairing()
    context = chromium.new_context()
    page = context.new_page()
    page.goto(rig.url)
    assert page.url == f"{rig.url}/pair"
    page.fill("#code", "abcd-efgh")
    page.click("button")
    until(page, "document.getElementById('said').textContent.includes('wrong')")
    page.goto(address)
    page.wait_for_url(f"{rig.url}/")
    (cookie,) = context.cookies()
    assert (cookie["httpOnly"], cookie["sameSite"]) == (True, "Strict")
    assert "#" not in page.evaluate("history.length && location.href")
    other = chromium.new_context().new_page()
    other.goto(address)
    until(other, "document.getElementById('said').textContent.includes('used already')")


def test_nothing_is_asked_of_other_computers(chromium: Any, rig: PageRig) -> None:
    context = chromium.new_context()
    page = context.new_page()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    errors: list[str] = []
    page.on("console", lambda said: errors.append(said.text) if said.type == "error" else None)
    page.goto(rig.pairing())
    page.wait_for_url(f"{rig.url}/")
    page.wait_for_selector("body[data-link=ok]")
    for tab in ("charts", "log", "drives", "more"):
        page.click(f"#tab-{tab}")
    page.click("#invite")
    page.wait_for_selector("#qr", state="visible")
    assert all(url.startswith(rig.url) for url in asked)
    assert errors == []


# ---------------------------------------------------------------------------------------------------- what it shows


def test_what_the_robot_does_is_shown(chromium: Any, rig: PageRig) -> None:
    page = opened(chromium, rig)
    assert page.inner_text("#robot") == "ARTEMIS"
    page.wait_for_selector("#mode-name[data-mode=follow]")
    assert "of the path" in page.inner_text("#phase")
    assert "m/s" in page.inner_text("#speed")
    assert page.inner_text("#steps [aria-current=step] > .step") == "follow paths/figure_eight.csv"
    until(page, "/^1x · [0-9]+ s$/.test(document.querySelector('#steps [aria-current=step] > .ran').textContent)")
    assert page.inner_text("#steps li > .ran").endswith(" · done")
    assert page.inner_text("#before") == "before: calibrate steering: done"
    page.click("#tab-drives")
    until(page, "document.querySelectorAll('#drives td.on').length === 4")
    page.click("#tab-charts")
    page.wait_for_selector("#charts .uplot canvas")
    assert page.locator("#charts figure").count() >= 4
    page.click("#tab-log")
    assert "ready -> follow" in page.inner_text("#log")
    frames = "import('/static/map.js').then(map => map.drawn.frames)"
    assert page.evaluate(frames) > 0
    assert page.troubles == []


def test_a_fault_that_comes_again_does_not_take_the_view(chromium: Any, rig: PageRig) -> None:
    page = opened(chromium, rig)

    def show(*devices: str) -> None:
        words = {"id": "DRV-25", "severity": 4, "text": "cannot follow", "look": "", "artemis": "", "next": ""}
        faults = [{**words, "device": device} for device in devices]
        page.evaluate("faults => import('/static/panels.js').then(panels => panels.showFaults(faults))", faults)

    def selected() -> str:
        return str(page.get_attribute("[role=tab][aria-selected=true]", "id"))

    show("steer-left")
    assert selected() == "tab-faults"
    page.click("#tab-charts")
    show()
    show("steer-left")
    assert selected() == "tab-charts"
    assert "quick stop: DRV-25" in page.text_content("#announce")
    show("steer-left", "steer-right")
    assert selected() == "tab-faults"


def test_a_page_that_hears_nothing_says_so_and_still_stops(chromium: Any, rig: PageRig) -> None:
    page = opened(chromium, rig)
    rig.reading = False  # the run hangs: no tick comes
    page.wait_for_selector("body[data-link=slow]")
    assert "no state for" in page.inner_text("#link")
    page.click("#stop")
    rig.wait(lambda sample: Request.QUICKSTOP in sample.requests)
    assert any(row == "NET-11" for row, _ in rig.problems())


# ---------------------------------------------------------------------------------------------------- driving


def test_the_stick_drives_by_touch_while_it_is_held(chromium: Any, rig: PageRig) -> None:
    page = in_control(chromium, rig, **PHONE)
    finger = Finger(page)
    held(rig, finger.press, finger.let_go)
    rig.wait(lambda sample: sample.enabled and sample.speed > 0 and sample.steering > 0)  # forward, left
    finger.let_go()
    rig.wait(lambda sample: not sample.enabled and sample.neutral)


def test_the_arrow_keys_drive_while_they_are_held(chromium: Any, rig: PageRig) -> None:
    page = in_control(chromium, rig)
    held(rig, lambda: page.keyboard.down("ArrowUp"), lambda: page.keyboard.up("ArrowUp"))
    page.keyboard.down("ArrowRight")
    rig.wait(lambda sample: sample.enabled and sample.speed > 0 and sample.steering < 0)
    page.keyboard.up("ArrowRight")
    page.keyboard.up("ArrowUp")
    rig.wait(lambda sample: not sample.enabled and sample.neutral)


def test_a_hand_that_lets_go_is_told_of_at_once(chromium: Any, rig: PageRig) -> None:
    page = in_control(chromium, rig)
    page.evaluate(
        """() => {
            const send = WebSocket.prototype.send;
            WebSocket.prototype.send = function (text) {
                window.told?.push(JSON.parse(text).held);
                send.call(this, text);
            };
            window.pressed = () => { // no timer can fire meanwhile
                window.told = [];
                for (const kind of ['keydown', 'keyup'])
                    window.dispatchEvent(new KeyboardEvent(kind, {key: 'ArrowUp'}));
                return String(window.told);
            };
        }"""
    )
    until(page, "pressed() === 'true,false'")  # not where the page was held up before


def test_what_is_asked_for_needs_control_and_ending_needs_two_presses(chromium: Any, rig: PageRig) -> None:
    page = opened(chromium, rig)
    assert page.locator("[data-ask]:disabled").count() == 5
    page.click("#take")
    page.click("[data-ask=arm]")
    rig.wait(lambda sample: Request.ARM in sample.requests)
    page.click("[data-ask=end]")
    assert page.inner_text("[data-ask=end]") == "Press again to end"
    page.click("[data-ask=end]")
    rig.wait(lambda sample: Request.END in sample.requests)


# ---------------------------------------------------------------------------------------------------- losses


def blurs(page: Any, hand: Any) -> None:
    page.evaluate("window.dispatchEvent(new Event('blur'))")


def leaves(page: Any, hand: Any) -> None:
    page.goto("about:blank")


def closes(page: Any, hand: Any) -> None:
    page.close()


def renderers(page: Any) -> list[int]:
    """The processes of a browser's pages."""
    about = page.context.browser.new_browser_cdp_session().send("SystemInfo.getProcessInfo")
    return [process["id"] for process in about["processInfo"] if process["type"] == "renderer"]


def freezes(page: Any, hand: Any) -> None:
    page.frozen = renderers(page)
    for process in page.frozen:
        os.kill(process, signal.SIGSTOP)


def dies(page: Any, hand: Any) -> None:
    for process in renderers(page):
        os.kill(process, signal.SIGKILL)


def is_blocked(page: Any, hand: Any) -> None:
    page.evaluate("() => { const end = performance.now() + 1500; while (performance.now() < end); }")


def is_offline(page: Any, hand: Any) -> None:
    page.context.set_offline(True)


def is_cancelled(page: Any, hand: Any) -> None:
    hand.cancel()


LOSSES: dict[str, Callable[[Any, Any], None]] = {
    "the touch is interrupted": is_cancelled,
    "the window loses the focus": blurs,
    "the page is left": leaves,
    "the tab is closed": closes,
    "the page is frozen": freezes,
    "the page is blocked": is_blocked,
    "the browser dies": dies,
    "the browser is offline": is_offline,
}
WELL_WITHIN = 1.0
"""A loss has to stop the robot within 0.35 s; that it took longer than this [s] is no matter of a busy machine."""


@pytest.mark.parametrize("loss", list(LOSSES))
def test_the_robot_stops_when(loss: str, chromium: Any, rig: PageRig) -> None:
    """No sample ever drives that is older than the input's limit, and none does after the loss was noticed."""
    event = LOSSES[loss]
    page = in_control(chromium, rig, **PHONE)
    hand = Finger(page)
    held(rig, hand.press, hand.let_go)
    begun = rig.now()
    try:
        event(page, hand)
        rig.wait(lambda sample: not sample.enabled)
    finally:
        for process in getattr(page, "frozen", []):
            os.kill(process, signal.SIGCONT)
    assert rig.note(loss, begun) < WELL_WITHIN
    assert all((sample.age or 0.0) <= FRESH for _, sample, _ in rig.samples if sample.enabled)
    if loss in (
        "the browser is offline",
        "the page is blocked",
        "the window loses the focus",
        "the touch is interrupted",
    ):
        since = len(rig.samples)
        rig.wait(lambda _: len(rig.samples) > since + 40)
        assert not any(sample.enabled for _, sample, _ in rig.samples[since:]), "it is still held: press again"


# ---------------------------------------------------------------------------------------------------- two of them


def test_two_browsers_one_has_control_and_both_stop(chromium: Any, rig: PageRig) -> None:
    first, second = in_control(chromium, rig), opened(chromium, rig)
    until(second, "document.getElementById('seat').textContent.includes('has control')")
    second.click("#take")
    until(second, "document.getElementById('seat').textContent.includes('Refused')")
    assert not second.locator("#hand").is_visible()
    mouse = Mouse(first)
    held(rig, mouse.press, mouse.let_go)
    second.click("#stop")
    rig.wait(lambda sample: Request.QUICKSTOP in sample.requests)
    requests = [request for _, sample, _ in rig.samples for request in sample.requests]
    assert requests.count(Request.QUICKSTOP) == 1, "by two ways, once"
    mouse.let_go()
    first.click("#give")
    second.click("#take")
    second.wait_for_selector("#stick", state="visible")


def test_the_way_of_commands_is_lost_and_stop_still_goes(chromium: Any, rig: PageRig) -> None:
    page = opened(chromium, rig)
    page.evaluate("() => { WebSocket.prototype.send = () => { throw new Error('gone'); }; }")
    page.click("#stop")
    rig.wait(lambda sample: Request.QUICKSTOP in sample.requests)


def test_what_was_asked_for_and_could_not_be_sent_is_forgotten(chromium: Any, rig: PageRig) -> None:
    page = in_control(chromium, rig)
    page.evaluate(
        "() => { const send = WebSocket.prototype.send; window.mend = () => { WebSocket.prototype.send = send; };"
        " WebSocket.prototype.send = () => { throw new Error('gone'); }; }"
    )
    page.click("[data-ask=arm]")
    page.wait_for_selector("#take", state="visible")  # nothing was heard of it for a second
    page.evaluate("window.mend()")
    since = len(rig.samples)
    page.click("#take")
    rig.wait(lambda _: any(sample.neutral for _, sample, _ in rig.samples[since:]))
    rig.wait(lambda _: len(rig.samples) > since + 40)
    assert not any(sample.requests for _, sample, _ in rig.samples)


# ---------------------------------------------------------------------------------------------------- people


def test_on_a_phone_thumbs_hide_neither_stick_nor_stop(chromium: Any, rig: PageRig) -> None:
    page = in_control(chromium, rig, **PHONE)
    boxes = {name: page.locator(f"#{name}").bounding_box() for name in ("stop", "wish", "stick", "knob", "map")}
    stop, wish, stick, knob, map = boxes.values()
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert page.evaluate("scrollY") == 0
    for box in boxes.values():
        assert 0 <= box["x"]
        assert box["x"] + box["width"] <= 390
        assert 0 <= box["y"]
    assert stick["y"] + stick["height"] <= 844, "all without scrolling"
    assert wish["y"] + wish["height"] <= stick["y"], "what is wished is read above the thumb"
    assert stop["y"] + stop["height"] <= map["y"] + 1 <= stick["y"], "Stop is not under the thumb that drives"
    assert knob["width"] >= 80, "wider than a thumb"
    finger = Finger(page)
    held(rig, finger.press, finger.let_go)
    assert page.locator("#stick").bounding_box() == stick, "it stays where it is while it is held"
    finger.let_go()


OVERLAPS = """(() => {
  const shown = [...document.querySelectorAll('#drive button, #stick, #range-box, #stop, #tabs, #map-box')];
  const visible = shown.filter(each => each.checkVisibility());
  const boxes = visible.map(each => [each.id || each.textContent, each.getBoundingClientRect()]);
  return boxes.flatMap(([name, a], index) => boxes.slice(index + 1).filter(([, b]) =>
    a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1
  ).map(([other]) => [name, other]));
})()"""


@pytest.mark.parametrize(("width", "height"), [(320, 568), (360, 740), (667, 375), (844, 390)])
def test_on_phones_of_all_sizes_nothing_covers_anything(width: int, height: int, chromium: Any, rig: PageRig) -> None:
    page = in_control(chromium, rig, **{**PHONE, "viewport": {"width": width, "height": height}})
    page.evaluate("scrollTo(0, 0)")
    assert page.evaluate(OVERLAPS) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    stick, stop = (page.locator(name).bounding_box() for name in ("#stick", "#stop"))
    assert stick["x"] + stick["width"] <= width
    assert stop["x"] + stop["width"] <= width
    assert stick["y"] + stick["height"] <= height or height < 2 * width < 3 * height, "all without scrolling"
    assert min(stick["width"], stick["height"]) >= 150
    page.click("#tab-drives")
    table, panel = (page.locator(name).bounding_box() for name in ("#drives table", "#drives"))
    assert table["width"] <= panel["width"], "no column is cut"


def test_by_the_keyboard_alone(chromium: Any, rig: PageRig) -> None:
    page = opened(chromium, rig)
    for _ in range(30):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.id") == "take":
            break
    page.keyboard.press("Enter")
    page.wait_for_selector("#stick", state="visible")
    held(rig, lambda: page.keyboard.down("ArrowDown"), lambda: page.keyboard.up("ArrowDown"))
    rig.wait(lambda sample: sample.enabled and sample.speed < 0)
    page.keyboard.press("Escape")
    rig.wait(lambda sample: Request.QUICKSTOP in sample.requests)
    rig.wait(lambda sample: not sample.enabled)
    page.keyboard.up("ArrowDown")
    page.focus("#tab-steps")
    page.keyboard.press("ArrowRight")
    assert page.evaluate("document.activeElement.id") == "tab-charts"
    assert page.locator("#charts").is_visible()


def test_everything_has_a_name_for_a_screen_reader(chromium: Any, rig: PageRig) -> None:
    page = in_control(chromium, rig)
    tree = page.context.new_cdp_session(page).send("Accessibility.getFullAXTree")["nodes"]
    wanted = {"button", "tab", "tabpanel", "slider", "img", "application", "toolbar", "link"}
    nameless = [
        node
        for node in tree
        if not node.get("ignored")
        and node.get("role", {}).get("value") in wanted
        and not node.get("name", {}).get("value", "").strip()
    ]
    assert nameless == []
    live = page.eval_on_selector_all("[role=status], [role=alert]", "all => all.map(each => each.id)")
    assert {"mode", "banner", "seat", "announce", "link"} <= set(live)


CONTRAST = """() => {
  const style = getComputedStyle(document.documentElement);
  const linear = value => value <= 0.03928 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
  const luminance = name => {
    let digits = style.getPropertyValue(name).trim().slice(1);
    if (digits.length === 3) digits = [...digits].map(digit => digit + digit).join('');
    const number = parseInt(digits, 16);
    const parts = [[number >> 16, .2126], [number >> 8 & 255, .7152], [number & 255, .0722]];
    return parts.reduce((all, [value, part]) => all + part * linear(value / 255), 0);
  };
  const pairs = [['text', 'panel'], ['soft', 'panel'], ['on-accent', 'accent'], ['warn', 'warn-ground'],
    ['bad', 'bad-ground'], ['good', 'panel'], ['map-text', 'map-ground']];
  return pairs.map(([one, two]) => {
    const [a, b] = [luminance('--' + one), luminance('--' + two)];
    return [one, (Math.max(a, b) + .05) / (Math.min(a, b) + .05)];
  });
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_words_can_be_read_and_colours_are_never_alone(scheme: str, chromium: Any, rig: PageRig) -> None:
    """Contrast of WCAG 2.2 (1.4.3: 4.5 to 1); marks beside every colour that means something (1.4.1)."""
    page = opened(chromium, rig, color_scheme=scheme)
    assert [pair for pair in page.evaluate(CONTRAST) if pair[1] < 4.5] == []
    mark = "getComputedStyle(document.getElementById('link'), '::before').content"
    assert "✓" in page.evaluate(mark)
    page.click("#tab-drives")
    until(page, "document.querySelector('#drives td.state').textContent.startsWith('●')")
