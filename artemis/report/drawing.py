"""Whether figures can be drawn: by matplotlib, which is an extra, as the report of a run needs none."""

from importlib.util import find_spec

from artemis.build import install
from artemis.errors import ConfigError


def check_figures(what: str) -> None:
    """Nothing, where `what` can draw figures. Raises ConfigError."""
    if find_spec("matplotlib") is None:
        raise ConfigError(f"{what} draws figures, and needs the package matplotlib: {install('figures')}")
