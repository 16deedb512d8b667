"""How many values (`msgspec.Struct`) are made per tick, where nothing of artemis was imported before.

`python -m tests.bench.made` prints the number. On virtual time it is the same in each run, on each machine.
"""

from __future__ import annotations

from typing import Any

import msgspec

MADE = [0]


class Counted(msgspec.Struct):
    """Stands in for `msgspec.Struct`: what is made of its subclasses is counted, however it is made."""

    def __post_init__(self) -> None:
        MADE[0] += 1


def main() -> None:
    replaced: Any = msgspec
    replaced.Struct = Counted
    from .calls import TICKS, along_the_path

    counted: list[int] = []
    along_the_path("artemis", lambda: counted.append(MADE[0]), lambda: counted.append(MADE[0]))
    begun, ended = counted
    print((ended - begun) / TICKS)


if __name__ == "__main__":
    main()
