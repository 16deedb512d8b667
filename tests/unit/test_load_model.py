from __future__ import annotations

from pathlib import Path

import pytest

from artemis.errors import ConfigError
from artemis.mission.loading import load_model
from artemis.sim.world import PlantParameters
from artemis.yaml_file import scalar


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0", 0),
        ("-1.5", -1.5),
        ("0x1F", 31),
        ("true", True),
        ("", None),
        ("null", None),
        ("vcan0", "vcan0"),
        ("239.74.163.2", "239.74.163.2"),
        ("PCAN_USBBUS1", "PCAN_USBBUS1"),
        ("/dev/ttyACM0", "/dev/ttyACM0"),
        ("'0'", "0"),
        ("yes", "yes"),
    ],
)
def test_a_scalar_means_what_it_means_in_a_file(text: str, value: object) -> None:
    found = scalar(text)
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    "text", ["010", ".nan", "[1]", "{a: 1}", "a: 1", "- 1", "'", "!!str 1", "*a", "\udcff", "a\n---\nb"]
)
def test_a_scalar_that_a_file_would_refuse_is_refused(text: str) -> None:
    with pytest.raises(ConfigError):
        scalar(text)


def test_a_model_is_read_from_a_file_of_its_own(tmp_path: Path) -> None:
    file = tmp_path / "true.yaml"
    file.write_text("slip: 0.01\nsupply: {battery_v: 24.0}\n")
    found = load_model(file, PlantParameters)
    assert (found.slip, found.supply.battery_v, found.wheel_scale_left) == (0.01, 24.0, 1.0)


def test_everything_wrong_with_a_model_is_said_in_the_order_of_its_lines(tmp_path: Path) -> None:
    file = tmp_path / "true.yaml"
    file.write_text("supply: {battery_v: 0}\nslip: 010\nwheel_scale: 1\nslip: 0.1\n")
    with pytest.raises(ConfigError) as caught:
        load_model(file, PlantParameters)
    assert [problem.removeprefix(f"{file}:").split(": ")[:2] for problem in caught.value.problems] == [
        ["1:10", "supply.battery_v"],
        ["2:1", "slip"],
        ["3:1", "wheel_scale"],
        ["4:1", "slip"],
    ]


@pytest.mark.parametrize("content", ["", "just words", "[1, 2]"])
def test_a_file_that_is_no_mapping_is_refused(tmp_path: Path, content: str) -> None:
    (tmp_path / "true.yaml").write_text(content)
    with pytest.raises(ConfigError, match="expected a mapping"):
        load_model(tmp_path / "true.yaml", PlantParameters)
