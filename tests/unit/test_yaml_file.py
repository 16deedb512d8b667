from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from artemis.errors import ConfigError
from artemis.yaml_file import MAX_DEPTH, Data, Document, dotted, load, read, surprise, survey


def parse(text: str) -> Document:
    document, problems = survey(text.encode(), "x.yaml")
    assert problems == []
    return document


def value(text: str) -> Data:
    data = parse(f"key: {text}").data
    assert isinstance(data, dict)
    return data["key"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1e-4", 1e-4),
        ("2.1276596e-4", 2.1276596e-4),
        ("1E5", 1e5),
        (".5", 0.5),
        ("-3.", -3.0),
        ("0.560", 0.56),
        ("12", 12),
        ("-7", -7),
        ("+7", 7),
        ("0", 0),
        ("0x6210", 0x6210),
        ("true", True),
        ("false", False),
        ("null", None),
        ("~", None),
        ("", None),
        ("on", "on"),
        ("off", "off"),
        ("yes", "yes"),
        ("No", "No"),
        ("y", "y"),
        ("True", "True"),
        ("NULL", "NULL"),
        ("2015-08-31", "2015-08-31"),
        ("2015-08-31 10:00:00", "2015-08-31 10:00:00"),
        ("1:30", "1:30"),
        ("1_000", "1_000"),
        ("0b11", "0b11"),
        ("-0x10", "-0x10"),
        ("1e", "1e"),
        (".", "."),
        ("nan", "nan"),
        ("=", "="),
        ("'12'", "12"),
        ('"true"', "true"),
        ("'010'", "010"),
        ("'.nan'", ".nan"),
        ("''", ""),
        ("'<<'", "<<"),
        ("99999999999999999999", 99999999999999999999),
    ],
)
def test_scalars_follow_the_narrowed_core_schema(text: str, expected: Data) -> None:
    found = value(text)
    assert found == expected
    assert type(found) is type(expected)


@pytest.mark.parametrize("text", ["010", "-07", "0o17", "00", ".nan", "-.INF", "1e400", "-1e999", "9" * 21, "!!int 3"])
def test_ambiguous_and_boundless_scalars_are_refused(text: str) -> None:
    _, problems = survey(f"key: {text}".encode(), "x.yaml")
    assert len(problems) == 1
    assert problems[0].startswith("x.yaml:1:1: key: ")


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("off", "off is a word in artemis' YAML, write false"),
        ("N", "N is a word in artemis' YAML, write false"),
        ("Yes", "Yes is a word in artemis' YAML, write true"),
        ("TRUE", "TRUE is a word in artemis' YAML, write true"),
        ("false", "remove the quotes"),
        ("-1.5e3", "remove the quotes"),
        ("0x10", "remove the quotes"),
        ("2015-08-31", "a date is text in artemis' YAML"),
        ("1:30", "1:30 is text in artemis' YAML, write plain seconds"),
        ("1_000.5", "digits with _ are text in artemis' YAML, leave the _ out"),
        ("0,4", "a number with a decimal comma: write 0.4"),
        ("0.4 m/s", "write the number alone: its unit stands in the key"),
        ("1.5 m/s2", "write the number alone: its unit stands in the key"),
        ("33°", "write the number alone: its unit stands in the key"),
        ("slow", None),
        ("", None),
        ("{0}", None),
    ],
)
def test_texts_that_look_like_something_else_are_explained(text: str, hint: str | None) -> None:
    assert surprise(text) == hint


@pytest.mark.parametrize(
    ("text", "column", "hint"),
    [
        ("{a: 1, speed: 0,5}", 8, "0.5"),
        ("{speed: -0,25 , b: 2}", 2, "-0.25"),
        ("{speed: 0,5,\n b: 2}", 2, "0.5"),
        ("{a: 3, speed: 1,5, b: [1,5], c: 2}", 8, "1.5"),
    ],
)
def test_a_decimal_comma_in_braces_is_one_problem_of_its_number(text: str, column: int, hint: str) -> None:
    document, problems = survey(text.encode(), "x.yaml")
    assert problems == [f"x.yaml:1:{column}: speed: a number with a decimal comma: write {hint}"]
    assert document.damaged == {("speed",)}


