"""The secret that a robot and its operators share: made from a phrase that a person types, kept in a file of its own.

A phrase is made here, never chosen: 70 random bits and 10 to notice a slip, in 16 letters and digits. An eavesdropper
of a handshake can try phrases; scrypt (RFC 7914) makes each try cost 64 MiB and about 2^21 rounds of Salsa20/8.
"""

from __future__ import annotations

import hashlib
import os
import secrets
import stat
from contextlib import suppress
from pathlib import Path

from artemis.errors import ConfigError
from artemis.user_folders import user_folder

ALPHABET = "0123456789abcdefghjkmnpqrstvwxyz"
"""Base 32 without the letters i, l, o, u, as Crockford's."""
RANDOM, CHECK, GROUP = 14, 2, 4
"""Characters drawn, characters that check them, and characters between two hyphens."""
SALT = b"artemis operator 1"
"""One for all: both sides know nothing but the phrase. Its 70 bits are too many for a table made in advance."""
COST, BLOCK, MEMORY = 2**16, 8, 2**27
"""Of scrypt: N, r, and the most memory that it may use [bytes]."""
KEY_BYTES = 32
_HEAD = "artemis-operator-1 "
_ALIKE = str.maketrans("ilo", "110")


def new_phrase() -> str:
    """A phrase from the system's random numbers."""
    drawn = "".join(secrets.choice(ALPHABET) for _ in range(RANDOM))
    text = drawn + _check(drawn)
    return "-".join(text[place : place + GROUP] for place in range(0, len(text), GROUP))


def phrase_from(typed: str) -> str:
    """What was typed, as `new_phrase` writes it: spaces, hyphens and capitals do not matter, i, l and o are digits.

    Raises:
        ConfigError: it is no phrase, or one letter is wrong.
    """
    text = "".join(typed.lower().split()).replace("-", "").translate(_ALIKE)
    if len(text) != RANDOM + CHECK or not set(text) <= set(ALPHABET):
        raise ConfigError(f"phrase: expected {RANDOM + CHECK} letters and digits, as `artemis operator pair` made them")
    if text[RANDOM:] != _check(text[:RANDOM]):
        raise ConfigError("phrase: a letter is wrong: compare it with the other side's")
    return "-".join(text[place : place + GROUP] for place in range(0, len(text), GROUP))


def secret_from(phrase: str) -> bytes:
    """The secret that a phrase stands for."""
    return hashlib.scrypt(
        phrase.replace("-", "").encode(), salt=SALT, n=COST, r=BLOCK, p=1, maxmem=MEMORY, dklen=KEY_BYTES
    )


def default_place() -> Path:
    """Where the secret is kept."""
    return user_folder("XDG_CONFIG_HOME", ".config") / "operator.secret"


def write_secret(path: Path, secret: bytes, *, force: bool = False) -> None:
    """Keep a secret where its owner alone may read it (mode 0600).

    Raises:
        ConfigError: there is one already and `force` is not set, or the file cannot be written.
    """
    text = f"{_HEAD}{secret.hex()}\n"
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        if path.exists() and not force:
            raise ConfigError(f"{path}: there is a secret already; --force replaces it, and all others pair again")
        draft = path.with_name(f".{path.name}.{os.getpid()}")
        descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        try:
            with os.fdopen(descriptor, "w", encoding="ascii") as file:
                file.write(text)
            os.replace(draft, path)
        finally:
            with suppress(FileNotFoundError):
                draft.unlink()
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from None


def read_secret(path: Path) -> bytes:
    """The secret in a file.

    Raises:
        ConfigError: there is none, others may read it, or it is damaged.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(descriptor, "rb") as file:
            found = os.fstat(file.fileno())
            if not stat.S_ISREG(found.st_mode):
                raise ConfigError(f"{path}: is no file")
            mode = stat.S_IMODE(found.st_mode)
            if mode & 0o077:
                raise ConfigError(f"{path}: its mode is {mode:04o}, so others can read it: chmod 600 {path}")
            content = file.read(1024)
    except FileNotFoundError:
        raise ConfigError(f"{path}: there is no secret yet: artemis operator pair") from None
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from None
    with suppress(ValueError):
        text = content.decode("ascii")
        if text.startswith(_HEAD) and len(key := bytes.fromhex(text.removeprefix(_HEAD))) == KEY_BYTES:
            return key
    raise ConfigError(f"{path}: is no secret of artemis: artemis operator pair --force makes a new one")


def _check(drawn: str) -> str:
    digest = hashlib.sha256(drawn.encode()).digest()
    return ALPHABET[digest[0] % 32] + ALPHABET[digest[1] % 32]
