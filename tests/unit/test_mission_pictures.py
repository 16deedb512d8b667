"""Pictures of missions: Mermaid by its grammar, the drawing by its geometry, of many missions made at random."""

from __future__ import annotations

import random
import re
from collections.abc import Iterator, Mapping
from itertools import combinations
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from mission_trees import Walker

from artemis.mission.loading import load_model
from artemis.mission.schema import Mission
from artemis.report.mission_boxes import Box, boxes_of, is_list
from artemis.report.mission_chart import chart
from artemis.report.mission_mermaid import mermaid_of
from artemis.states.step_names import name_of
from artemis.states.whereabouts import counts
from artemis.vehicle import RobotFile

ROBOTS = Path(__file__).parents[2] / "missions/robots"
WAIT = {"wait": {"seconds": 1.0}}
LIMITED = {"wait": {"for": "run_s > 9", "at_most_s": 4}}
SVG = "{http://www.w3.org/2000/svg}"


def boxes(*steps: Mapping[str, Any], robot: str = "") -> Box:
    """The picture of these steps; of a robot that comes with artemis, or of one that has everything."""
    inputs = {"stick": {"plugin": "keyboard"}}
    mission = {"mission": "m", "robot": "r.yaml", "bus": "simulation", "inputs": inputs, "steps": list(steps)}
    known = load_model(ROBOTS / f"{robot}.yaml", RobotFile) if robot else None
    return boxes_of(Mission.model_validate(mission).model_dump(mode="json", by_alias=True), known)


def lines(*steps: Mapping[str, Any]) -> list[str]:
    """The Mermaid diagram without its head and indentation."""
    return [line.strip() for line in mermaid_of(boxes(*steps)).splitlines()[4:]]


# ------------------------------------------------------------------------------------------------- random missions


def some_steps(chance: random.Random, depth: int) -> list[dict[str, Any]]:
    return [some_step(chance, depth) for _ in range(chance.randint(1, 3))]


def some_step(chance: random.Random, depth: int) -> dict[str, Any]:
    def steps() -> list[dict[str, Any]]:
        return some_steps(chance, depth - 1)

    leaves: list[dict[str, Any]] = [
        WAIT,
        LIMITED,
        {"say": chance.choice(["hello", 'quoted "x"; 50 % #1: <b> & so on', "a long text " * 9, "終わり"])},
        {"ask": {"question": "which way is it that you want to go today?", "answers": ["left", "right"]}},
        {"follow": {"path": "paths/a_rather_long_name_of_a_path_file.csv", "laps": 3, "follower": {"speed_m_s": 0.1}}},
        {"teleop": {"input": "stick", "until": {"button": "done"}, "record": "shown"}},
    ]
    if depth == 0:
        return chance.choice(leaves)
    watches = [{"if": "run_s > 3 and not stick.done", "steps": steps(), "then": "resume"}]
    watches += [{"if": "driven_m > 2", "then": "far"}, {"if": "stick.done", "steps": steps(), "then": "restart"}]
    words: list[dict[str, Any]] = [
        *leaves,
        {"repeat": {"steps": steps(), **chance.choice([{}, {"times": 3}, {"until": "round > 2"}])}},
        {"try": {"steps": steps(), "retries": 2, **chance.choice([{}, {"between": steps()}])}},
        {"try": {"steps": steps(), "catch": {"timeout": steps(), "any": steps()}}},
        {"try": {"steps": steps(), "retries": 1, "again_on": ["fault:DRV-25", "far"], "catch": {"fault": steps()}}},
        {"during": {"steps": steps(), "when": watches, **chance.choice([{}, {"at_most_s": 60}])}},
        {"choose": [{"if": "run_s > 1", "steps": steps()}, {"steps": [*steps(), {"end": {"outcome": "failed"}}]}]},
        {"choose": [{"if": "run_s > 1", "steps": steps()}, {"if": "driven_m > 3 or stick.done", "steps": steps()}]},
        {"together": {"steps": steps(), "beside": [WAIT, {"repeat": {"steps": [WAIT], "times": 2}}]}},
        {"call": {"part": "visit", "with": {"place": "store"}, "steps": steps()}},
    ]
    return chance.choice(words)


@pytest.fixture(scope="module", params=range(40))
def some(request: pytest.FixtureRequest) -> Box:
    return boxes(*some_steps(random.Random(request.param), 3))


# -------------------------------------------------------------------------------------------------------- Mermaid


def test_a_word_is_a_composite_state_and_an_outcome_an_arrow() -> None:
    steps = {"retries": 1, "between": [WAIT], "steps": [LIMITED], "catch": {"timeout": [{"say": "late"}]}}
    assert lines({"try": steps}) == [
        'state "try" as s1 {',
        'state "wait for run_s #62; 9" as s2',
        "[*] --> s2",
        "s2 --> [*]",
        'state "wait 1 s" as s3',
        "s2 --> s3: timeout#58; once at most",
        "s3 --> s2: again",
        'state "say “late”" as s4',
        "s2 --> s4: timeout",
        "s4 --> [*]",
        "}",
        "[*] --> s1",
        "s1 --> [*]",
    ]


