"""Access to a page: browsers that were paired by a one-time code, which have a cookie; the addresses of requests.

A code and a cookie are a few bytes with an HMAC-SHA256 (RFC 2104) under the page's key, which its owner alone can read.
So a page that is started again knows its browsers, and another process of the same user can make codes.
"""

from __future__ import annotations

import asyncio
import base64
import binascii
import hmac
import os
import secrets
import struct
from collections.abc import Callable, Iterable
from contextlib import suppress
from datetime import datetime
from ipaddress import ip_address
from pathlib import Path
from socket import gethostname

from artemis.bridges.operator.pairing import default_place
from artemis.clock import wall_date
from artemis.errors import ConfigError
from artemis.page.used_codes import UsedCodes

CODE_TIME, PAIRED_TIME = 600, 90 * 86400
"""Validity of a code, and of the cookie of a paired browser [s]."""
KEY_BYTES, TAG, NONCE = 32, 10, 6
MOST_GUESSES, GUESS_TIME = 20, 60.0
"""Highest number of wrong codes within this time [s]; after that no code is checked."""
_HEAD = struct.Struct(">I")
_CODE, _COOKIE = b"code", b"cookie"


def key_place() -> Path:
    """Where the page's key is kept."""
    return default_place().with_name("page.key")


def used_place() -> Path:
    """Where it is kept which codes were used."""
    return key_place().with_name("page.used")


def read_key(path: Path) -> bytes:
    """The page's key; made where there is none.

    Raises:
        ConfigError: others can read it, it is damaged, or it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        with suppress(FileExistsError):
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(descriptor, "wb") as file:
                file.write(secrets.token_hex(KEY_BYTES).encode())
        if (mode := path.stat().st_mode) & 0o077:
            raise ConfigError(f"{path}: its mode is {mode & 0o777:04o}, so others can read it: chmod 600 {path}")
        key = bytes.fromhex(path.read_text(encoding="ascii"))
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from None
    except ValueError:
        key = b""
    if len(key) != KEY_BYTES:
        raise ConfigError(f"{path}: is no key of a page: remove it, and a new one is made; browsers pair again")
    return key


def new_code(key: bytes, now: datetime | None = None) -> str:
    """A code that pairs one browser, within `CODE_TIME`."""
    return _signed(key, _CODE, _seconds(now) + CODE_TIME)


class Access:
    """Of one page; which codes were used all pages with the same key know."""

    def __init__(
        self,
        key: bytes,
        port: int,
        used: Path,
        *,
        tls: bool,
        names: Iterable[str] = (),
        date: Callable[[], datetime] = wall_date,
    ) -> None:
        """A page at `port`, with or without TLS, that browsers reach by these `names`, too; `date` on the wall.

        `used`: the file of used codes (`used_place`).
        """
        own = gethostname().lower()
        self._names = {"localhost", own, f"{own.split('.')[0]}.local", *map(str.lower, names)}
        self._key, self._date, self._tls = key, date, tls
        self.cookie = f"artemis-{port}"
        """Its name: browsers share cookies between the ports of a computer."""
        self._used = UsedCodes(used)
        self._wrong: list[float] = []

    async def pair(self, code: str) -> str | None:
        """The value of a cookie for a code; None: it is wrong, too old, or was used.

        Raises:
            ConfigError: it is not known which codes were used, or that cannot be noted.
        """
        now = self._date()
        self._wrong = [then for then in self._wrong if now.timestamp() - then < GUESS_TIME]
        if len(self._wrong) >= MOST_GUESSES:
            return None
        until = _opened(self._key, _CODE, code, now)
        # The disk may be slow, and Stop uses the same loop; only a valid code starts a thread that waits.
        if until is None or not await asyncio.to_thread(self._used.take, _plain(code), until, now.timestamp()):
            self._wrong.append(now.timestamp())
            return None
        return _signed(self._key, _COOKIE, _seconds(now) + PAIRED_TIME)

    def is_paired(self, cookie: str | None) -> bool:
        """Whether a cookie's value is one of ours."""
        return cookie is not None and _opened(self._key, _COOKIE, cookie, self._date()) is not None

    def is_our_host(self, host: str) -> bool:
        """Whether a request's Host is this computer: a foreign name that resolves to it is not (DNS rebinding).

        An address in numbers cannot be made to lead elsewhere.
        """
        name = host.rsplit(":", 1)[0] if not host.endswith("]") else host
        name = name.strip("[]").lower()
        if name in self._names:
            return True
        with suppress(ValueError):
            ip_address(name)
            return True
        return False

    def is_our_origin(self, origin: str | None, host: str) -> bool:
        """Whether a request comes from a page of this server."""
        return origin == f"{'https' if self._tls else 'http'}://{host}"


def grouped(code: str) -> str:
    """A code as people read it."""
    return "-".join(code[place : place + 4] for place in range(0, len(code), 4))


def _seconds(date: datetime | None) -> int:
    return int((date or wall_date()).timestamp())


def _signed(key: bytes, kind: bytes, until: int) -> str:
    body = _HEAD.pack(until) + secrets.token_bytes(NONCE)
    return base64.b32encode(body + _tag(key, kind, body)).decode().lower()


def _plain(text: str) -> bytes:
    try:
        letters = "".join(text.split()).replace("-", "").upper().encode("ascii")
        return base64.b32decode(letters)
    except (UnicodeEncodeError, binascii.Error):
        return b""


def _opened(key: bytes, kind: bytes, text: str, now: datetime) -> int | None:
    """Until when what was signed is good [s since 1970]; None: it is not."""
    raw = _plain(text)
    body, tag = raw[: _HEAD.size + NONCE], raw[_HEAD.size + NONCE :]
    if len(raw) != _HEAD.size + NONCE + TAG or not hmac.compare_digest(_tag(key, kind, body), tag):
        return None
    (until,) = _HEAD.unpack(body[: _HEAD.size])
    return int(until) if now.timestamp() < until else None


def _tag(key: bytes, kind: bytes, body: bytes) -> bytes:
    return hmac.digest(key, kind + body, "sha256")[:TAG]
