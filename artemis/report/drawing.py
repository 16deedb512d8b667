"""Whether figures can be drawn: by matplotlib, which is an extra, as the report of a run needs none."""

from artemis.build import require


def check_figures(what: str) -> None:
    """Nothing, where `what` can draw figures. Raises ConfigError."""
    require(f"{what} draws figures, and", "figures", "matplotlib")
