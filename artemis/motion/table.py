"""Tables of numbers as people write them: comma, semicolon or blanks between cells, header optional, `#` comments."""

from __future__ import annotations

import bisect
import math
import re
from collections.abc import Callable, Mapping, Sequence

from artemis.errors import ConfigError, shown, similar

MAX_ROWS = 1_000_000
MAX_COLUMNS = 20
MAX_CHARACTERS = 100_000_000
MAX_PROBLEMS = 20
"""A file of another kind has a problem in every line; the first ones tell."""


Layout = Callable[[Sequence[Sequence[float]]], "tuple[str, ...] | str"]
"""Columns without names -> their names here, or why nobody can know them."""
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?")
_DECIMAL_COMMAS = re.compile(rf"\s*{_DECIMAL_COMMA.pattern}(?:[ \t]+{_DECIMAL_COMMA.pattern})+\s*")
_COMMA_IN_NUMBER = re.compile(r"(?:^|,)\s*[-+]?\d+,\d+\s*(?:,|$)")
"""Two neighbouring cells that may be one number with a decimal comma."""
_QUOTED = re.compile(r'"[^"]*"')


def raise_first(problems: Sequence[str], source: str) -> None:
    """Raise what was found in a file, if anything was.

    Raises:
        ConfigError: the first `MAX_PROBLEMS` problems, and how many more there are.
    """
    more = [f"{source}: and {len(problems) - MAX_PROBLEMS} more problems"] if len(problems) > MAX_PROBLEMS else []
    if problems:
        raise ConfigError([*problems[:MAX_PROBLEMS], *more])


def without_rows(columns: Sequence[str]) -> str:
    """What is wrong with a table without rows, and an example of one with these columns."""
    row = ",".join(f"{number / 2:g}" for number in range(len(columns)))
    return f"no rows: expected a line with the columns, such as {','.join(columns)}, and rows below it, such as {row}"


