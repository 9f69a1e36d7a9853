"""Stamped rows of text, read as widely as other tools write them, with errors that name the file and the line.

Cells are separated by commas, semicolons, tabs or spaces; a byte order mark, CRLF, comments (#), one line of titles,
separators at the end of a row and columns beyond those asked for are accepted. Numbers have Python's float syntax.
"""

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from snakeslam.errors import InputError
from snakeslam.messages import Float

NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,4})?", re.ASCII)
LONGEST_NUMBER = 64
LATEST_NS = 9_200_000_000_000_000_000
"""Stamps, and what is added to them, must fit into 64 bits with a sign."""
NS_PER_S = 1_000_000_000
QUOTES = "\"'"


@dataclass(frozen=True, slots=True)
class Row:
    """One line of a table: its 1-based number, its stamp and the cells after the stamp."""

    line: int
    t_ns: int
    cells: tuple[str, ...]


def stamp_from_ns(text: str) -> int:
    """Return integer nanoseconds from a number without a fraction; ValueError otherwise."""
    value = _decimal(text)
    if value is None or value != value.to_integral_value():
        hint = "" if value is None else "; are these seconds?"
        raise ValueError(f"the timestamp {text[:LONGEST_NUMBER]!r} is not a whole number of nanoseconds{hint}")
    return _within_64_bits(text, value)


def stamp_from_s(text: str) -> int:
    """Return integer nanoseconds from seconds, exact to the last digit given; ValueError otherwise."""
    value = _decimal(text)
    if value is None:
        raise ValueError(f"the timestamp {text[:LONGEST_NUMBER]!r} is not a decimal number of seconds")
    return _within_64_bits(text, value * NS_PER_S)


def read_text(path: Path) -> str:
    """Return the file's text without a byte order mark; InputError when it is missing or no text."""
    try:
        if path.exists() and not path.is_file():
            raise InputError(str(path), "is not a file")
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise InputError(str(path), "the file is missing") from error
    except OSError as error:
        raise InputError(str(path), f"cannot be read: {error.strerror}") from error
    if b"\0" in data:
        raise InputError(str(path), "is not a text file")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        # Titles and comments of older tools have signs such as a degree's in Latin-1; numbers are the same in both.
        return data.decode("latin-1")


def read_table(path: Path, stamp: Callable[[str], int], columns: Sequence[int], repeats: bool = False) -> list[Row]:
    """Read rows of ``stamp, number, ...``; a row needs the least of ``columns`` (stamp included), more are kept.

    Stamps must increase; with ``repeats`` a row that repeats the stamp before it is left out. InputError names file
    and line.
    """
    return _rows(path, stamp, columns, repeats, _number_cells)


def read_names(path: Path, stamp: Callable[[str], int]) -> list[Row]:
    """Read rows of ``stamp, file name, ...``; errors as in ``read_table``."""
    return _rows(path, stamp, (2,), False, _name_cells)


def floats(path: Path, rows: Sequence[Row], count: int) -> Float:
    """Return the first ``count`` cells of each row as finite numbers, (rows, count); InputError otherwise."""
    values = np.empty((len(rows), count))
    for k, row in enumerate(rows):
        for j, cell in enumerate(row.cells[:count]):
            values[k, j] = _number(f"{path}: line {row.line}", j + 2, cell)
    return values


def stamps(rows: Sequence[Row]) -> NDArray[np.int64]:
    """Return the stamps in ns, (rows,)."""
    return np.array([row.t_ns for row in rows], dtype=np.int64)


def _rows(
    path: Path,
    stamp: Callable[[str], int],
    columns: Sequence[int],
    repeats: bool,
    split: Callable[[str], list[str]],
) -> list[Row]:
    rows: list[Row] = []
    for line, cells in _lines(path, split):
        row = _row(path, line, cells, stamp, columns)
        if rows and row.t_ns <= rows[-1].t_ns:
            if repeats and row.t_ns == rows[-1].t_ns:
                continue
            kind = "repeats" if row.t_ns == rows[-1].t_ns else "goes back"
            raise InputError(f"{path}: line {line}", f"the timestamp {cells[0]} {kind}", "stamps that increase")
        rows.append(row)
    if not rows:
        raise InputError(str(path), "has no rows")
    return rows


def _lines(path: Path, split: Callable[[str], list[str]]) -> Iterator[tuple[int, list[str]]]:
    """Yield the number and the cells of each line that is neither blank nor a comment nor the title."""
    first = True
    for line, text in enumerate(read_text(path).splitlines(), start=1):
        stripped = text.strip()
        if not stripped or stripped.startswith("#"):
            continue
        cells = split(stripped)
        if not (first and _is_title(stripped)):
            yield line, cells
        first = False


def _number_cells(text: str) -> list[str]:
    """Return the cells of a row of numbers; empty ones at its end are left out."""
    parts = text.split("#", 1)[0].replace(";", ",").split(",")
    cells = [cell for part in parts for cell in (part.split() or ("",))]
    return _without_empty_end([cell.strip(QUOTES) for cell in cells])


def _name_cells(text: str) -> list[str]:
    """Return the cells of a row with a file name, which may hold spaces where commas separate the cells."""
    text = text.replace(";", ",")
    parts = text.split(",") if "," in text else text.split()
    return _without_empty_end([part.strip().strip(QUOTES) for part in parts])


def _without_empty_end(cells: list[str]) -> list[str]:
    while len(cells) > 1 and not cells[-1]:
        cells.pop()
    return cells


def _row(path: Path, line: int, cells: list[str], stamp: Callable[[str], int], columns: Sequence[int]) -> Row:
    where = f"{path}: line {line}"
    if len(cells) < min(columns):
        allowed = ", ".join(str(count) for count in columns)
        raise InputError(where, f"{len(cells)} column{'s' * (len(cells) != 1)}", f"{allowed} or more")
    try:
        return Row(line, stamp(cells[0]), tuple(cells[1:]))
    except ValueError as error:
        raise InputError(where, str(error)) from error


def _decimal(text: str) -> Decimal | None:
    """Return the number; None where it is none, or none that a person or a program would write."""
    return Decimal(text) if len(text) <= LONGEST_NUMBER and NUMBER.fullmatch(text) else None


def _within_64_bits(text: str, value_ns: Decimal) -> int:
    if value_ns < 0:
        raise ValueError(f"the timestamp {text} is negative")
    if value_ns > LATEST_NS:
        raise ValueError(f"the timestamp {text} is beyond 64 bits of nanoseconds ({LATEST_NS / NS_PER_S:.0f} s)")
    return round(value_ns)


def _number(where: str, column: int, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError as error:
        raise InputError(where, f"column {column}: {cell[:LONGEST_NUMBER]!r} is not a number") from error
    if not math.isfinite(value):
        raise InputError(where, f"column {column}: {cell[:LONGEST_NUMBER]!r} is not a finite number")
    return value


def _is_title(text: str) -> bool:
    """Whether a line names columns: more than one, none of them a number, and the stamp's without a digit."""
    cells = [cell.strip().strip(QUOTES) for cell in (text.split(",") if "," in text else text.split())]
    has_digit = any(character.isdigit() for character in cells[0])
    return len(cells) > 1 and not has_digit and not any(_is_number(cell) for cell in cells)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
