"""Words of fixed lists, for shells that complete a command; what they come from is loaded only then."""

from __future__ import annotations


def rows() -> list[str]:
    """Of the fault table."""
    from artemis.supervision.catalogue import ROWS

    return list(ROWS)


def kinds() -> list[str]:
    """Of plugins."""
    from artemis.commands.plugins import GROUPS

    return list(GROUPS)
