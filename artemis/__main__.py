"""The entry point of the `artemis` command, and of `python -m artemis`."""

import os
import signal
import sys


def main() -> None:
    """Import the command line and run it. Ctrl-C before a command begins, or after its end: status 130 without a word.

    During the imports the process ends inside the signal handler: an exception may be lost there.
    """
    heard = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # else whoever started this has it ignored
    if heard:
        signal.signal(signal.SIGINT, lambda number, frame: os._exit(128 + number))
    from artemis.cli import main as command

    if heard:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        command()
    except KeyboardInterrupt:
        sys.exit(128 + signal.SIGINT)


if __name__ == "__main__":
    main()
