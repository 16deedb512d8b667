"""What the numbers of the gains mean: as the maker's documents have it, and the same whatever they are written in."""

from __future__ import annotations

import pytest

from artemis.drive_schema import SiGains
from artemis.families import EPOS1, EPOS2, EPOS4
from artemis.families.family import Family, GainScale
from artemis.sim.epos4_objects import objects4


def scale_of(family: Family) -> GainScale:
    assert family.gain_scale is not None
    return family.gain_scale


@pytest.mark.parametrize(
    ("place", "number", "si"),
    [
        (0, 832, 3.25),
        (1, 209, 8.17e3),
        (2, 1575, 31.5e-3),
        (3, 257, 1.29),
        (4, 386, 3.86),
        (5, 1193, 93.1),
        (6, 616, 49.3e-3),
    ],
    ids=["current P", "current I", "velocity P", "velocity I", "position P", "position I", "position D"],
)
def test_numbers_of_an_epos2_are_worth_what_its_maker_s_example_says(place: int, number: int, si: float) -> None:
    """EPOS2 Application Notes Collection, edition 2014, 9.5: gains beside their values in SI units, in three digits."""
    assert number * scale_of(EPOS2).units[place] == pytest.approx(si, rel=5e-3)


def test_an_epos4_leaves_the_factory_with_the_gains_of_the_first_generation() -> None:
    """The first's: its EDS, object 0x60FB; the EPOS4's: its EDS, objects 0x30A1 and 0x30A2."""
    factory = {(entry.index, entry.sub): entry.default for entry in objects4(1, 0x6150, 0x0170, 1)}
    numbers = [factory[gain.index, gain.subindex] for gain in EPOS4.gains]
    assert numbers[4:] == [1_500_000, 780_000, 16_000]
    assert numbers[2:4] == [20_000, 500_000]
    values = [int(number) * unit for number, unit in zip(numbers, scale_of(EPOS4).units, strict=True)]
    first = [number * unit for number, unit in zip((1000, 100, 150, 10, 200), scale_of(EPOS1).units[2:], strict=True)]
    assert values[2:] == pytest.approx(first)


def test_numbers_of_an_epos4_are_those_of_the_robot_file_and_back() -> None:
    gains = SiGains(current=(1.17188, 3906.25), velocity=(0.02, 0.5), position=(1.5, 0.78, 1e-5))
    assert gains.numbers == (1171880, 3906250, 20000, 500000, 1500000, 780000, 10)
    told = EPOS4.told_gains(gains.numbers)
    assert told == (1.17188, 3906.25, 0.02, 0.5, 1.5, 0.78, 1e-5)
    assert EPOS4.told_gains(gains.numbers[4:], 4) == told[4:]
    worth = [number * unit for number, unit in zip(gains.numbers, scale_of(EPOS4).units, strict=True)]
    assert worth == pytest.approx(told)
    assert EPOS1.told_gains((400, 120)) == (400, 120)
