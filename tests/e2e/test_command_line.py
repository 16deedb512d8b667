"""The command line as a process, on virtual time: exit statuses, messages, and what a run leaves behind."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Mapping
from html.parser import HTMLParser
from importlib.metadata import EntryPoint
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType

import pytest
from command_line import (
    ARTEMIS,
    MISSIONS,
    PATIENCE,
    ROBOT,
    artemis,
    artemis_here,
    assert_left_at_rest,
    modes_of,
    only_run,
    write_mission,
)
from extras import is_about_an_extra
from mcap.reader import make_reader
from mcap.writer import Writer

from artemis import cli
from artemis.errors import ConfigError, DeviceLost, RecordingError

PLACE = re.compile(r"^\S+:\d+:\d+: ")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("missions")


@pytest.fixture(scope="module")
def done(folder: Path) -> subprocess.CompletedProcess[str]:
    return artemis("run", write_mission(folder))


@pytest.fixture(scope="module")
def run(folder: Path, done: subprocess.CompletedProcess[str]) -> Path:
    assert done.returncode == 0, done.stderr
    return only_run(folder)


# ------------------------------------------------------------------------------------------------------ a run


def test_a_finished_run_exits_with_0_and_says_what_it_did(done: subprocess.CompletedProcess[str], run: Path) -> None:
    assert done.returncode == 0
    assert done.stderr == ""
    live, _, numbers = done.stdout.partition("\n\n")
    assert live.startswith("mission line: ARTEMIS on simulated drives\n")
    assert re.search(r"^ +\d+\.\d\d s  follow     following$", live, re.MULTILINE)
    assert re.search(r"^result        done$", numbers, re.MULTILINE)
    assert re.search(r"^distance      1\.5\d m, up to 0\.\d\d m/s$", numbers, re.MULTILINE)
    assert numbers.splitlines()[-1] == f"report        {run}/report.html"


def test_plain_output_has_no_control_characters_and_no_empty_words(done: subprocess.CompletedProcess[str]) -> None:
    assert "\x1b" not in done.stdout
    assert "\r" not in done.stdout
    assert not [line for line in done.stdout.splitlines() if line != line.rstrip()]


def test_a_finished_run_leaves_the_drives_at_rest_and_disarmed(run: Path) -> None:
    assert_left_at_rest(run)


def test_the_run_folder_holds_copies_of_every_file_that_the_mission_names(run: Path) -> None:
    copies = {path.relative_to(run / "files").as_posix() for path in (run / "files").rglob("*") if path.is_file()}
    assert copies == {"mission.yaml", "robots/artemis.yaml", "paths/line.csv"}
    assert {path.name for path in run.iterdir()} == {"recording.mcap", "journal.jsonl", "report.html", "files"}


def test_the_recording_opens_with_the_reader_of_mcap(run: Path) -> None:
    with (run / "recording.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        topics = {channel.topic: number for number, channel in summary.channels.items()}
        counts = summary.statistics.channel_message_counts
        assert counts[topics["/tick"]] > 200
        assert sum(1 for _ in reader.iter_messages(topics=["/tick"])) == counts[topics["/tick"]]


class _Links(HTMLParser):
    """Collects whatever a browser would fetch."""

    def __init__(self) -> None:
        super().__init__()
        self.outside: list[str] = []
        self.elements = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements += 1
        for name, value in attrs:
            fetches = name in ("src", "href", "xlink:href", "srcset", "data", "action", "poster")
            if fetches and not (value or "").startswith(("#", "data:")):
                self.outside.append(f"{tag} {name}={value}")


def test_the_report_is_one_file_that_fetches_nothing(run: Path) -> None:
    page = (run / "report.html").read_text()
    links = _Links()
    links.feed(page)
    assert links.elements > 100
    assert links.outside == []
    assert not re.findall(r"<script[^>]*\bsrc\b", page)
    assert set(re.findall(r'\S*https?://[^"\s]*', page)) <= {
        'xmlns="http://www.w3.org/2000/svg',
        'xmlns:xlink="http://www.w3.org/1999/xlink',
        "https://github.com/leeoniya/uPlot",  # in the words of its licence
    }
    assert not re.findall(r"url\((?!#|[\"']?data:)|@import", page)


def test_the_report_can_be_written_again(run: Path) -> None:
    page = run / "report.html"
    before = page.read_text()
    page.unlink()
    again = artemis_here("report", run)
    assert (again.returncode, again.stdout) == (0, f"{page}\n")
    assert page.read_text()[:500] == before[:500]


# ------------------------------------------------------------------------------------------------------ replay


def test_replay_of_a_run_finds_every_command_equal(run: Path) -> None:
    found = artemis_here("replay", run)
    assert found.returncode == 0, found.stdout + found.stderr
    assert re.fullmatch(r"\d+ ticks recomputed: every command equal, bit for bit\n", found.stdout)


def test_replay_of_a_changed_command_exits_with_1_and_names_tick_and_value(run: Path, tmp_path: Path) -> None:
    doctored = tmp_path / "recording.mcap"

    def faster(record: bytes) -> bytes:
        return re.sub(rb'("wish":.*"set_points":\{"speed":)[^,]*', rb"\g<1>0.35", record)

    rewrite(run / "recording.mcap", doctored, "/tick", 400, faster)
    found = artemis_here("replay", doctored)
    assert found.returncode == 1
    assert re.search(r"tick 400 differs: set_points\.speed: recorded 0\.35, now 0\.", found.stdout)
    assert "it was recorded with" not in found.stdout
    rewrite(run / "recording.mcap", doctored, "/tick", 400, faster, {"python": "3.99.1", "scipy": "0.1"})
    versions = artemis_here("replay", doctored).stdout.splitlines()[-1]
    assert re.fullmatch(r"it was recorded with python 3\.99\.1, here \S+; scipy 0\.1, here \S+", versions)


def test_replay_of_something_else_is_refused(tmp_path: Path, run: Path) -> None:
    assert artemis_here("replay", tmp_path / "nothing").returncode == 2
    (tmp_path / "recording.mcap").write_bytes((run / "recording.mcap").read_bytes()[:100])
    found = artemis_here("replay", tmp_path)
    assert found.returncode == 2
    assert found.stderr.startswith(f"artemis: {tmp_path}/recording.mcap: ")
    assert len(found.stderr.splitlines()) == 1


def rewrite(
    source: Path,
    target: Path,
    topic: str,
    sequence: int,
    change: Callable[[bytes], bytes],
    versions: Mapping[str, str] = MappingProxyType({}),
) -> None:
    """Copy a recording with one message changed, and as if written by other versions."""
    with source.open("rb") as stream, target.open("wb") as out:
        reader, writer = make_reader(stream), Writer(out)
        writer.start()
        for metadata in reader.iter_metadata():
            writer.add_metadata(metadata.name, metadata.metadata | dict(versions))
        for a in reader.iter_attachments():
            writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)
        channels: dict[str, int] = {}
        changed = 0
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            assert schema is not None
            if channel.topic not in channels:
                id = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, id)
            data = message.data
            if (channel.topic, message.sequence) == (topic, sequence):
                data = change(data)
                changed += data != message.data
            writer.add_message(channels[channel.topic], message.log_time, data, message.publish_time, message.sequence)
        writer.finish()  # type: ignore[no-untyped-call]  # mcap leaves out the annotation
    assert changed == 1


# ------------------------------------------------------------------------------------------------------ refused, failed


def test_everything_wrong_is_said_at_once_with_its_place(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, more="tick_hz: 5\nsimulation: {pace: slow}\n")
    robot = tmp_path / "robots/artemis.yaml"
    robot.write_text(robot.read_text().replace("wheelbase_m: 0.560", "wheelbase_m: broad"))
    for found in (artemis_here("run", mission), artemis_here("check", mission)):
        assert found.returncode == 2
        lines = found.stderr.splitlines()
        assert len(lines) == 3
        assert all(PLACE.match(line) for line in lines)
        assert {line.split(": ")[1] for line in lines} == {"tick_hz", "simulation.pace", "geometry.wheelbase_m"}
    assert not (tmp_path / "runs").exists()


def test_check_names_every_mission_and_a_shared_fault_once(tmp_path: Path) -> None:
    good = write_mission(tmp_path)
    (tmp_path / "other").mkdir()
    bad = [write_mission(tmp_path / "other", name=name) for name in ("one.yaml", "two.yaml")]
    robot = tmp_path / "other/robots/artemis.yaml"
    robot.write_text(robot.read_text().replace("wheelbase_m: 0.560", "wheelbase_m: broad"))
    found = artemis_here("check", good, *bad)
    assert found.returncode == 2
    assert found.stdout == f"{good}: ok\n"
    assert len(found.stderr.splitlines()) == 1


def test_shipped_missions_pass_the_check() -> None:
    missions = sorted(MISSIONS.glob("*.yaml"))
    found = artemis_here("check", *missions)
    lines, problems = found.stdout.splitlines(), found.stderr.splitlines()
    assert all(is_about_an_extra(problem) for problem in problems)
    refused = {problem.partition(":")[0] for problem in problems}
    assert found.returncode == (2 if refused else 0)
    accepted = [f"{mission}: ok" for mission in missions if str(mission) not in refused]
    assert [line for line in lines if not line.startswith("  ")] == accepted
    slower = [line for line in lines if line.startswith("  numba is not installed: ")]
    assert bool(slower) == (find_spec("numba") is None)
    remarks = [line for line in lines if line.startswith("  ") and line not in slower]
    about = Counter(remark.split(":")[0].strip() for remark in remarks)
    squares = {"paths/square_left.csv": 5, "paths/square_right.csv": 5}
    assert about == {
        "obstacles": 1,
        "steps[1].teleop.obstacles": 1,
        "paths/corner.csv": 2,
        "paths/slalom.csv": 1,
        **squares,
        "paths/loops.csv": 1,
        "paths/thesis_hall.csv": 1,
    }
    assert any(remark.endswith("rounded: the path leaves it by 93 mm") for remark in remarks)


@pytest.mark.parametrize("what", ["missing.yaml", "", "empty.yaml"])
def test_what_is_no_mission_file_is_refused_in_one_line(tmp_path: Path, what: str) -> None:
    (tmp_path / "empty.yaml").touch()
    found = artemis_here("run", tmp_path / what)
    assert found.returncode == 2
    assert len(found.stderr.splitlines()) == 1
    assert str(tmp_path / what) in found.stderr


@pytest.mark.parametrize(
    ("bus", "status"),
    [
        ("{interface: socketcan, channel: no-such-can}", 1),
        ("{interface: udp_multicast, channel: no.such.group}", 1),
        ("{interface: socketcan, chanel: can0}", 2),
        ("{interface: sokcetcan, channel: can0}", 2),
    ],
)
def test_a_bus_that_cannot_be_opened_is_said_in_few_lines(tmp_path: Path, bus: str, status: int) -> None:
    found = artemis_here("run", write_mission(tmp_path, bus=bus))
    assert found.returncode == status
    assert "Traceback" not in found.stderr
    assert len(found.stderr.splitlines()) <= status
    assert "can" in found.stderr


def test_a_run_that_is_stopped_and_not_armed_again_exits_with_1(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, more="simulation: {operator: [{at_s: 8.0, do: quickstop}]}\n")
    found = artemis_here("run", mission)
    assert found.returncode == 1
    assert "request    quick stop" in found.stdout
    assert re.search(r"^result        FAILED", found.stdout, re.MULTILINE)
    run = only_run(tmp_path)
    assert "quickstop" in modes_of(run)
    assert_left_at_rest(run)


def test_usage_errors_exit_with_2() -> None:
    assert artemis("drive").returncode == 2
    for arguments in (["run"], ["run", "--fast", "x"], ["drive"], ["schema", "rover"], []):
        assert artemis_here(*arguments).returncode == 2


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("hop_limit", "write an option of the interface and its value"),
        ("hop_limt=0", "did you mean 'hop_limit'?"),
        ("hop_limit=010", "octal or decimal"),
        ("hop_limit=[0]", "one value"),
        ("channel=x", "given already"),
    ],
)
def test_sim_refuses_words_that_the_back_end_would_swallow(option: str, words: str) -> None:
    found = artemis_here("sim", ROBOT, "--interface", "udp_multicast", "--channel", "239.74.163.2", "--option", option)
    assert found.returncode == 2
    assert words in found.stderr
    assert len(found.stderr.splitlines()) == 1


def test_sim_says_everything_wrong_in_words_and_files_at_once(tmp_path: Path) -> None:
    true = tmp_path / "true.yaml"
    true.write_text("slip: 2\nwheel_scale: 1\n")
    robot = tmp_path / "robot.yaml"
    shutil.copy(ROBOT, robot)
    robot.write_text(robot.read_text().replace("track_m: 0.436", "track_m: -1"))
    found = artemis_here("sim", robot, "--interface", "sokcetcan", "--channel", "can0", "--true", true)
    assert found.returncode == 2
    assert len(found.stderr.splitlines()) == 4
    assert f"{true}:1:1: slip: " in found.stderr


# ------------------------------------------------------------------------------------------------------ our own bugs


@pytest.mark.parametrize(
    ("error", "status", "words"),
    [
        (
            ConfigError(["a.yaml:1:2: x: wrong", "b.yaml:3:4: y: wrong"]),
            2,
            "a.yaml:1:2: x: wrong\nb.yaml:3:4: y: wrong\n",
        ),
        (RecordingError("gone"), 2, "artemis: gone\n"),
        (DeviceLost("steer-left", "gone"), 1, "artemis: steer-left: gone\n"),
        (ExceptionGroup("tasks", [RecordingError("disk full")]), 1, "artemis: disk full\n"),
    ],
)
def test_errors_become_their_words(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], error: Exception, status: int, words: str
) -> None:
    assert main_raising(monkeypatch, error) == status
    assert capsys.readouterr().err == words


@pytest.mark.parametrize(
    "error", [RuntimeError("oops"), ExceptionGroup("tasks", [RecordingError("x"), KeyError("oops")])]
)
def test_a_bug_of_artemis_exits_with_70_and_its_traceback(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], error: Exception
) -> None:
    assert main_raising(monkeypatch, error) == 70
    shown = capsys.readouterr().err
    assert "Traceback" in shown
    assert "oops" in shown
    assert shown.splitlines()[-1].startswith("artemis: this is a bug in artemis")


def main_raising(monkeypatch: pytest.MonkeyPatch, error: Exception) -> int:
    def fail() -> None:
        raise error

    monkeypatch.setattr(cli, "app", fail)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert isinstance(ended.value.code, int)
    return ended.value.code


# ------------------------------------------------------------------------------------------------------ the rest


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["--svg", "a.svg"], "--svg draws a mission: write artemis graph MISSION --svg FILE"),
        ([MISSIONS / "figure_eight.yaml", "--svg", "a.png"], "--svg a.png: the picture is SVG; name the file a.svg"),
        ([MISSIONS / "figure_eight.yaml", "--svg", ""], "--svg .: the picture is SVG; name the file mission.svg"),
    ],
)
def test_a_picture_that_cannot_be_drawn_is_refused(arguments: list[str | Path], why: str) -> None:
    done = artemis_here("graph", *arguments)
    assert (done.returncode, done.stderr) == (2, f"{why}\n")


def test_graph_plugins_and_schema_print_what_there_is(tmp_path: Path) -> None:
    assert artemis_here("graph").stdout.startswith('stateDiagram-v2\n    state "init"')
    drawn = artemis_here("graph", MISSIONS / "figure_eight.yaml").stdout
    assert 'stateDiagram-v2\n    state "calibrate steering" as s1\n' in drawn
    assert (
        artemis_here("graph", MISSIONS / "figure_eight.yaml", "--svg", tmp_path / "a.svg").stdout
        == f"{tmp_path}/a.svg\n"
    )
    assert (tmp_path / "a.svg").read_text().startswith("<svg ")
    assert "indiveri" in artemis_here("plugins").stdout
    assert '"title": "Robot"' in artemis_here("schema", "robot").stdout


def test_help_imports_nothing_heavy() -> None:
    program = "import sys, artemis.cli; print(sorted({'numpy', 'scipy', 'can', 'pydantic', 'yaml'} & set(sys.modules)))"
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=PATIENCE)
    assert found.stdout == "[]\n"
    shown = artemis("--help")
    assert shown.returncode == 0
    assert "artemis" in shown.stdout


def test_commands_of_a_broken_package_harm_nobody(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = EntryPoint("x", "no_such_package.cli:add_commands", cli.COMMANDS)
    monkeypatch.setattr(cli, "entry_points", lambda group: [broken])
    cli._add_commands()
    said = "artemis: no commands of no_such_package.cli:add_commands: ModuleNotFoundError: "
    assert capsys.readouterr().err.startswith(said)


def test_output_survives_a_terminal_without_the_letters(tmp_path: Path) -> None:
    mission = write_mission(tmp_path, more="steering: 5\n").rename(tmp_path / "Würzburg.yaml")
    found = subprocess.run(
        [*ARTEMIS, "check", mission], capture_output=True, timeout=PATIENCE, env={"PYTHONIOENCODING": "ascii"}
    )
    assert found.returncode == 2
    assert b"rzburg.yaml:7:1: steering: unknown key" in found.stderr


@pytest.mark.sampled(3)
@pytest.mark.parametrize("arguments", [["plugins"], ["--version"], ["check", MISSIONS / "figure_eight.yaml"]])
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_output_that_cannot_be_written_is_said(arguments: list[str | Path], unbuffered: str) -> None:
    with Path("/dev/full").open("w") as full:
        found = subprocess.run(
            [*ARTEMIS, *map(str, arguments)],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=PATIENCE,
            env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
        )
    assert found.returncode == 1
    assert found.stderr == "artemis: standard output cannot be written: No space left on device\n"


@pytest.mark.exhaustive
def test_a_run_whose_output_is_on_a_full_disk_continues_and_says_so(tmp_path: Path) -> None:
    mission = write_mission(tmp_path)
    with Path("/dev/full").open("w") as full:
        command = [*ARTEMIS, "run", str(mission)]
        found = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=PATIENCE)
    assert found.returncode == 0
    assert found.stderr == (
        "artemis: standard output cannot be written: No space left on device; the run continues, its journal shows the "
        "rest\n"
    )


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (["faults", "DRV-2"], [f"DRV-2{digit}" for digit in range(10)]),
        (["plugins", "new", "f"], ["follower"]),
    ],
)
def test_the_shell_completes_words_of_a_fixed_list(words: list[str], offered: list[str]) -> None:
    line = " ".join(["artemis", *words])
    ask = {"_ARTEMIS_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words))}
    program = Path(sys.executable).with_name("artemis")
    told = subprocess.run([program], env={**os.environ, **ask}, capture_output=True, text=True, timeout=PATIENCE)
    assert told.stdout.split() == offered
