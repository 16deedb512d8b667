"""What stands in pages comes with artemis, is what was released, and is packed with it."""

from __future__ import annotations

import hashlib
import tomllib
from importlib.resources import files
from pathlib import Path

STATIC = Path(str(files("artemis"))) / "static"
FOREIGN = ["uplot"]


def test_files_of_others_are_unchanged_and_come_with_their_licence() -> None:
    for name in FOREIGN:
        folder = STATIC / name
        sums = dict(line.split()[::-1] for line in (folder / "SHA256SUMS").read_text().splitlines())
        held = {each.name for each in folder.iterdir()} - {"SHA256SUMS", "README.md"}
        assert held == set(sums)
        assert "LICENSE" in held
        for file, expected in sums.items():
            assert hashlib.sha256((folder / file).read_bytes()).hexdigest() == expected, file


def test_every_static_file_is_package_data() -> None:
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())
    root = STATIC.parent
    packed = {
        each for pattern in project["tool"]["setuptools"]["package-data"]["artemis"] for each in root.glob(pattern)
    }

    assert {each for each in STATIC.rglob("*") if each.is_file()} <= packed
