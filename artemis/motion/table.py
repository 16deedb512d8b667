"""Tables of numbers as people write them: comma, semicolon or blanks between cells, header optional, `#` comments."""

from __future__ import annotations

import bisect
import math
import re
from collections.abc import Mapping, Sequence

from artemis.errors import ConfigError, shown, similar

MAX_ROWS = 1_000_000
MAX_COLUMNS = 20
MAX_CHARACTERS = 100_000_000
MAX_PROBLEMS = 20
"""A file of another kind has a problem in every line; the first ones tell."""


class Table:
    """The rows that could be read, column by column, and everything that was wrong.

    Problems of meaning are added with `report`, so that the reader of the message sees all of them at once.
    """

    def __init__(self, text: str, source: str, names: Mapping[str, str], *, required: Sequence[str]) -> None:
        """Read a table of finite numbers.

        Args:
            text: the whole file.
            source: its name, for messages.
            names: what a header may call a column -> the column's name here. Without a header the columns are the
                distinct names, in this order.
            required: columns that must be there.

        Attributes:
            columns: numbers by the column's name; all lists are equally long.
            lines: line in the file of each row, from 1.
            complete: every required column is there.
        """
        self.source = source
        self.columns: dict[str, list[float]] = {}
        self.lines: list[int] = []
        self.complete = False
        self._names = names
        self._problems: list[tuple[int, int, str]] = []
        self._unreadable: list[int] = []
        self._separator: str | None = None
        self._text = text.removeprefix("\ufeff").splitlines() if len(text) <= MAX_CHARACTERS else []
        if len(text) > MAX_CHARACTERS:
            self.report_file(f"{len(text)} characters; expected at most {MAX_CHARACTERS}")
        else:
            self._read(required)

    def report(self, row: int, problem: str, column: str | None = None) -> None:
        """Note a problem of a row that could be read, or of one of its cells."""
        line = self.lines[row]
        cell = list(self.columns).index(column) if column else 0
        self._problems.append((line, self._position(line, cell), problem))

    def report_file(self, problem: str) -> None:
        """Note a problem of the file as a whole."""
        self._problems.append((1, 1, problem))

    def is_torn(self, row: int) -> bool:
        """Whether something unreadable stands between a row and the one before."""
        first, last = self.lines[row - 1], self.lines[row]
        return bisect.bisect(self._unreadable, first) < bisect.bisect(self._unreadable, last)

    def raise_problems(self) -> None:
        """Raise what was found, if anything was.

        Raises:
            ConfigError: the first `MAX_PROBLEMS` problems with file:line:column, and how many more there are.
        """
        problems = [f"{self.source}:{line}:{column}: {text}" for line, column, text in sorted(self._problems)]
        if len(problems) > MAX_PROBLEMS:
            problems[MAX_PROBLEMS:] = [f"{self.source}: and {len(problems) - MAX_PROBLEMS} more problems"]
        if problems:
            raise ConfigError(problems)

    def _read(self, required: Sequence[str]) -> None:
        filled = ((n, line.partition("#")[0]) for n, line in enumerate(self._text, start=1))
        rows = ((number, line) for number, line in filled if line.strip())
        number, first = next(rows, (1, ""))
        self._separator = next((mark for mark in ";," if mark in first), None)
        cells = first.split(self._separator)
        if first and all(_number(cell) is None for cell in cells):
            if len(cells) > MAX_COLUMNS:
                self._problems.append((number, 1, f"{len(cells)} columns; expected at most {MAX_COLUMNS}"))
                return
            self._read_header(number, cells)
        else:
            self.columns = {name: [] for name in list(dict.fromkeys(self._names.values()))[: len(cells)]}
            if first:
                self._read_row(number, first)
        missing = [name for name in required if name not in self.columns or not first]
        self.complete = not missing
        if missing:
            self._problems.append((number, 1, f"expected the columns {', '.join(required)}; no {', '.join(missing)}"))
        for number, line in rows:
            if len(self.lines) == MAX_ROWS:
                self._problems.append((number, 1, f"more than {MAX_ROWS} rows; thin the table out"))
                break
            self._read_row(number, line)

    def _read_header(self, number: int, cells: list[str]) -> None:
        for index, cell in enumerate(cells):
            written = cell.strip()
            name = self._names.get(written.lower())
            if name is None:
                problem = f"unknown column {shown(written)}; {similar(written.lower(), self._names)}"
                self._problems.append((number, self._position(number, index), problem))
            elif name in self.columns:
                problem = f"second column for {name}: {shown(written)}"
                self._problems.append((number, self._position(number, index), problem))
            self.columns[name if name and name not in self.columns else f"column {index + 1}"] = []

    def _read_row(self, number: int, line: str) -> None:
        cells = line.split(self._separator)
        count = len(self.columns)
        if len(cells) != count:
            problem = f"expected {count} columns ({', '.join(self.columns)}), found {len(cells)}"
            self._problems.append((number, self._position(number, min(len(cells), count + 1) - 1), problem))
            self._unreadable.append(number)
            return
        values = [_number(cell) for cell in cells]
        numbers = [value for value in values if value is not None and math.isfinite(value)]
        if len(numbers) == count:
            self.lines.append(number)
            for column, value in zip(self.columns.values(), numbers, strict=True):
                column.append(value)
            return
        self._unreadable.append(number)
        for index, (name, found) in enumerate(zip(self.columns, values, strict=True)):
            if found is None or not math.isfinite(found):
                problem = f"{name}: expected a finite number, found {shown(cells[index].strip())}"
                self._problems.append((number, self._position(number, index), problem))

    def _position(self, line: int, cell: int) -> int:
        """Column in the file of a cell's first character, from 1."""
        text = self._text[line - 1].partition("#")[0]
        if self._separator is None:
            starts = [match.start() for match in re.finditer(r"\S+", text)]
            return starts[cell] + 1
        before = self._separator.join(text.split(self._separator)[:cell])
        start = len(before) + (1 if cell else 0)
        rest = text[start:]
        return start + len(rest) - len(rest.lstrip()) + 1


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None