def test_an_outcome_that_no_try_catches_is_an_arrow_to_the_failed_mission() -> None:
    follow = {"follow": {"path": "a.csv", "follower": {}}}
    approach = {"approach": {"until": "run_s > 9", "at_most_m": 2}}
    goto = {"goto": {"map": "m.yaml", "to": "gate"}}

    def failing(*steps: dict[str, Any], robot: str = "") -> list[str]:
        return [arrow.label for arrow in boxes(*steps, robot=robot).arrows]

    assert failing(follow) == ["blocked", "battery-short"]
    assert failing(follow, robot="artemis") == []
    assert failing(follow, robot="artemis_lms100") == ["blocked"]
    assert failing(follow, robot="artemis_battery") == ["battery-short"]
    assert failing(goto) == ["blocked", "no-path", "battery-short"]
    assert failing(approach, robot="artemis") == ["too-far"]
    attempt = {"steps": [approach], "retries": 1, "again_on": ["fault:DRV-25", "lost"], "catch": {"too-far": [WAIT]}}
    assert failing({"try": attempt}, robot="artemis") == ["fault:DRV-25", "lost"]
    outer = {"try": {"steps": [{"try": attempt}], "catch": {"any": [WAIT]}}}
    assert failing(outer, robot="artemis") == ["fault:DRV-25", "lost"], "this try does not name them"
    attempt["catch"] = {"any": [WAIT]}
    assert failing({"try": attempt}, robot="artemis") == []
    told = lines(approach)
    assert "s1 --> failed_s2: too-far" in told


def test_watchers_and_regions() -> None:
    watched = lines({"during": {"steps": [WAIT], "when": [{"if": "run_s > 3", "steps": [WAIT]}], "at_most_s": 60}})
    assert "s2 --> s3: if run_s #62; 3" in watched
    assert "s3 --> s2: resume" in watched
    assert "s2 --> [*]: after 60 s, then timeout" in watched
    assert watched[-2:] == ['state "mission failed#58; timeout" as failed_s4', "s1 --> failed_s4: timeout"]
    beside = lines({"together": {"steps": [WAIT], "beside": [WAIT, WAIT]}})
    assert beside.count("--") == 2


@pytest.mark.sampled(6)
def test_mermaid_by_its_grammar(some: Box) -> None:
    """Braces pair, names are unique, labels hold nothing that means something, and arrows stay within their state."""
    head, body = mermaid_of(some).split("stateDiagram-v2\n")
    assert head == "---\ntitle: mission m\n---\n"
    text = r"(?:[^\"#:;<>{}\n]|#\d+;)+"
    scopes: list[tuple[set[str], list[str]]] = [(set(), [])]
    names: list[str] = []
    for line in (line.strip() for line in body.splitlines()):
        if state := re.fullmatch(rf'state "{text}" as (\w+)( \{{)?|state (\w+) <<choice>>', line):
            name = state[1] or state[3]
            names.append(name)
            scopes[-1][0].add(name)
            scopes += [(set(), [])] * bool(state[2])
        elif line == "}":
            check(*scopes.pop())
        elif line == "--":
            check(*scopes[-1])
            scopes[-1] = set(), []
        else:
            arrow = re.fullmatch(rf"(\[\*\]|\w+) --> (\[\*\]|\w+)(?:: {text})?", line)
            assert arrow, line
            scopes[-1][1].extend(name for name in arrow.groups() if name != "[*]")
    (last,) = scopes
    check(*last)
    assert len(names) == len(set(names))


def check(states: set[str], used: list[str]) -> None:
    assert set(used) <= states
    assert states <= set(used) or len(states) == 1


# ----------------------------------------------------------------------------------------------------- the drawing


def placed(element: ET.Element, x: float = 0.0, y: float = 0.0) -> Iterator[tuple[ET.Element, float, float]]:
    """Each element with its place in the picture."""
    if moved := re.fullmatch(r"translate\((\S+) (\S+)\)", element.get("transform", "")):
        x, y = x + float(moved[1]), y + float(moved[2])
    yield element, x, y
    for child in element:
        yield from placed(child, x, y)


def frames(picture: str) -> list[tuple[float, float, float, float]]:
    """Left, top, right and bottom of every box, without the paper."""
    found = [(each, x, y) for each, x, y in placed(ET.fromstring(picture)) if each.tag == f"{SVG}rect"][1:]
    sizes = [(x, y, float(each.get("width", 0)), float(each.get("height", 0))) for each, x, y in found]
    return [(x, y, x + width, y + height) for x, y, width, height in sizes]


