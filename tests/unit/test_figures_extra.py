"""matplotlib is an extra: a command that draws figures says so before it does anything, others need none."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from artemis.build import install
from artemis.commands.calibrate_gains import Wanted, calibrate_gains
from artemis.commands.calibrate_odometry import calibrate_closing, calibrate_with_truth
from artemis.commands.gains_auto import calibrate_auto
from artemis.commands.map_show import show_map
from artemis.commands.path_show import show_paths
from artemis.commands.report import report
from artemis.errors import ConfigError
from artemis_lab.commands import bench_followers, bench_transport

MISSIONS = Path(__file__).parents[2] / "missions"
EIGHT = MISSIONS / "figure_eight.yaml"
NOWHERE = Path("/nonexistent")
CHOICE = bench_followers.Selection(followers=[], courses=[], seed=1, robot=None, random=0, frames=False, checkout=None)
TRIED, AUTO = Wanted(gains={}, tried=True, simulate=True), Wanted(gains={}, simulate=True)


@pytest.mark.parametrize(
    ("what", "command"),
    [
        ("--output", lambda out: show_paths([MISSIONS / "paths/figure_eight.csv"], None, None, out / "path.png")),
        ("--output", lambda out: show_map(MISSIONS / "maps/hall.yaml", out / "map.png")),
        ("--truth", lambda out: report(NOWHERE, "simulation", None, None, False, None)),
        ("--output", lambda out: bench_transport.measure(115200, 0.016, 0.0001, out / "figure.png")),
        ("bench followers", lambda out: bench_followers.measure(CHOICE, out)),
        ("calibrate odometry", lambda out: calibrate_with_truth([NOWHERE], ["simulation"], None, [], out, None)),
        ("calibrate odometry", lambda out: calibrate_closing([NOWHERE], None, None, out, None)),
        ("calibrate gains", lambda out: calibrate_gains(EIGHT, TRIED)),
        ("calibrate gains", lambda out: calibrate_auto(EIGHT, AUTO)),
    ],
)
def test_a_command_that_draws_says_what_to_install_and_does_nothing(
    what: str,
    command: Callable[[Path], object],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ConfigError) as refused:
        command(tmp_path)
    assert str(refused.value) == f"{what} draws figures, and needs the package matplotlib: {install('figures')}"
    assert capsys.readouterr().out == ""
    assert list(tmp_path.iterdir()) == []


def test_what_draws_no_figure_needs_no_matplotlib(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == "matplotlib"] + ["matplotlib"]:
        monkeypatch.setitem(sys.modules, name, None)
    assert show_paths([MISSIONS / "paths/figure_eight.csv"], None, None, None) == 0
    show_map(MISSIONS / "maps/hall.yaml", None)
    bench_transport.measure(115200, 0.016, 0.0001, None)
    assert "length    16.010 m" in capsys.readouterr().out
