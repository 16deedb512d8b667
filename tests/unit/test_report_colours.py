"""Colours that share a chart or the map can be told apart by everybody, and be seen on the page."""

from __future__ import annotations

import re
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from artemis.motion.arrays import Array

STYLE = (Path(__file__).parents[2] / "artemis/static/report/report.css").read_text()
LIGHT, _, REST = STYLE.partition("@media (prefers-color-scheme: dark)")
DARK = REST.partition("* {")[0]
VISION = {
    "normal": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
"""What is left of linear RGB, severity 1.0: Machado, Oliveira and Fernandes (2009), A physiologically-based model for
simulation of color vision deficiency."""
TOGETHER = [
    ("reference", "estimated"),
    ("true", "estimated"),
    ("true", "estimated", "odometry"),
    ("estimated", "second"),
    ("r0", "r1"),
    ("event-fault", "event-request"),
    ("mode-fault", "mode-follow", "mode-ready"),
    ("state-fault", "state-enabled", "state-off", "state-rising"),
    ("state-fault", "state-stopping"),
]


def colours(theme: str) -> dict[str, Array]:
    """Linear RGB of the variables."""
    given = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", LIGHT))
    if theme == "dark":
        given |= dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", DARK))
    rgb = {name: np.array([int(text[at : at + 2], 16) for at in (1, 3, 5)]) / 255 for name, text in given.items()}
    return {name: np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4) for name, c in rgb.items()}


def lab(linear: Array) -> Array:
    """CIE 1976 L*a*b* of linear sRGB, white D65 (IEC 61966-2-1)."""
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    xyz = np.array(to_xyz) @ np.clip(linear, 0.0, 1.0) / [0.9505, 1.0, 1.089]
    f = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("vision", VISION)
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_signals_differ_for_every_colour_vision(theme: str, vision: str) -> None:
    known, seen = colours(theme), np.array(VISION[vision])
    for names in TOGETHER:
        for a, b in combinations(names, 2):
            apart = np.linalg.norm(lab(seen @ known[a]) - lab(seen @ known[b]))
            assert apart > 15, f"{a} and {b}: {apart:.0f}"  # 2.3 is what can just be noticed


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_signals_stand_out_from_the_page(theme: str) -> None:
    known = colours(theme)
    luminance = {name: float(np.array([0.2126, 0.7152, 0.0722]) @ c) for name, c in known.items()}
    paper = luminance["paper"]
    for name in ("ink", "alarm", "good", "estimated", "true", "second", "odometry", "slowed", "r0", "r1"):
        contrast = (max(luminance[name], paper) + 0.05) / (min(luminance[name], paper) + 0.05)
        assert contrast >= 3.0, f"{name}: {contrast:.1f}"  # Web Content Accessibility Guidelines 2.1, 1.4.11
