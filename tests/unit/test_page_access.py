"""Who may use a page: codes, cookies, the key's file, hosts and origins."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from artemis.errors import ConfigError
from artemis.page.access import CODE_TIME, MOST_GUESSES, PAIRED_TIME, Access, grouped, new_code, read_key

KEY = bytes(range(32))
START = datetime(2026, 5, 1, tzinfo=UTC)


class Clock:
    now = START

    def __call__(self) -> datetime:
        return self.now


def access(clock: Clock | None = None, key: bytes = KEY, *, tls: bool = False) -> Access:
    return Access(key, 8480, tls=tls, date=clock or Clock())


def test_a_code_pairs_once() -> None:
    clock = Clock()
    pages, code = access(clock), new_code(KEY, START)
    cookie = pages.pair(grouped(code).upper())
    assert pages.is_paired(cookie)
    assert pages.pair(code) is None
    clock.now += timedelta(seconds=PAIRED_TIME + 1)
    assert not pages.is_paired(cookie)


def test_a_code_ages() -> None:
    clock = Clock()
    clock.now += timedelta(seconds=CODE_TIME)
    assert access(clock).pair(new_code(KEY, START)) is None


def test_a_page_that_is_started_again_knows_its_browsers() -> None:
    cookie = access().pair(new_code(KEY, START))
    assert access().is_paired(cookie)
    assert not access(key=bytes(32)).is_paired(cookie)


def test_a_cookie_is_no_code_and_a_code_no_cookie() -> None:
    cookie = access().pair(new_code(KEY, START))
    assert cookie is not None
    assert access().pair(cookie) is None
    assert not access().is_paired(new_code(KEY, START))


@given(st.text())
def test_anything_else_is_neither(text: str) -> None:
    assert access().pair(text) is None
    assert not access().is_paired(text)


def test_guessing_ends_soon() -> None:
    clock = Clock()
    pages = access(clock)
    for _ in range(MOST_GUESSES):
        pages.pair("nonsense")
    assert pages.pair(new_code(KEY, START)) is None
    clock.now += timedelta(seconds=61)
    assert pages.pair(new_code(KEY, START)) is not None


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
