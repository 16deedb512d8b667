"""Everything that fuzzing ever found, and a short run of it that is always the same."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice
from pathlib import Path
from random import Random

import pytest

from .fuzzing import Mutate, Target, TooSlow, attempt, inputs, mutate_bytes, mutate_text
from .targets import targets

CORPUS = Path(__file__).parent / "corpus"
FOUND = sorted(path for path in CORPUS.glob("*/*"))
INPUTS = {
    "decoders": 1000,
    "drives": 100,
    "sdo": 100,
    "hid": 300,
    "sim_epos": 40,
    "sim_epos4": 20,
    "sim_cia402": 20,
    "recording": 100,
    "journal": 300,
    "mission": 120,
    "robot": 30,
    "path": 60,
}
"""By target; the seeds are the first of them."""


@pytest.fixture(scope="module")
def fuzzed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Target]:
    return {target.name: target for target in targets(tmp_path_factory.mktemp("fuzz"))}


@pytest.mark.parametrize("path", FOUND, ids=lambda path: f"{path.parent.name}-{path.name}")
def test_what_was_found_does_not_happen_again(fuzzed: dict[str, Target], path: Path) -> None:
    attempt(fuzzed[path.parent.name], path.read_bytes())


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", INPUTS)
def test_no_input_lets_anything_out(fuzzed: dict[str, Target], name: str) -> None:
    for data in islice(inputs(fuzzed[name], Random(f"{name} in short")), INPUTS[name]):
        attempt(fuzzed[name], data)


def test_every_target_has_a_short_run_and_every_finding_a_target(fuzzed: dict[str, Target]) -> None:
    assert set(INPUTS) == set(fuzzed)
    assert {path.parent.name for path in FOUND} <= set(fuzzed)


# ---------------------------------------------------------------------------------------------- the machinery


def planted(data: bytes) -> None:
    if data[:1] == b"(" and data[-1:] != b")":
        raise KeyError("the bracket is not closed")
    while data.endswith(b"~"):
        len(data)


PLANTED = Target(name="planted", attempt=planted, seeds=[b"(a)", b"~ b"], mutate=mutate_bytes, steps=1000)


def test_what_comes_out_and_what_takes_too_long_is_found() -> None:
    found = set()
    for data in islice(inputs(PLANTED, Random(1)), 5000):
        try:
            attempt(PLANTED, data)
        except (KeyError, TooSlow) as error:
            found.add(type(error))
    assert found == {KeyError, TooSlow}


@pytest.mark.parametrize("mutate", [mutate_bytes, mutate_text])
def test_a_seed_gives_the_same_inputs_always(mutate: Mutate) -> None:
    target = Target(name="same", attempt=planted, seeds=[b"a: [1, 2]\nb: c\n", b""], mutate=mutate, steps=0)
    first, second = (list(islice(inputs(target, Random(7)), 200)) for _ in range(2))
    assert first == second
    assert len(set(first)) > 100


def test_steps_are_counted_by_the_size_of_the_input() -> None:
    def count(data: bytes) -> None:
        for _ in data:
            len(data)

    target = Target(name="count", attempt=count, seeds=[], mutate=mutate_text, steps=1050)
    assert 3000 < attempt(target, bytes(3000)) < 3050
    with pytest.raises(TooSlow, match="more than 1050 calls for 999 bytes"):
        attempt(replace(target, attempt=planted), b"~" * 999)