@pytest.mark.parametrize("text", ["{a: 0,5: 1}", "{a: x,5}", "{a: 0, 5}", "{a: '0',5}", "{a: 1,5,5}"])
def test_another_number_after_a_comma_is_a_key(text: str) -> None:
    _, problems = survey(text.encode(), "x.yaml")
    assert problems[-1].endswith(": 5: a key must be text: put it in quotes if it is meant so")


NESTED = """\
first: 1
drives:
  left: &left
    node: 1
    gains: [10, {p: 3}]
  right:
    <<: *left
    node: 2
list:
- a
-   b: 1
"""


@pytest.mark.parametrize(
    ("path", "position"),
    [
        ((), (1, 1)),
        (("first",), (1, 1)),
        (("drives", "left"), (3, 3)),
        (("drives", "left", "gains", 0), (5, 13)),
        (("drives", "left", "gains", 1, "p"), (5, 18)),
        (("drives", "right", "node"), (8, 5)),
        (("drives", "right", "gains"), (5, 5)),
        (("drives", "right", "gains", 1, "p"), (5, 18)),
        (("list", 0), (10, 3)),
        (("list", 1), (11, 5)),
        (("list", 1, "b"), (11, 5)),
        (("drives", "middle", "node"), (2, 1)),
        (("list", 7), (9, 1)),
        (("nothing",), (1, 1)),
    ],
)
def test_positions_are_those_of_keys_and_items(path: tuple[str | int, ...], position: tuple[int, int]) -> None:
    assert parse(NESTED).position(path) == position


def test_problems_name_file_position_and_dotted_key() -> None:
    line = parse(NESTED).problem(("drives", "left", "gains", 1, "p"), "expected less")
    assert line == "x.yaml:5:18: drives.left.gains[1].p: expected less"


def test_what_would_break_a_line_is_escaped() -> None:
    assert parse(NESTED).problem((), "no input a\nb\ufeff") == r"x.yaml:1:1: no input a\nb\ufeff"


def test_a_problem_of_the_whole_file_has_no_key() -> None:
    assert parse(NESTED).problem((), "wrong") == "x.yaml:1:1: wrong"


def test_keys_that_would_break_a_line_are_quoted() -> None:
    assert dotted(("a\nb", "", 0, "x" * 100)) == r"'a\nb'.''[0]." + "x" * 60 + "..."


def test_merged_keys_give_way_to_those_written_beside() -> None:
    data = parse(NESTED).data
    assert isinstance(data, dict)
    assert data["drives"] == {
        "left": {"node": 1, "gains": [10, {"p": 3}]},
        "right": {"node": 2, "gains": [10, {"p": 3}]},
    }


def test_of_several_merged_mappings_the_first_wins() -> None:
    data = parse("a: &a {x: 1, y: 1}\nb: &b {y: 2, z: 2}\nc: {<<: [*a, *b], x: 0}").data
    assert isinstance(data, dict)
    assert data["c"] == {"x": 0, "y": 1, "z": 2}


def test_every_problem_that_leaves_the_file_readable_is_found_at_once() -> None:
    document, problems = survey(b"a: 010\nb: .inf\na: 2\nc: !t 3\n", "x.yaml")
    assert [problem.split(":")[1] for problem in problems] == ["1", "2", "3", "4"]
    assert document.damaged == {("a",), ("b",), ("c",)}


def test_what_stops_the_parser_is_reported_behind_what_was_found_before() -> None:
    with pytest.raises(ConfigError) as caught:
        survey(b"a: 010\nb: [1\n", "x.yaml")
    assert [problem.split(":")[1:3] for problem in caught.value.problems] == [["1", "1"], ["3", "1"]]


