"""The fault table as people read it is the one that runs: every row, limit, time, recovery and word."""

from __future__ import annotations

import re
from pathlib import Path

from artemis.commands import faults

PAGE = Path(__file__).parents[2] / "docs" / "faults.md"


def test_page_of_the_docs_is_the_table_that_runs() -> None:
    (table,) = re.findall(
        r"<!-- faults:.*?-->\n(.*?)<!-- end of faults -->", PAGE.read_text(encoding="utf-8"), re.DOTALL
    )
    assert table == faults.page(), "made anew by `artemis faults --markdown`"
