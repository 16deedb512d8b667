"""Maps as images: both formats of PGM, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from artemis.errors import ConfigError
from artemis.sim.grid import MapWords, grid_from, image_from

WORDS = {"image": "hall.pgm", "resolution": 0.5, "origin": [0.0, 0.0, 0.0]}


def test_raw_and_plain_images_are_the_same() -> None:
    raw = image_from(b"P5\n# made by hand\n3 2\n255\n" + bytes([0, 205, 254, 254, 254, 0]), "hall.pgm")
    plain = image_from(b"P2 3 2 255\n0 205 254\n254 254 0\n", "hall.pgm")
    assert raw.tolist() == plain.tolist() == [[0, 205, 254], [254, 254, 0]]


def test_other_depths_are_scaled() -> None:
    assert image_from(b"P2 2 1 15 0 15", "hall.pgm").tolist() == [[0, 255]]


@pytest.mark.parametrize(
    ("negate", "places"), [(0, {(0.0, 0.5)}), (1, {(0.5, 0.5), (1.0, 0.5), (0.0, 0.0), (0.5, 0.0), (1.0, 0.0)})]
)
def test_dark_cells_are_occupied_and_the_first_row_is_at_the_top(negate: int, places: set[tuple[float, float]]) -> None:
    image = image_from(b"P2 3 2 255\n0 205 254\n254 254 254\n", "hall.pgm")
    grid = grid_from(MapWords.model_validate({**WORDS, "negate": negate}), image)
    found = set()
    for x in (0.0, 0.5, 1.0):
        for y in (0.0, 0.5):
            inside = np.array([x + 0.25]), np.array([y + 0.25])
            if grid.distances(*inside, np.ones(1), np.zeros(1))[0] == 0.0:
                found.add((x, y))
    assert found == places


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        (b"", "expected an image in the format PGM"),
        (b"\x89PNG\r\n", "expected an image in the format PGM"),
        (b"P6 1 1 255 aaa", "expected an image in the format PGM"),
        (b"P5 3 2 255 abc", "ends after 3 of 6 pixels"),
        (b"P5 3 2 65535 abcdef", "3 x 2 pixels up to 65535"),
        (b"P5 999999999 999999999 255 a", "expected at most 40000000"),
        (b"P5 0 3 255 a", "0 x 3 pixels"),
        (b"P2 2 1 255 1 x", "expected whole numbers"),
    ],
)
def test_what_is_no_such_image_is_refused(data: bytes, problem: str) -> None:
    with pytest.raises(ConfigError) as refused:
        image_from(data, "hall.pgm")
    assert str(refused.value).startswith("hall.pgm: ")
    assert problem in str(refused.value)
