"""Broken files are refused with every problem named: `syntax/*.yaml` whole, `*.edits` as small changes of `good/`."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from artemis.errors import ConfigError
from artemis.mission import load_mission

HERE = Path(__file__).parent
GOOD = HERE / "good"
SYNTAX = sorted((HERE / "syntax").glob("*.yaml"))
EXPECT = "# expect: "


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(shutil.copytree(GOOD, tmp_path_factory.mktemp("broken") / "missions"))


def problems(folder: Path, file: str, content: bytes) -> list[str]:
    """What is reported when a good file has another content; @ stands for the folder, nothing for the file."""
    original = (GOOD / file).read_bytes()
    try:
        (folder / file).write_bytes(content)
        load_mission(folder / "mission.yaml")
    except ConfigError as error:
        return [problem.replace(str(folder), "@").removeprefix(f"@/{file}:") for problem in error.problems]
    finally:
        (folder / file).write_bytes(original)
    return []


# ---------------------------------------------------------------------------------------------- whole files


@pytest.mark.parametrize("path", SYNTAX, ids=lambda path: path.stem)
def test_a_broken_file_is_refused_as_its_first_lines_say(folder: Path, path: Path) -> None:
    lines = path.read_text(encoding="utf-8").splitlines()
    expected = [line.removeprefix(EXPECT) for line in lines if line.startswith(EXPECT)]
    assert expected
    assert problems(folder, "mission.yaml", path.read_bytes()) == expected


BYTES = {
    "byte order mark": (
        b"\xef\xbb\xbfmission: x\n",
        "1:1: begins with a byte order mark: save it as UTF-8 without BOM",
    ),
    "utf-16": ("mission: x\n".encode("utf-16"), "1:1: begins with a byte order mark: save it as UTF-8 without BOM"),
    "latin-1": ("mission: x\n# Fräse\n".encode("latin-1"), "2:5: byte 0xe4 is not UTF-8"),
    "cut in a character": ("# Fräse".encode()[:5], "1:5: byte 0xc3 is not UTF-8"),
    "a NUL": (b"mission: x\nrobot: \0\n", "2:8: character U+0000 is not allowed in YAML"),
    "over 1 MiB": (b"#" * ((1 << 20) + 1), " larger than 1048576 bytes"),
    "empty": (b"", "1:1: expected a mapping, found nothing"),
}


@pytest.mark.parametrize("name", BYTES)
def test_a_file_that_is_no_yaml_text_is_refused(folder: Path, name: str) -> None:
    content, expected = BYTES[name]
    assert problems(folder, "mission.yaml", content) == [expected]


def test_a_path_file_that_is_not_utf8_is_refused(folder: Path) -> None:
    found = problems(folder, "paths/line.csv", b"x_m, y_m\n\xff\n")
    assert found == ["@/mission.yaml:10:14: steps[1].follow.path: byte 10 is not UTF-8: paths/line.csv"]


def test_a_robot_file_that_is_no_yaml_is_refused_beside_the_rest(folder: Path) -> None:
    (folder / "two.yaml").write_text((GOOD / "mission.yaml").read_text().replace("tick_hz: 50", "tick_hz: 5"))
    (folder / "robots/artemis.yaml").write_text("robot: [ARTEMIS\n")
    with pytest.raises(ConfigError) as caught:
        load_mission(folder / "two.yaml")
    shutil.copy(GOOD / "robots/artemis.yaml", folder / "robots")
    assert caught.value.problems == [
        f"{folder}/robots/artemis.yaml:2:1: not YAML: a list [...] is not closed, or a comma is missing "
        "(it begins at 1:8)",
        f"{folder}/two.yaml:5:1: tick_hz: expected at least 25, found 5",
    ]


# ---------------------------------------------------------------------------------------------- small edits


@dataclass(frozen=True)
class Edit:
    file: str
    old: str
    new: str
    expected: list[str]

    def __str__(self) -> str:
        return (self.new or self.old).strip()[:60]


def edits(name: str, file: str) -> list[Edit]:
    blocks = (HERE / name).read_text(encoding="utf-8").split("\n\n")
    found = []
    for lines in (block.splitlines() for block in blocks if not block.startswith("#")):
        old, new, expected = ([line[2:] for line in lines if line[:2] == mark] for mark in ("- ", "+ ", "! "))
        assert len(old) + len(new) + len(expected) == len(lines), lines
        end = "" if new else "\n"
        found.append(Edit(file, "\n".join(old) + end, "\n".join(new), expected))
    return found


EDITS = [
    *edits("mission.edits", "mission.yaml"),
    *edits("robot.edits", "robots/artemis.yaml"),
    *edits("path.edits", "paths/line.csv"),
]


@pytest.mark.sampled(4)
@pytest.mark.parametrize("edit", EDITS, ids=str)
def test_an_edit_that_breaks_a_good_file_is_refused_in_full(folder: Path, edit: Edit) -> None:
    good = (GOOD / edit.file).read_text(encoding="utf-8")
    assert edit.old in good
    assert edit.expected
    assert problems(folder, edit.file, good.replace(edit.old, edit.new, 1).encode()) == edit.expected


def test_there_are_enough_broken_files() -> None:
    assert len(SYNTAX) >= 50
    assert len(EDITS) >= 120


def test_the_unbroken_files_are_accepted(folder: Path) -> None:
    assert problems(folder, "mission.yaml", (GOOD / "mission.yaml").read_bytes()) == []


# ---------------------------------------------------------------------------------------------- file states


def test_a_missing_mission_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"x\.yaml: file not found$"):
        load_mission(tmp_path / "x.yaml")


def test_a_directory_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"is a directory, expected a file$"):
        load_mission(tmp_path)


def test_a_pipe_is_refused_without_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "x.yaml")
    with pytest.raises(ConfigError, match=r"is not a regular file$"):
        load_mission(tmp_path / "x.yaml")


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads every file")
def test_an_unreadable_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.yaml").touch(mode=0o000)
    with pytest.raises(ConfigError, match=r"cannot be read: Permission denied$"):
        load_mission(tmp_path / "x.yaml")


@pytest.mark.parametrize("name", ["x" * 300 + ".yaml", "x\0.yaml"])
def test_an_impossible_file_name_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError, match=r"cannot be read: (File name too long|not a file name)$"):
        load_mission(tmp_path / name)


def test_a_link_out_of_the_folder_is_refused(folder: Path, tmp_path: Path) -> None:
    shutil.copy(GOOD / "robots/artemis.yaml", tmp_path / "secret.yaml")
    (folder / "robots/link.yaml").symlink_to(tmp_path / "secret.yaml")
    content = (GOOD / "mission.yaml").read_bytes().replace(b"artemis.yaml", b"link.yaml")
    found = problems(folder, "mission.yaml", content)
    assert found == ["3:1: robot: outside the mission's folder @: robots/link.yaml; copy the file there"]


def test_a_link_to_itself_is_refused(folder: Path) -> None:
    (folder / "robots/loop.yaml").symlink_to("loop.yaml")
    content = (GOOD / "mission.yaml").read_bytes().replace(b"artemis.yaml", b"loop.yaml")
    (found,) = problems(folder, "mission.yaml", content)
    assert found.startswith("3:1: robot: cannot be read: Too many levels of symbolic links: robots/loop.yaml")


# ---------------------------------------------------------------------------------------------- fuzz

TEXT = (GOOD / "mission.yaml").read_bytes()
SNIPPETS = [
    *(b"\n", b" ", b"\t", b": ", b"- ", b"[", b"]", b"{", b"}", b",", b"#", b"'", b'"', b"&a ", b"*a", b"<<: *a"),
    *(b"", b"!x ", b"? ", b"|\n", b">-\n", b"---\n", b"...\n", b"%YAML 1.1\n", b"\xff", b"\xef\xbb\xbf", b"\xc2\x85"),
    *(b"\0", b".nan", b"1e999", b"010", b"0x", b"on", b"null", b"true", b"9" * 40, b"-1", b"0", b"''", b"{}", b"[[]]"),
    *(b'"\\0"', b'"\\uD800"', b'"\\UFFFFFFFF"', b'"\\n"', b"\xe2\x80\xa8", b"\xc3\xa4", b"..", b"/", b".", b"robots"),
]


@st.composite
def broken(draw: st.DrawFn) -> bytes:
    text = TEXT
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(text)))
        end = min(len(text), start + draw(st.integers(0, 40)))
        new = draw(st.sampled_from(SNIPPETS) | st.binary(max_size=8) | st.just(text[start:end] * 2))
        text = text[:start] + new + text[end:]
    return text


@given(content=broken() | st.binary(max_size=200))
@example(content=TEXT.replace(b"robots/artemis.yaml", b'"\\0"'))
@example(content=b"\xe2\x80\xa8" * 10 + b"a: [")
@example(content=b"? !x\n: 1\n? &b\n: *b\n")
@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_whatever_a_mission_holds_it_is_accepted_or_refused_in_plain_words(folder: Path, content: bytes) -> None:
    for problem in problems(folder, "mission.yaml", content):
        problem.encode()
        assert problem.isprintable(), problem
        assert not any(word in problem for word in ("pydantic", "Input should", "http", "Value error", "Traceback"))
