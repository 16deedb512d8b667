"""Certificates for a page that other computers reach: an authority of this robot alone, and what it vouches for.

Made by the program `openssl`. The authority is installed in each browser once; the robot's certificate can be renewed.
"""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from contextlib import suppress
from ipaddress import ip_address
from pathlib import Path
from socket import gethostname
from tempfile import TemporaryDirectory

from artemis.errors import ConfigError
from artemis.page.access import key_place

CA_DAYS, DAYS = 3650, 820
"""How long they hold; iOS takes none that holds for more than 825 days (support.apple.com/en-us/103769)."""
_CURVE = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes"]


def place() -> Path:
    """The folder where they are kept."""
    return key_place().with_name("page")


def kept() -> tuple[Path, Path] | None:
    """The robot's certificate and its key, if they were made."""
    certificate, key = place() / "robot.pem", place() / "robot.key"
    return (certificate, key) if certificate.exists() and key.exists() else None


def names(given: Sequence[str]) -> list[str]:
    """Names and addresses that a certificate is for: this computer's, and those that are given."""
    host = gethostname()
    return list(dict.fromkeys([host, f"{host.split('.')[0]}.local", "localhost", "127.0.0.1", "::1", *given]))


def make(given: Sequence[str]) -> Path:
    """Make a certificate for these names, too, and the authority where there is none yet; the authority's certificate.

    Raises:
        ConfigError: there is no program `openssl`, it refuses, or the files cannot be written.
    """
    folder = place()
    ca, ca_key = folder / "ca.pem", folder / "ca.key"
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        if not (ca.exists() and ca_key.exists()):
            rights = ["-addext", "basicConstraints=critical,CA:TRUE,pathlen:0"]
            rights += ["-addext", "keyUsage=critical,keyCertSign,cRLSign"]
            subject = ["-subj", f"/CN=artemis on {gethostname()}"[:64]]
            _openssl("req", "-x509", *_CURVE, "-days", str(CA_DAYS), *subject, *rights, "-keyout", ca_key, "-out", ca)
        with TemporaryDirectory(dir=folder) as draft:
            request, about, key = (Path(draft) / name for name in ("csr", "ext", "key"))
            _openssl("req", "-new", *_CURVE, "-subj", "/CN=artemis", "-keyout", key, "-out", request)
            about.write_text(
                f"subjectAltName={','.join(map(_alternative, names(given)))}\nextendedKeyUsage=serverAuth\n"
            )
            signed: list[str | Path] = [
                "-CA",
                ca,
                "-CAkey",
                ca_key,
                "-CAcreateserial",
                "-days",
                str(DAYS),
                "-extfile",
                about,
            ]
            _openssl("x509", "-req", "-in", request, *signed, "-out", Path(draft) / "pem")
            key.chmod(0o600)
            key.rename(folder / "robot.key")
            (Path(draft) / "pem").rename(folder / "robot.pem")
    except OSError as error:
        raise ConfigError(f"{folder}: {error.strerror}") from None
    return ca


def _alternative(name: str) -> str:
    with suppress(ValueError):
        return f"IP:{ip_address(name)}"
    return f"DNS:{name}"


def _openssl(*arguments: str | Path) -> None:
    try:
        done = subprocess.run(["openssl", *map(str, arguments)], capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise ConfigError("the program openssl is needed: apt install openssl") from None
    if done.returncode:
        words = (done.stderr.strip().splitlines() or ["no reason was given"])[-1]
        raise ConfigError(f"openssl {arguments[0]}: {words}")
