"""What a command says of a recording that is damaged or cut off, once it has read it."""

from __future__ import annotations

import sys
from collections.abc import Iterable

from artemis.recording.mcap_reader import Recording


def tell_missing(recordings: Iterable[Recording]) -> None:
    """Print what of recordings is missing, if anything is: what follows is from the rest."""
    for recording in recordings:
        if recording.missing:
            sys.stdout.write(f"{recording.path}: the recording is not whole: {recording.missing}\n")
