"""The codes that were used: one list for all pages of a user, so that each code pairs one browser.

A row is the SHA-256 of a code and when it expires; all rows have one length, so that one that is written over another
leaves whole rows.
"""

from __future__ import annotations

import errno
import fcntl
import os
import re
import stat
from hashlib import sha256
from pathlib import Path

from artemis.errors import ConfigError

ROW = 64 + 1 + 10 + 1
"""Bytes of a row."""
MOST_USED = 1000
"""Codes within the time that one is good."""
_ROWS = re.compile(rb"(?:[0-9a-f]{64} [0-9]{10}\n)*")


class UsedCodes:
    """A file that only its owner may read, locked while a code is taken."""

    def __init__(self, path: Path) -> None:
        """It is made when the first code is taken."""
        self._path = path

    def take(self, code: bytes, until: int, now: float) -> bool:
        """Use a code up that is good `until` then; whether it was unused. `now` and `until` in s since 1970.

        Raises:
            ConfigError: it is not known which were used, or this one cannot be noted. It was not used up.
        """
        name = self._path.name
        row = f"{sha256(code).hexdigest()} {until:010d}\n".encode()
        try:
            descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX)
                if (mode := stat.S_IMODE(os.fstat(descriptor).st_mode)) & 0o077:
                    raise ConfigError(f"{name}: its mode is {mode:04o}, so others can change it: chmod 600 {name}")
                known = os.pread(descriptor, MOST_USED * ROW + 1, 0)
                if _ROWS.fullmatch(known) is None:
                    raise ConfigError(
                        f"{name} is damaged, and no code is taken: remove it when ten minutes have passed, "
                        "so that no used code is good again"
                    )
                rows = [known[place : place + ROW] for place in range(0, len(known), ROW)]
                good = [each for each in rows if int(each[65:]) > now]
                if row in good:
                    return False
                if len(good) >= MOST_USED:
                    raise ConfigError(f"{name}: too many codes were used within ten minutes: try again later")
                _write(descriptor, b"".join([*good, row]), len(known))
            finally:
                os.close(descriptor)
        except OSError as error:
            raise ConfigError(f"{name}: {error.strerror}, so no code is taken") from None
        return True


def _write(descriptor: int, content: bytes, before: int) -> None:
    """Put it in place of the `before` bytes that were there. Raises OSError: the last row had no room."""
    whole = os.pwrite(descriptor, content, 0) == len(content)
    os.ftruncate(descriptor, len(content) if whole else before)
    os.fsync(descriptor)
    if not whole:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