@pytest.mark.parametrize(("depth", "accepted"), [(MAX_DEPTH, True), (MAX_DEPTH + 1, False)])
def test_depth_is_bounded(depth: int, accepted: bool) -> None:
    text = ("[" * depth + "]" * depth).encode()
    if accepted:
        assert survey(text, "x.yaml")[1] == []
    else:
        with pytest.raises(ConfigError, match="nested more than 20 deep"):
            survey(text, "x.yaml")


@pytest.mark.parametrize(("count", "accepted"), [(50, True), (51, False)])
def test_aliases_are_bounded(count: int, accepted: bool) -> None:
    text = ("a: &a 1\nb: [" + ", ".join(["*a"] * count) + "]").encode()
    if accepted:
        assert survey(text, "x.yaml")[1] == []
    else:
        with pytest.raises(ConfigError, match="more than 50 aliases"):
            survey(text, "x.yaml")


@pytest.mark.parametrize(("count", "accepted"), [(9_999, True), (10_000, False)])
def test_size_is_bounded(count: int, accepted: bool) -> None:
    text = ("[" + ",".join(["1"] * count) + "]").encode()
    if accepted:
        assert survey(text, "x.yaml")[1] == []
    else:
        with pytest.raises(ConfigError, match="more than 10000 values"):
            survey(text, "x.yaml")


def test_an_alias_counts_with_all_that_it_stands_for() -> None:
    text = "a: &a [" + ",".join(["1"] * 1000) + "]\nb: [" + ",".join(["*a"] * 10) + "]"
    with pytest.raises(ConfigError, match=r"b\[8\]: more than 10000 values"):
        survey(text.encode(), "x.yaml")


def test_read_takes_as_much_as_is_allowed(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"12345")
    assert read(tmp_path / "x", max_bytes=5) == b"12345"
    with pytest.raises(ConfigError, match=r"x: larger than 4 bytes$"):
        read(tmp_path / "x", max_bytes=4)


def test_load_keeps_the_bytes_and_the_name(tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_bytes(b"a: 1\r\nb: 2\r\n")
    document = load(tmp_path / "x.yaml")
    assert (document.data, document.raw) == ({"a": 1, "b": 2}, b"a: 1\r\nb: 2\r\n")
    assert document.source == str(tmp_path / "x.yaml")


def test_load_refuses_all_that_survey_finds(tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text("a: 010\nb: .nan\n")
    with pytest.raises(ConfigError) as caught:
        load(tmp_path / "x.yaml")
    assert len(caught.value.problems) == 2


TEXT = st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"], exclude_characters="\ufeff\u2028\u2029"))
SCALARS = st.none() | st.booleans() | st.integers(-(10**18), 10**18) | st.floats(allow_nan=False, allow_infinity=False)
DATA = st.recursive(
    SCALARS | TEXT, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXT, inner, max_size=4), max_leaves=20
)


@given(data=DATA)
def test_what_another_writer_quotes_with_care_is_read_as_it_was(data: Data) -> None:
    class Careful(yaml.SafeDumper):
        """Quotes every text; aliases nothing."""

    Careful.add_representer(str, lambda dumper, text: dumper.represent_scalar("tag:yaml.org,2002:str", text, style='"'))
    Careful.ignore_aliases = lambda self, data: True  # type: ignore[method-assign]
    text = yaml.dump(data, Dumper=Careful, allow_unicode=True, width=10_000)
    document, problems = survey(text.encode(), "x.yaml")
    assert problems == []
    assert document.data == data


@given(content=st.binary(max_size=60))
def test_no_bytes_raise_anything_but_a_config_error(content: bytes) -> None:
    try:
        document, _ = survey(content, "x.yaml")
    except ConfigError:
        return
    assert () in document.positions