def texts(picture: str) -> list[tuple[float, float, float, float]]:
    """The same of every line of text, about as wide as common fonts are."""
    found = []
    for each, x, y in placed(ET.fromstring(picture)):
        if each.tag == f"{SVG}text":
            left, base = x + float(each.get("x", 0)), y + float(each.get("y", 0))
            size = 11.5 if "s" in each.get("class", "").split() else 13.0
            found.append((left, base - 0.7 * size, left + 0.5 * size * len("".join(each.itertext())), base))
    return found


def apart(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]


def within(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return one[0] >= other[0] and one[1] >= other[1] and one[2] <= other[2] and one[3] <= other[3]


@pytest.mark.sampled(2)
def test_boxes_lie_in_each_other_or_apart_and_no_text_covers_another(some: Box) -> None:
    picture = chart(some)
    boxed, written = frames(picture), texts(picture)
    root = ET.fromstring(picture)
    paper = (0.0, 0.0, float(root.get("width", 0)), float(root.get("height", 0)))
    assert len(boxed) >= sum(1 for _ in some.inside())
    for one, other in combinations(boxed, 2):
        assert apart(one, other) or within(one, other) or within(other, one)
    for one, other in combinations(written, 2):
        assert apart(one, other)
    for text in written:
        assert within(text, paper)
        assert all(apart(text, box) or within(text, box) for box in boxed)


def test_the_drawing_needs_no_network_and_says_what_ran() -> None:
    mission = boxes(WAIT, {"say": "<b>"})
    alone, told = chart(mission), chart(mission, {"steps[0].wait": "3x · 4.5 s · done"})
    assert 'color="#1d2125"' in alone
    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)|url\((?!#)", alone)
    assert 'opacity=".45"' not in alone
    assert "&lt;b&gt;" in alone
    assert "3x · 4.5 s · done" in told
    assert told.count('<g opacity=".45">') == 1, "what was not said is pale"


# ---------------------------------------------------------------------------------------------------------- names


@pytest.mark.parametrize(
    ("step", "name"),
    [
        ({"follow": {"path": {"waypoints": [[0, 0], [1, 0]]}}}, "follow 2 waypoints"),
        ({"follow": {"path": {"recorded": "shown"}, "laps": 2}}, "follow recorded shown, 2 laps"),
        ({"calibrate": {"steering": None, "gains": {}}}, "calibrate gains"),
        ({"dock": {"timeout_s": 3, "at": "charger"}}, "dock charger"),
        ({"stop": {}}, "stop"),
        ({"ask": {"question": "which way?", "answers": ["left"]}}, "ask which way?"),
        (
            {"teleop": {"inputs": ["stick", "keys"], "input": None, "record": "shown"}},
            "teleop stick, keys, record shown",
        ),
        ({"goto": {"to": {"x_m": 1.0, "y_m": -2.5, "heading_deg": 90.0}}}, "goto x 1 m, y -2.5 m, 90 degrees"),
        ({"repeat": {"steps": [], "until": "round > 3", "times": 5}}, "repeat until round > 3, 5 times at most"),
        ({"repeat": {"steps": []}}, "repeat for ever"),
        ({"end": {"outcome": "failed", "say": "why"}}, "end failed: “why”"),
        ({"call": {"part": "visit", "with": {"place": "gate"}, "steps": []}}, "call visit (place: gate)"),
    ],
)
def test_short_names(step: dict[str, Any], name: str) -> None:
    ((word, body),) = step.items()
    assert name_of(word, body) == name


def test_a_list_of_steps_has_no_words() -> None:
    assert is_list({"steps": [WAIT, {"stop": {}, "say": None}]})
    assert is_list({})
    assert not is_list({"steps": [WAIT, {"wait": None, "say": "a"}]})


# ----------------------------------------------------------------------------------------------------- whereabouts


def test_rounds_and_attempts_around_the_present_step() -> None:
    attempt = {"retries": 2, "between": [WAIT], "steps": [LIMITED], "catch": {"timeout": [WAIT]}}
    watched = {"during": {"steps": [{"try": attempt}], "when": [{"if": "stick.done", "steps": [WAIT]}]}}
    choice = {"choose": [{"steps": [{"together": {"steps": [{"repeat": {"steps": [WAIT]}}], "beside": [WAIT]}}]}]}
    steps = ({"repeat": {"times": 2, "steps": [watched]}}, choice)
    walk = Walker(*steps)
    told = [counts(steps, walk.position)]
    for tick in ("timeout", "done", "timeout", "done", "timeout", "done", "done"):
        walk.tick(tick)
        told.append(counts(steps, walk.position))
    walk.tick(stick__done=True)
    told.append(counts(steps, walk.position))
    one = "round 1/2"
    assert told[:6] == [[one], [one, "attempt 2/3"], [one, "attempt 2/3"], *[[one, "attempt 3/3"]] * 2, [one]]
    assert told[6] == ["round 2/2"]
    assert told[7] == ["round 1"]
