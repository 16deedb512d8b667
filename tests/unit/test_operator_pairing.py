"""The shared secret: phrases that people type, and the file that keeps it."""

from __future__ import annotations

import os
import re
import stat
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from artemis.bridges.operator import pairing
from artemis.bridges.operator.pairing import (
    ALPHABET,
    default_place,
    new_phrase,
    phrase_from,
    read_secret,
    secret_from,
    write_secret,
)
from artemis.errors import ConfigError

SECRET = bytes(range(32))


def test_a_phrase_is_short_and_has_70_random_bits() -> None:
    phrases = {new_phrase() for _ in range(200)}
    assert len(phrases) == 200
    assert all(re.fullmatch(r"([0-9a-z]{4}-){3}[0-9a-z]{4}", phrase) for phrase in phrases)
    assert len(ALPHABET) == len(set(ALPHABET)) == 32
    assert pairing.RANDOM * 5 == 70


@given(st.booleans(), st.sampled_from(["", " ", "-"]))
def test_a_phrase_may_be_typed_as_people_do(capitals: bool, between: str) -> None:
    phrase = new_phrase()
    typed = phrase.replace("-", between).replace("1", "l").replace("0", "O")
    assert phrase_from(f" {typed.upper() if capitals else typed}\n") == phrase


def test_a_slip_is_noticed() -> None:
    """One wrong letter: 10 bits let one slip in 1000 through."""
    phrase = "0000-0000-0000-00" + pairing._check("0" * 14)
    assert phrase_from(phrase) == phrase
    missed = 0
    for place in range(14):
        plain = phrase.replace("-", "")
        for letter in ALPHABET[1:]:
            with suppress(ConfigError):
                phrase_from(plain[:place] + letter + plain[place + 1 :])
                missed += 1
    assert missed <= 3
    with pytest.raises(ConfigError, match="a letter is wrong"):
        phrase_from("1" + phrase[1:])
    for typed in ("", "abc", phrase + "0", phrase.replace("0", "!", 1)):
        with pytest.raises(ConfigError, match="expected 16 letters and digits"):
            phrase_from(typed)


def test_the_secret_of_a_phrase_is_the_same_everywhere() -> None:
    assert secret_from("0000-0000-0000-0000").hex().startswith(KNOWN)


KNOWN = "669e4821ccc1be57"
"""scrypt(b"0000000000000000", salt=b"artemis operator 1", N=2**16, r=8, p=1), its first bytes."""


def test_only_its_owner_may_read_the_secret(tmp_path: Path) -> None:
    place = tmp_path / "new" / "operator.secret"
    write_secret(place, SECRET)
    assert stat.S_IMODE(place.stat().st_mode) == 0o600
    assert stat.S_IMODE(place.parent.stat().st_mode) == 0o700
    assert os.listdir(place.parent) == ["operator.secret"]
    assert read_secret(place) == SECRET
    with pytest.raises(ConfigError, match="there is a secret already; --force replaces it"):
        write_secret(place, bytes(32))
    assert read_secret(place) == SECRET
    write_secret(place, bytes(32), force=True)
    assert read_secret(place) == bytes(32)


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o666, 0o610])
def test_a_secret_that_others_can_read_is_refused(tmp_path: Path, mode: int) -> None:
    place = tmp_path / "operator.secret"
    write_secret(place, SECRET)
    place.chmod(mode)
    with pytest.raises(ConfigError, match=rf"its mode is {mode:04o}, so others can read it: chmod 600 {place}"):
        read_secret(place)


@pytest.mark.parametrize("content", [b"", b"secret", b"artemis-operator-1 00\n", b"\xff\xfe", b"artemis-operator-1 zz"])
def test_a_damaged_secret_is_refused(tmp_path: Path, content: bytes) -> None:
    place = tmp_path / "operator.secret"
    place.write_bytes(content)
    place.chmod(0o600)
    with pytest.raises(ConfigError, match="is no secret of artemis"):
        read_secret(place)


def test_a_secret_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there is no secret yet: artemis operator pair"):
        read_secret(tmp_path / "none")
    with pytest.raises(ConfigError, match="Is a directory"):
        read_secret(tmp_path)
    os.mkfifo(tmp_path / "fifo")
    with pytest.raises(ConfigError, match="is no file"):
        read_secret(tmp_path / "fifo")
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="File exists"):
        write_secret(tmp_path / "file" / "secret", SECRET)


def test_its_place_follows_the_system(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert default_place() == tmp_path / "artemis/operator.secret"
    monkeypatch.setenv("XDG_CONFIG_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert default_place() == tmp_path / ".config/artemis/operator.secret"
