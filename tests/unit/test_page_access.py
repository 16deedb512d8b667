"""Who may use a page: codes, cookies, the key's file, hosts and origins."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st

from artemis.errors import ConfigError
from artemis.page.access import CODE_TIME, MOST_GUESSES, PAIRED_TIME, Access, grouped, new_code, read_key
from artemis.page.used_codes import MOST_USED, ROW, UsedCodes

KEY = bytes(range(32))
START = datetime(2026, 5, 1, tzinfo=UTC)
PLACE = Path()
"""Of files of used codes, while these tests run."""


class Clock:
    now = START

    def __call__(self) -> datetime:
        return self.now


class Page(Access):
    """Waits for the answer."""

    def paired(self, code: str) -> str | None:
        return asyncio.run(self.pair(code))


def access(clock: Clock | None = None, key: bytes = KEY, *, tls: bool = False, used: Path | None = None) -> Page:
    """A page that remembers used codes in a file of its own, or in `used`."""
    return Page(key, 8480, used or PLACE / os.urandom(8).hex(), tls=tls, date=clock or Clock())


@pytest.fixture(scope="module", autouse=True)
def place() -> Iterator[None]:
    global PLACE
    with TemporaryDirectory() as made:
        PLACE = Path(made)
        yield


def test_a_code_pairs_once() -> None:
    clock = Clock()
    pages, code = access(clock), new_code(KEY, START)
    cookie = pages.paired(grouped(code).upper())
    assert pages.is_paired(cookie)
    assert pages.paired(code) is None
    clock.now += timedelta(seconds=PAIRED_TIME + 1)
    assert not pages.is_paired(cookie)


def test_a_code_that_another_process_took_pairs_nobody(tmp_path: Path) -> None:
    clock, code, used = Clock(), new_code(KEY, START), tmp_path / "page.used"
    assert access(clock, used=used).paired(code) is not None
    assert access(clock, used=used).paired(code) is None
    assert used.stat().st_mode & 0o777 == 0o600
    assert code.encode() not in used.read_bytes()
    assert access(clock, used=used).paired(new_code(KEY, START)) is not None
    assert used.stat().st_size == 2 * ROW
    clock.now += timedelta(seconds=CODE_TIME)
    assert access(clock, used=used).paired(new_code(KEY, clock.now)) is not None
    assert used.stat().st_size == ROW, "what cannot be used any more is forgotten"


def test_one_of_many_at_once_takes_a_code(tmp_path: Path) -> None:
    used = UsedCodes(tmp_path / "page.used")
    with ThreadPoolExecutor(8) as threads:
        assert sum(threads.map(lambda _: used.take(b"code", 100, 0.0), range(40))) == 1


@pytest.mark.parametrize(
    ("content", "mode", "words"),
    [
        (b"x", 0o600, "page.used is damaged, and no code is taken: remove it when ten minutes have passed"),
        (b"0" * ROW, 0o600, "is damaged"),
        (b"", 0o644, "page.used: its mode is 0644"),
        (b"".join(b"%064x 4000000000\n" % number for number in range(MOST_USED)), 0o600, "too many codes"),
    ],
)
def test_where_nobody_knows_what_was_used_no_code_is_taken(
    tmp_path: Path, content: bytes, mode: int, words: str
) -> None:
    used = tmp_path / "page.used"
    used.write_bytes(content)
    used.chmod(mode)
    with pytest.raises(ConfigError, match=words):
        access(used=used).paired(new_code(KEY, START))
    assert used.read_bytes() == content


def test_a_code_that_cannot_be_noted_is_not_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigError, match="nowhere: No such file or directory"):
        access(used=tmp_path / "missing" / "nowhere").paired(new_code(KEY, START))
    used, write = tmp_path / "page.used", os.pwrite
    assert access(used=used).paired(new_code(KEY, START)) is not None
    before = used.read_bytes()
    monkeypatch.setattr(os, "pwrite", lambda file, content, at: write(file, content[: ROW + 5], at))
    with pytest.raises(ConfigError, match=r"page\.used: No space left"):
        access(used=used).paired(new_code(KEY, START))
    assert used.read_bytes() == before


def test_a_code_ages() -> None:
    clock = Clock()
    clock.now += timedelta(seconds=CODE_TIME)
    assert access(clock).paired(new_code(KEY, START)) is None


def test_a_page_that_is_started_again_knows_its_browsers() -> None:
    cookie = access().paired(new_code(KEY, START))
    assert access().is_paired(cookie)
    assert not access(key=bytes(32)).is_paired(cookie)


def test_a_cookie_is_no_code_and_a_code_no_cookie() -> None:
    cookie = access().paired(new_code(KEY, START))
    assert cookie is not None
    assert access().paired(cookie) is None
    assert not access().is_paired(new_code(KEY, START))


@given(st.text())
def test_anything_else_is_neither(text: str) -> None:
    assert access().paired(text) is None
    assert not access().is_paired(text)


def test_guessing_ends_soon() -> None:
    clock = Clock()
    pages = access(clock)
    for _ in range(MOST_GUESSES):
        pages.paired("nonsense")
    assert pages.paired(new_code(KEY, START)) is None
    clock.now += timedelta(seconds=61)
    assert pages.paired(new_code(KEY, START)) is not None


@pytest.mark.parametrize("host", ["127.0.0.1:8480", "localhost:8480", "[::1]:8480", "192.168.1.7", "[fe80::1]"])
def test_addresses_in_numbers_are_ours(host: str) -> None:
    assert access().is_our_host(host)


@pytest.mark.parametrize("host", ["", "evil.example", "evil.example:8480", "127.0.0.1.evil.example", "localhost.evil"])
def test_names_of_others_are_not(host: str) -> None:
    assert not access().is_our_host(host)


def test_only_pages_of_this_server_may_ask() -> None:
    host = "127.0.0.1:8480"
    assert access().is_our_origin("http://127.0.0.1:8480", host)
    assert access(tls=True).is_our_origin("https://127.0.0.1:8480", host)
    for origin in (None, "null", "http://evil.example", "https://127.0.0.1:8480", "http://127.0.0.1:9000"):
        assert not access().is_our_origin(origin, host)


def test_the_key_is_made_once_for_its_owner_alone(tmp_path: Path) -> None:
    place = tmp_path / "deep" / "page.key"
    key = read_key(place)
    assert (len(key), read_key(place), place.stat().st_mode & 0o777) == (32, key, 0o600)
    place.chmod(0o644)
    with pytest.raises(ConfigError, match="chmod 600"):
        read_key(place)
    place.chmod(0o600)
    place.write_text("no key")
    with pytest.raises(ConfigError, match="is no key of a page"):
        read_key(place)
    with pytest.raises(ConfigError, match=r"page\.key"):
        read_key(tmp_path / "deep" / "page.key" / "page.key")
