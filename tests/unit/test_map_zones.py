"""Zones and places of a map on the command line; routes between them."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from map_command import call, refused

from artemis.commands.map_zones import ZoneEdits, edited_zones, zones_of
from artemis.errors import ConfigError
from artemis.mapping.occupancy import OccupancyMap
from artemis.mission.loading import load_mission
from artemis.mission.zones import without_zones
from artemis.route_planning import planner
from artemis.route_planning.floor import floor_from
from artemis.route_planning.planner import PlannedRoute, RouteRequest, plan_route
from artemis.route_planning.zones import MapZone
from artemis.yaml_edit import with_line, without_line

MISSION = """
mission: defaults
robot: robots/ROBOT
bus: simulation
steps:
  - calibrate: {steering: from_potentiometers}
  - goto: {map: workshop.yaml, to: store}
simulation:
  localizer: {plugin: simulated_tracker}
"""
MISSIONS = Path(__file__).parents[2] / "missions"
ROBOT = MISSIONS / "robots" / "artemis_lms100.yaml"


@pytest.fixture
def workshop(tmp_path: Path) -> Path:
    for file in (MISSIONS / "maps").glob("workshop.*"):
        shutil.copy(file, tmp_path)
    return tmp_path / "workshop.yaml"


def test_zones_and_places_are_added_and_removed_in_place(workshop: Path) -> None:
    told = call(
        "edit", workshop, "--zone", "ramp=slow@0.2:5,5,6,5,6,6", "--place", "desk=2,2,90",
        "--remove-zone", "lane", "--remove-zone", "1", "--remove-place", "gate",
    )  # fmt: skip
    known = zones_of(workshop)
    assert [zone.name for zone in known.zones] == ["doors", "ramp"]
    assert known.zones[1].speed_m_s == 0.2
    assert list(known.places) == ["charger", "bench", "store", "desk"]
    assert "place       desk: x 2 m, y 2 m, 90 degrees" in told
    text = workshop.with_name("workshop.zones.yaml").read_text()
    assert text.startswith("# Zones and places of the workshop, in the frame of its map.\nzones:\n")


def test_zones_are_removed_by_their_numbers_in_the_file_as_it_is(workshop: Path) -> None:
    call("edit", workshop, "--remove-zone", "1", "--remove-zone", "2", "--remove-zone", "doors")
    assert [zone.name for zone in zones_of(workshop).zones] == ["lane"]


def test_a_name_that_is_the_number_of_another_zone_is_refused(workshop: Path) -> None:
    beside = workshop.with_name("workshop.zones.yaml")
    beside.write_text(beside.read_text().replace("name: lane", "name: '2'"))
    assert "2 is the name of zone 3, and the number of another" in refused("edit", workshop, "--remove-zone", "2")
    call("edit", workshop, "--remove-zone", "3")
    assert [zone.name for zone in zones_of(workshop).zones] == ["under-the-crane", "doors"]
    assert without_zones(b"zones:\n  - {name: '1', kind: prefer, corners: [[0, 0], [1, 0], [1, 1]]}\n", "h", ["1", 1])


def test_surveyed_coordinates_are_kept_to_a_tenth_of_a_millimetre(workshop: Path, tmp_path: Path) -> None:
    corners = "564321.1234,934567.25,564331.5,934567.25,564331.5,934577.8765"
    told = call("edit", workshop, "--zone", f"k=keep-out:{corners}", "--place", "desk=564321.12345,934567.25,0.1234")
    assert "564321.1234 934567.25, 564331.5 934567.25, 564331.5 934577.8765" in told
    known = zones_of(workshop)
    assert known.zones[-1].corners[0] == (564321.1234, 934567.25)
    assert (known.places["desk"].x_m, known.places["desk"].heading_deg) == (564321.1234, 0.1234)
    assert "desk: x 564321.1234 m, y 934567.25 m" in told
    call("edit", workshop, "-o", tmp_path / "turned.yaml", "--rotate", "180")
    turned = zones_of(tmp_path / "turned.yaml")
    assert turned.zones[-1].corners[0] == (-564321.1234, -934567.25)
    assert turned.places["desk"].x_m == -564321.1234


def test_a_file_is_begun_and_emptied(workshop: Path) -> None:
    workshop.with_name("workshop.zones.yaml").unlink()
    call("edit", workshop, "--zone", "k=keep-out:1,1,2,1,2,2", "--place", "a=1,1,0")
    call("edit", workshop, "--remove-zone", "k", "--remove-place", "a")
    assert not zones_of(workshop).zones
    call("edit", workshop, "--zone", "k=prefer:1,1,2,1,2,2", "--place", "a=1,1,0")
    assert (zones_of(workshop).zones[0].kind, list(zones_of(workshop).places)) == ("prefer", ["a"])


@pytest.mark.parametrize(
    "name", ["1", "010", "1e5", "0x1f", "null", "true", "yes", "on", "-", "--", "---", "-a", "2026-01-01"]
)
def test_a_place_may_have_a_name_that_is_a_word_of_yaml(workshop: Path, tmp_path: Path, name: str) -> None:
    call("edit", workshop, "--place", f"{name}=1,1,0")
    call("edit", workshop, "-o", tmp_path / "turned.yaml", "--rotate", "180")
    for file in (workshop, tmp_path / "turned.yaml"):
        assert name in zones_of(file).places
        call("edit", file, "--remove-place", name)
        assert name not in zones_of(file).places


def test_a_plain_name_of_a_place_is_written_without_quotes(workshop: Path) -> None:
    call("edit", workshop, "--place", "desk-2=1,1,0")
    assert "\n  desk-2: {x_m: 1," in workshop.with_name("workshop.zones.yaml").read_text()


def test_a_rotated_map_takes_them_along(workshop: Path, tmp_path: Path) -> None:
    call("edit", workshop, "-o", tmp_path / "turned.yaml", "--rotate", "90", "--place", "desk=-2,2,0")
    turned = zones_of(tmp_path / "turned.yaml")
    assert turned.zones[0].corners[0] == (-5.6, 3.6)
    store, desk = turned.places["store"], turned.places["desk"]
    assert (store.x_m, store.y_m, store.heading_deg) == (-1.8, 8.0, 90.0)
    assert (desk.x_m, desk.y_m) == (-2.0, 2.0)
    assert list(zones_of(workshop).places) == ["charger", "bench", "store", "gate"]


def test_corners_that_two_zones_share_are_rotated_once(workshop: Path, tmp_path: Path) -> None:
    zone = "- {kind: prefer, corners: [%s, [3, 0], [3, 3]]}\n"
    shared = "zones:\n" + zone % "&p [1, 0]" + zone % "*p "
    workshop.with_name("workshop.zones.yaml").write_text(shared)
    call("edit", workshop, "-o", tmp_path / "turned.yaml", "--rotate", "180")
    assert [zone.corners[0] for zone in zones_of(tmp_path / "turned.yaml").zones] == [(-1.0, 0.0)] * 2
    assert "[&p [-1, 0], [-3, 0], [-3, -3]]" in (tmp_path / "turned.zones.yaml").read_text()


def test_a_rotated_map_keeps_the_comments_of_its_zones(workshop: Path, tmp_path: Path) -> None:
    zones = workshop.with_name("workshop.zones.yaml")
    zones.write_text(zones.read_text().replace("  charger:", "  # at the wall\n  charger:") + "# the end\n")
    call("edit", workshop, "-o", tmp_path / "turned.yaml", "--rotate", "90")
    turned = (tmp_path / "turned.zones.yaml").read_text()
    assert turned.startswith("# Zones and places of the workshop, in the frame of its map.\n")
    assert "  # at the wall\n  charger: {x_m: -1.5, y_m: 1, heading_deg: 90}\n" in turned
    assert turned.endswith("# the end\n")


def test_zones_of_an_earlier_map_do_not_stay_beside_another(workshop: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.yaml"
    call("edit", workshop, "-o", other, "--rotate", "90")
    workshop.with_name("workshop.zones.yaml").unlink()
    assert "other.zones.yaml: exists already" in refused("edit", workshop, "-o", other, "--rotate", "0")
    told = call("edit", workshop, "-o", other, "--rotate", "180", "--force")
    assert f"removed, as {workshop} has none" in told
    assert not zones_of(other).places


def test_a_name_of_zones_is_no_name_of_a_map(workshop: Path, tmp_path: Path) -> None:
    told = refused("edit", workshop, "-o", tmp_path / "other.zones.yaml", "--rotate", "90")
    assert "a map's zones and places have such a name" in told


def test_what_lies_outside_of_the_map_is_told(workshop: Path) -> None:
    told = call("edit", workshop, "--zone", "far=keep-out:50,1,51,1,51,2", "--place", "away=70,0,0")
    assert "notice      zone far lies outside of the map: it has no effect" in told
    assert "notice      place away lies outside of the map" in told


def test_two_zones_of_one_name_are_refused(workshop: Path) -> None:
    beside = workshop.with_name("workshop.zones.yaml")
    beside.write_text(beside.read_text().replace("name: doors", "name: lane"))
    assert "two zones are called 'lane'" in refused("show", workshop)


def test_a_keep_out_zone_closes_each_cell_that_it_touches() -> None:
    content = OccupancyMap(cells=np.zeros((20, 20), np.int8), resolution=0.05, origin=(0.0, 0.0, 0.0))
    thin = MapZone(kind="keep-out", corners=((0.1, 0.21), (0.9, 0.21), (0.9, 0.22), (0.1, 0.22)))
    closed = np.argwhere(floor_from(content, [thin]).occupied)
    assert closed.tolist() == [[4, column] for column in range(2, 18)]
    whole = MapZone(kind="keep-out", corners=((0.1, 0.2), (0.3, 0.2), (0.3, 0.4), (0.1, 0.4)))
    assert floor_from(content, [whole]).occupied.sum() == 16
    preferred = thin.model_copy(update={"kind": "prefer"})
    assert (floor_from(content, [preferred]).factor == 1.0).all()


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        ([], "nothing to be done"),
        (["--rotate", "3"], "--output MAP: name the corrected map"),
        (["--zone", "x=slow:1,1,2,2,3,1"], "kind: slow and speed_m_s belong together"),
        (["--zone", "x=keep-out:1,1,2,2"], "--zone x 1,1,2,2: expected 6 numbers or more"),
        (["--zone", "x=keep-out:1,1,2,2,3,3,4"], "--zone x 1,1,2,2,3,3,4: expected 6 numbers or more, in pairs, with"),
        (["--zone", "x=slow@1,2:1,1,2,2,3,1"], "--zone x, speed 1,2: expected 1 number, not 2"),
        (["--place", "a=1,2,3,4,5,6"], "--place a 1,2,3,4,5,6: expected 3 numbers with commas, not 6"),
        (["--zone", "keep-out:1,1,2,2,3,3"], "expected NAME=KIND"),
        (["--zone", "x=keep-out:1,1,2,2,3,3"], "--zone x: corners: the corners lie on one line"),
        (["--zone", "x=keep-out:1,1,2,2,2,1,1,2"], "its edges from corner 1 and from corner 3 cross: list the corners"),
        (["--zone", "lane=keep-out:1,1,2,2,3,1"], "there is a zone 'lane' already"),
        (["--place", "store=1,1,1"], "there is a place 'store' already"),
        (["--zone", "x=slow:1,1,2,2,3,1"], "--zone x: kind: slow and"),
        (
            ["--zone", "r3=keepout:1,1,2,2,3,1"],
            "--zone r3: kind: expected 'keep-out', 'slow' or 'prefer', found 'keepout'; did you mean keep-out?",
        ),
        (["--zone", "x=slow@20:1,1,2,2,3,1"], "--zone x: speed_m_s: expected at most 10, found 20.0"),
        (["--zone", "x=prefer:1,1,2e6,2,3,1"], "--zone x: corners[1][0]: "),
        (["--place", "Big=1,1,1"], "--place 'Big': expected a name of small letters, digits and hyphens, 64 at most"),
        (["--place", "a: b=1,2,3"], "--place 'a: b': expected a name of small letters, digits and hyphens"),
        (["--place", "a=1,2,400"], "--place a: heading_deg: "),
        (["--place", "a"], "expected NAME=X,Y,DEG"),
        (["--remove-zone", "lan"], "no zone 'lan'; nearest is 'lane'"),
        (["--remove-place", "stor"], "no place 'stor'; nearest is 'store'"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_changed(workshop: Path, words: list[str], problem: str) -> None:
    before = workshop.with_name("workshop.zones.yaml").read_bytes()
    assert problem in refused("edit", workshop, *words)
    assert workshop.with_name("workshop.zones.yaml").read_bytes() == before


@pytest.mark.parametrize("degrees", ["nan", "inf", "1e300", "361"])
def test_a_map_is_rotated_by_degrees(workshop: Path, tmp_path: Path, degrees: str) -> None:
    output = tmp_path / "other.yaml"
    told = refused("edit", workshop, "-o", output, "--rotate", degrees)
    assert f"--rotate {float(degrees):g}: expected degrees from -360 to 360" in told
    assert not output.exists()


def test_a_block_that_is_not_written_line_by_line_is_left_alone() -> None:
    raw = b"zones: [{name: a, kind: prefer, corners: [[1, 1], [2, 1], [2, 2]]}]\n"
    with pytest.raises(ConfigError, match="not written line by line"):
        edited_zones(raw, "hall", ZoneEdits(remove_zones=["a"]))
    with pytest.raises(ConfigError, match="not written line by line"):
        edited_zones(raw, "hall", ZoneEdits(zones=["b=prefer:1,1,2,1,2,2"]))


def test_lines_come_and_go_and_leave_the_others_as_they_were() -> None:
    raw = b"# head\nplaces:   # known\n  a: {x: 1}   # first\n  # of b\n  b:\n    x: 2\nlast: 1"
    added = with_line(raw, "f", "places", "c: 3")
    assert added == raw.replace(b"    x: 2\n", b"    x: 2\n  c: 3\n")
    assert without_line(added, "f", "places", "b") == raw.replace(b"  b:\n    x: 2\n", b"  c: 3\n")
    assert with_line(b"", "f", "a", "- 1") == b"a:\n  - 1\n"
    assert with_line(b"a: []\nb: 1\n", "f", "a", "- 1") == b"a:\n  - 1\nb: 1\n"
    assert with_line(b"a:\n- 1\n", "f", "a", "- 2") == b"a:\n- 1\n- 2\n"
    assert without_line(b"a:\n  - 1\nb: 1\n", "f", "a", 0) == b"a: []\nb: 1\n"


def test_a_route_is_planned_told_and_drawn(workshop: Path, tmp_path: Path) -> None:
    figure = tmp_path / "route.png"
    told = call("show", workshop, "--from", "1,1.5,0", "--to", "store", "--robot", ROBOT, "-o", figure)
    assert "route       7.0 m, 0 reversals, 10 cm around the outline" in told
    assert "zone        2 doors: slow 0.25 m/s" in told
    assert figure.stat().st_size > 10_000


def test_a_route_is_planned_as_a_step_with_the_defaults_plans_it(
    workshop: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[RouteRequest] = []

    def plan(request: RouteRequest) -> PlannedRoute:
        asked.append(request)
        return plan_route(request)

    monkeypatch.setattr(planner, "plan_route", plan)
    mission = workshop.with_name("goto.yaml")
    shutil.copytree(ROBOT.parent, workshop.with_name("robots"))
    mission.write_text(MISSION)
    for robot in (ROBOT.name, "bare.yaml"):
        file = workshop.with_name("robots") / robot
        text = (workshop.with_name("robots") / ROBOT.name).read_text()
        file.write_text(text if robot == ROBOT.name else text[: text.index("scanners:")])
        mission.write_text(MISSION.replace("ROBOT", robot))
        call("show", workshop, "--from", "1,1.5,0", "--to", "store", "--robot", file)
        (step,) = load_mission(mission).destinations.values()
        shown = asked[-1]
        assert (shown.margin, shown.known_behind, shown.speed) == (step.margin, step.known_behind, step.speed)
        assert shown.goal == step.goal
    assert [request.margin for request in asked] == [0.1, 0.05]


def test_a_route_that_cannot_be_is_refused(workshop: Path) -> None:
    def route(begin: str, end: str, robot: Path = ROBOT) -> str:
        return refused("show", workshop, "--from", begin, "--to", end, "--robot", robot)

    assert "--from chager: no such place; nearest is 'charger'" in route("chager", "store")
    assert "--to 3,3.5,0: the robot cannot stand there" in route("store", "3,3.5,0")
    assert "--to 1,2: expected 3 numbers with commas, not 2" in route("store", "1,2")
    assert "--to 1,2,3,4,5,6: expected 3 numbers with commas, not 6" in route("store", "1,2,3,4,5,6")
    assert "--to nan,1,2: 'nan' is no finite number" in route("store", "nan,1,2")
    assert "--from 1,b,2: 'b' is no number" in route("1,b,2", "store")
    assert "--from 1,,2: '' is no number" in route("1,,2", "store")
    assert "--to '': no such place; there are charger" in route("store", "")
    assert "--from '': no such place; there are charger" in route("", "store")
    assert "within its outline and 10 cm is a wall" in route("1,1.5,0", "7.0,0.37,0")
    assert "for the robot's outline: it has none" in route("store", "bench", MISSIONS / "robots" / "artemis.yaml")
    assert "needs all of --from, --to and --robot" in refused("show", workshop, "--from", "store")
