"""Values of a YAML file are changed in place; its writer's comments, order and anchors stay."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from artemis.errors import ConfigError
from artemis.yaml_edit import edit, edited, with_words
from artemis.yaml_file import KeyPath, survey

ROBOT = Path(__file__).parents[2] / "missions" / "robots" / "artemis.yaml"


def changed(text: str, *keys: str, to: object) -> str:
    return edited(text.encode(), "robot.yaml", {keys: to}).decode()  # type: ignore[dict-item]


@pytest.mark.parametrize(
    ("before", "keys", "value", "after"),
    [
        ("a: 1  # why\nb: 2\n", "a", 3.5, "a: 3.5  # why\nb: 2\n"),
        ("a:\n  # above\n  b: 1   # beside\n  c: 2\n", "a.b", 7, "a:\n  # above\n  b: 7   # beside\n  c: 2\n"),
        ("a: {b: 1, c: [1, 2]}\n", "a.c", [3, 4.5], "a: {b: 1, c: [3, 4.5]}\n"),
        ("a: {b: 1}\n", "a.d", 2, "a: {b: 1, d: 2}\n"),
        ("a: {b: 1, }\n", "a.d", 2, "a: {b: 1, d: 2}\n"),
        ("a: {}\n", "a.d", 2, "a: {d: 2}\n"),
        ("a:\n  b: 1  # b\n  c: 2\n", "a.d", 3, "a:\n  b: 1  # b\n  d: 3\n  c: 2\n"),
        ("a:\n  b:\n    c: 1\n  e: 2\n", "a.d", 3, "a:\n  d: 3\n  b:\n    c: 1\n  e: 2\n"),
        ("a: 1", "b", 2, "a: 1\nb: 2"),
        ("a:\n  - 1\n  - 2  # two\nb: 3\n", "a", [5], "a: [5]  # two\nb: 3\n"),
        ("a: &x 1\nb: *x\n", "b", 2, "a: &x 1\nb: 2\n"),
        ("a: &x 1\nb: *x\n", "a", 2, "a: &x 2\nb: 1\n"),
        ("a: &x {c: 1, d: 2}\nb:\n  <<: *x\n  e: 3\n", "b.c", 5, "a: &x {c: 1, d: 2}\nb:\n  <<: *x\n  c: 5\n  e: 3\n"),
        ("a: &x {c: 1}\nb:\n  <<: *x\n", "a.c", 5, "a: &x {c: 5}\nb:\n  <<: *x\n  c: 1\n"),
        ("a: &x {b: 1, c: 2}\nd: *x\n", "d.b", 3, "a: &x {b: 1, c: 2}\nd: {b: 3, c: 2}\n"),
        ("a: 'text'\n", "a", "it's", "a: 'it''s'\n"),
        ("ä: ö  # µ\nb: 1\n", "b", 2, "ä: ö  # µ\nb: 2\n"),
    ],
)
def test_only_the_value_changes(before: str, keys: str, value: object, after: str) -> None:
    assert changed(before, *keys.split("."), to=value) == after


ZONES = """\
# ä: Höhe
a:  # all
  - {n: x, c: [&p [1, 0], [2, 0]]}  # one
  - c:
      - *p
      -   - 3  # three
          - 0
b: &b {x: 1, y: 2}
c: {<<: *b, y: &y 5}
"""


def test_words_are_replaced_where_they_stand() -> None:
    words = {("a", 0, "c", 0, 0): "9", ("a", 1, "c", 0, 0): "9", ("a", 1, "c", 1, 0): "-7.5", ("c", "y"): "6"}
    after = with_words(ZONES.encode(), "z.yaml", {**words, ("c", "x"): "0", ("b", "x"): "0"}).decode()
    assert after == (
        ZONES.replace("[1, 0]", "[9, 0]").replace("3  #", "-7.5  #").replace("&y 5", "&y 6").replace("{x: 1", "{x: 0")
    )


def test_values_of_one_anchor_that_would_differ_are_refused() -> None:
    pairs: tuple[dict[KeyPath, str], ...] = (
        {("a", 0, "c", 0, 0): "9", ("a", 1, "c", 0, 0): "8"},
        {("b", "x"): "1", ("c", "x"): "2"},
    )
    for words in pairs:
        with pytest.raises(ConfigError, match="shares its anchor with a value that will differ"):
            with_words(ZONES.encode(), "z.yaml", words)


def test_several_values_of_the_robot_file_at_once() -> None:
    before = ROBOT.read_text()
    changes = {
        ("geometry", "wheelbase_m"): 0.5612,
        ("calibration", "steering", "left", "zero_v"): [2.5, 2.49],
        ("calibration", "steering", "right", "scale"): 1.002,
        ("drives", "traction-left", "gains"): {"current": [1, 2], "velocity": [3, 4], "position": [5, 6, 7]},
        ("drives", "steer-right", "gear_ratio"): 940,
    }
    after = edited(before.encode(), "artemis.yaml", changes).decode()  # type: ignore[arg-type]
    data, problems = survey(after.encode(), "artemis.yaml")
    assert problems == []
    old = survey(before.encode(), "artemis.yaml")[0].data
    drives = data.data["drives"]  # type: ignore[index, call-overload]
    assert drives["traction-right"]["gains"] == old["drives"]["traction-right"]["gains"]  # type: ignore
    assert (drives["steer-right"]["gear_ratio"], drives["steer-left"]["gear_ratio"]) == (940, 946)  # type: ignore
    assert "wheelbase_m: 0.5612\n" in after
    assert [line for line in before.splitlines() if "#" in line and "wheel" in line and line not in after] == []


@pytest.mark.parametrize(
    ("text", "keys", "words"),
    [
        ("a: 1\n", "b.c", "there is no mapping b"),
        ("a: [1\n", "a", "not closed"),
        ("- 1\n", "a", "expected keys with values"),
    ],
)
def test_what_cannot_be_changed_is_refused(text: str, keys: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        changed(text, *keys.split("."), to=2)


names = st.sampled_from(["a", "b", "c"])
trees = st.recursive(
    st.integers(-5, 5) | st.floats(-9, 9) | st.booleans() | st.just("text: #1"),
    lambda part: st.dictionaries(names, part, min_size=1, max_size=3) | st.lists(part, max_size=2),
    max_leaves=6,
)


@settings(deadline=None)
@given(st.dictionaries(names, trees, min_size=1), st.data())
def test_any_value_can_become_any_other(tree: dict[str, object], data: st.DataObject) -> None:
    import yaml

    text = yaml.safe_dump(tree, default_flow_style=data.draw(st.sampled_from([True, False, None])))
    path: list[str] = []
    part: object = tree
    while isinstance(part, dict) and (not path or data.draw(st.booleans())):
        path.append(data.draw(names))
        part = part.get(path[-1])
    value = data.draw(trees)
    after = survey(edited(text.encode(), "x", {tuple(path): value}), "x")[0].data
    for key in path:
        assert isinstance(after, dict)
        after = after[key]
    assert json.dumps(after, sort_keys=True) == json.dumps(value, sort_keys=True)  # true is not 1


def test_a_file_is_replaced_whole_and_keeps_its_permissions(tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text("a: 1  # why\n")
    file.chmod(0o640)
    edit(file, {("a",): 2})
    assert file.read_text() == "a: 2  # why\n"
    assert file.stat().st_mode & 0o777 == 0o640
    assert [each.name for each in tmp_path.iterdir()] == ["robot.yaml"]
    with pytest.raises(ConfigError):
        edit(file, {("b", "c"): 2})
    assert file.read_text() == "a: 2  # why\n"