class Table:
    """The rows that could be read, column by column, and everything that was wrong.

    Problems of meaning are added with `report`, so that the reader of the message sees all of them at once.
    """

    def __init__(
        self,
        text: str,
        source: str,
        names: Mapping[str, str],
        *,
        required: Sequence[str],
        layout: Layout | None = None,
        max_columns: int = MAX_COLUMNS,
    ) -> None:
        """Read a table of finite numbers.

        Args:
            text: the whole file.
            source: its name, for messages.
            names: what a header may call a column -> the column's name here, "" for one that is not read. Without a
                header, which may stand in the comment above the first row, the columns are the distinct names, in
                this order.
            required: columns that must be there.
            layout: without a header, which columns these are.
            max_columns: more are refused.

        Attributes:
            columns: numbers by the column's name; all lists are equally long.
            lines: line in the file of each row, from 1.
            complete: every required column is there.
            header: its cells in small letters; none if there is no header.
        """
        self.source = source
        self.columns: dict[str, list[float]] = {}
        self.lines: list[int] = []
        self.complete = False
        self.header: list[str] = []
        self._cells: list[int] = []
        """Of each column the cell in a line, from 0."""
        self._hints: set[str] = set()
        self._layout, self._max_columns = layout, max_columns
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
        cell = self._cells[list(self.columns).index(column)] if column else 0
        self._problems.append((line, self._position(line, cell), problem))

    def report_file(self, problem: str) -> None:
        """Note a problem of the file as a whole."""
        self._problems.append((1, 1, problem))

    @property
    def is_empty(self) -> bool:
        """No row at all, not even one that cannot be read."""
        return not (self.lines or self._unreadable)

    def is_torn(self, row: int) -> bool:
        """Whether something unreadable stands between a row and the one before."""
        first, last = self.lines[row - 1], self.lines[row]
        return bisect.bisect(self._unreadable, first) < bisect.bisect(self._unreadable, last)

    def raise_problems(self) -> None:
        """Raise what was found, if anything was.

        Raises:
            ConfigError: as `raise_first`, with file:line:column.
        """
        problems = [f"{self.source}:{line}:{column}: {text}" for line, column, text in sorted(self._problems)]
        raise_first(problems, self.source)

    def _read(self, required: Sequence[str]) -> None:
        filled = ((n, line.partition("#")[0]) for n, line in enumerate(self._text, start=1))
        rows = ((number, line) for number, line in filled if line.strip())
        number, first = next(rows, (1, ""))
        self._separator = next((mark for mark in ";," if mark in first), None)
        if self._separator == "," and _DECIMAL_COMMAS.fullmatch(first):
            self._separator = None
        cells = self._split(first)
        if len(cells) > self._max_columns:
            self._problems.append((number, 1, f"{len(cells)} columns; expected at most {self._max_columns}"))
            return
        if first and not any(_number(cell) is not None or _DECIMAL_COMMA.fullmatch(cell) for cell in cells):
            self._read_header(number, cells)
        elif commented := self._commented_header(number, len(cells)):
            self._read_header(*commented)
            self._read_row(number, first)
        else:
            self._name_columns(len(cells))
            if first:
                self._read_row(number, first)
        for line_number, line in rows:
            if len(self.lines) == MAX_ROWS:
                self._problems.append((line_number, 1, f"more than {MAX_ROWS} rows; thin the table out"))
                break
            self._read_row(line_number, line)
        if self._layout is not None and not self.header and self.lines:
            self._lay_out(self._layout(list(self.columns.values())))
            if not self.complete and self._problems:
                return
        missing = [name for name in required if name not in self.columns or not first]
        self.complete = not missing
        if missing and not first:
            self._problems.append((number, 1, without_rows(required)))
        elif missing:
            self._problems.append((number, 1, f"expected the columns {', '.join(required)}; no {', '.join(missing)}"))

    def _split(self, line: str) -> list[str]:
        return [cell.strip().strip('"').strip() for cell in self._raw_cells(line)]

    def _raw_cells(self, line: str) -> list[str]:
        """As they are written; a separator in quotes separates nothing."""
        mark = self._separator
        if mark is None or '"' not in line:
            return line.split(mark)
        marked = _QUOTED.sub(lambda quoted: quoted[0].replace(mark, "\0"), line)
        return [cell.replace("\0", mark) for cell in marked.split(mark)]

    def _commented_header(self, number: int, count: int) -> tuple[int, list[str]] | None:
        """The names in the comment above the first row, and its line, if each of them is known."""
        above = number - 1
        written = self._text[above - 1].strip() if above else ""
        if not written.startswith("#"):
            return None
        for cells in (self._split(written[1:]), written[1:].split()):
            if len(cells) == count and all(self._names.get(cell.strip().lower()) is not None for cell in cells):
                return above, cells
        return None

    def _name_columns(self, count: int) -> None:
        """Of a table without a header."""
        if self._layout is None:
            names = list(dict.fromkeys(self._names.values()))
        else:
            names = [f"column {index + 1}" for index in range(count)]
        self.columns = {name: [] for name in names[:count]}
        self._cells = list(range(len(self.columns)))

    def _lay_out(self, names: tuple[str, ...] | str) -> None:
        if isinstance(names, str):
            self._problems.append((self.lines[0], 1, names))
        else:
            self.columns = dict(zip(names, self.columns.values(), strict=True))

    def _read_header(self, number: int, cells: list[str]) -> None:
        self.header = [cell.lower() for cell in cells]
        for index, written in enumerate(cells):
            name = self._names.get(written.lower())
            if name == "":
                continue
            if name is None:
                problem = f"unknown column {shown(written)}; {similar(written.lower(), self._names)}"
                self._problems.append((number, self._position(number, index), problem))
            elif name in self.columns:
                problem = f"second column for {name}: {shown(written)}"
                self._problems.append((number, self._position(number, index), problem))
            self.columns[name if name and name not in self.columns else f"column {index + 1}"] = []
            self._cells.append(index)

    def _read_row(self, number: int, line: str) -> None:
        cells = self._split(line)
        count = len(self.header) or len(self.columns)
        if len(cells) != count:
            problem = f"expected {count} columns ({', '.join(self.columns)}), found {len(cells)}"
            decimal = self._separator == "," and count < len(cells) <= 2 * count and _COMMA_IN_NUMBER.search(line)
            hint = "a comma separates columns: write a point in a number, or semicolons between columns"
            self._complain(number, min(len(cells), count + 1) - 1, problem, hint if decimal else "")
            return
        values = [_number(cells[index]) for index in self._cells]
        numbers = [value for value in values if value is not None and math.isfinite(value)]
        if len(numbers) == len(values):
            self.lines.append(number)
            for column, value in zip(self.columns.values(), numbers, strict=True):
                column.append(value)
            return
        for index, name, found in zip(self._cells, self.columns, values, strict=True):
            if found is None or not math.isfinite(found):
                problem = f"{name}: expected a finite number, found {shown(cells[index])}"
                comma = _DECIMAL_COMMA.fullmatch(cells[index])
                self._complain(number, index, problem, "write a point instead of the comma" if comma else "")

    def _complain(self, number: int, index: int, problem: str, hint: str = "") -> None:
        """Note what makes a row unreadable; of what has one cause in every row, the first one and a hint."""
        self._unreadable.append(number)
        if not hint:
            self._problems.append((number, self._position(number, index), problem))
        elif hint not in self._hints:
            self._hints.add(hint)
            self._problems.append((number, self._position(number, index), f"{problem}: {hint}"))

    def _position(self, line: int, cell: int) -> int:
        """Column in the file of a cell's first character, from 1."""
        text = self._text[line - 1].partition("#")[0]
        if self._separator is None:
            starts = [match.start() for match in re.finditer(r"\S+", text)]
            return starts[cell] + 1 if cell < len(starts) else 1
        before = self._separator.join(self._raw_cells(text)[:cell])
        start = len(before) + (1 if cell else 0)
        rest = text[start:]
        return start + len(rest) - len(rest.lstrip()) + 1


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None
