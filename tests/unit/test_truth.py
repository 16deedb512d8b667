from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from artemis.errors import ConfigError
from artemis.motion.trajectory import Trajectory
from artemis.motion.truth import as_tum, truth_from


def drawn(seed: int, count: int = 100) -> Trajectory:
    random = np.random.default_rng(seed)
    poses = np.cumsum(random.normal(size=(count, 3)) * [0.5, 0.5, 0.6], axis=0)
    return Trajectory(time=random.uniform(-1e3, 1e3) + np.cumsum(random.uniform(0.01, 0.1, count)), poses=poses)


@pytest.mark.parametrize("seed", range(5))
def test_tum_is_read_as_it_was_written(seed: int) -> None:
    one = drawn(seed)

    other = truth_from(as_tum(one), "truth.txt")

    np.testing.assert_allclose(other.time, one.time, rtol=0, atol=1e-9)
    np.testing.assert_allclose(other.poses[:, :2], one.poses[:, :2], rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.exp(1j * other.poses[:, 2]), np.exp(1j * one.poses[:, 2]), rtol=0, atol=1e-11)


def test_places_without_heading_are_read_as_they_were_written() -> None:
    places = drawn(1).poses
    places[:, 2] = np.nan

    assert not truth_from(as_tum(Trajectory(time=np.arange(100.0), poses=places)), "places.tum").knows_heading


@pytest.mark.parametrize("seed", range(10))
def test_the_heading_of_a_slightly_tilted_tracker_is_that_of_its_x_axis(seed: int) -> None:
    random = np.random.default_rng(seed)
    turned = Rotation.from_euler("ZYX", [random.uniform(-3, 3), *random.uniform(-0.1, 0.1, 2)])
    ahead = turned.apply([1.0, 0.0, 0.0])
    quaternion = " ".join(map(str, turned.as_quat()))

    found = truth_from(f"0 0 0 0 {quaternion}\n1 1 0 0 {quaternion}\n", "t.tum")

    assert found.poses[0, 2] == pytest.approx(math.atan2(ahead[1], ahead[0]), abs=1e-9)


@pytest.mark.parametrize(
    "text",
    [
        "time_s,x_m,y_m,heading_rad\n1.5,2,3,0.5\n2.5,3,3,0.5\n",
        "y_m;x_m;heading_deg;t\n3;2;28.64788975654116;1.5\n3;3;28.64788975654116;2.5\n",
        "# by the tracker\n1.5 2 3 0.5\n\n2.5 3 3 0.5  # the end\n",
        "\ufefftimestamp,x,y,yaw\r\n1.5,2,3,0.5\r\n2.5,3,3,0.5\r\n",
    ],
)
def test_tables_are_read_by_their_header(text: str) -> None:
    found = truth_from(text, "truth.csv")

    np.testing.assert_allclose(found.time, [1.5, 2.5])
    np.testing.assert_allclose(found.poses, [[2, 3, 0.5], [3, 3, 0.5]])


def test_a_table_may_know_no_heading() -> None:
    assert not truth_from("time_s,x_m,y_m\n0,0,0\n1,1,0\n", "truth.csv").knows_heading


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("time_s,x_m,y_m\n0,0,0\n0,1,0\n", "f:3:1: time 0 s follows 0 s; expected a later one"),
        ("time_s,x_m,y_m\n5,0,0\n4,1,0\n", "f:3:1: time 4 s follows 5 s; expected a later one"),
        ("time_s,x_m,y_m,z_up\n0,0,0,0\n", "f:1:16: unknown column 'z_up'"),
        ("time_s,x_m\n0,0\n", "no y"),
        ("time_s,x_m,y_m\n0,0,nan\n", "f:2:5: y: expected a finite number, found 'nan'"),
        ("time_s,x_m,y_m\n0,0\n", "f:2:3: expected 3 columns"),
        ("time_s,x_m,y_m,heading_deg,heading_rad\n0,0,0,0,0\n", "both in rad and in degrees"),
        ("time_s,x_m,y_m\n", "f:1:1: no poses"),
        ("", "no rows: expected a line with the columns, such as time,x,y, and rows below it, such as 0,0.5,1"),
        ("0 1 2 0 0 0 0 2\n", "f:1:9: expected a quaternion of length 1, found 2"),
        ("0 1 2 0 0 0 0 0\n", "f:1:9: expected a quaternion of length 1, found 0"),
        ("0 1 2 0 0.7071 0 0 0.7071\n", "f:1:9: tilted by 90 degrees; expected a turn about z"),
        ("0 1 2 0 0 0 0 1\n0 1 2 0 0 0 0 1\n", "f:2:1: time 0 s follows 0 s"),
        ("0 1 2 0 0 0 0 1\n1 1 2 0 0 0 1\n", "f:2:13: expected 8 columns"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(text: str, problem: str) -> None:
    with pytest.raises(ConfigError) as caught:
        truth_from(text, "f")

    assert problem in str(caught.value)


def test_a_tum_file_is_known_by_its_name() -> None:
    with pytest.raises(ConfigError, match="expected the columns time, x, y, z, qx, qy, qz, qw"):
        truth_from("0 1 2\n", "truth.tum.gz")


def test_a_file_of_another_kind_is_refused_in_few_words() -> None:
    with pytest.raises(ConfigError) as caught:
        truth_from("0 1 2 0 0 0 0 9\n" * 5000, "f.tum")

    assert len(caught.value.problems) < 30
