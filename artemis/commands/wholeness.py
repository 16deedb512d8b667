"""What a command says of a recording that is damaged or cut off, once it has read it."""

from __future__ import annotations

import sys

from artemis.recording.mcap_reader import Recording


def tell_missing(recording: Recording, name: str = "") -> None:
    """Print what of a recording is missing, if anything is. `name`: where there are several."""
    if recording.missing:
        sys.stdout.write(f"{name}the recording is not whole: {recording.missing}\n")
