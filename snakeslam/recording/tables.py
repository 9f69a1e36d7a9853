"""Stamped rows of text, read with errors that name the file and the line."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from snakeslam.errors import InputError
from snakeslam.messages import Float

DIGITS = re.compile(r"\d{1,19}")
DECIMAL = re.compile(r"\d{1,10}(\.\d*)?")


@dataclass(frozen=True, slots=True)
class Row:
    """One line of a table: its 1-based number, its stamp and the cells after the stamp."""

    line: int
    t_ns: int
    cells: tuple[str, ...]


def stamp_from_ns(text: str) -> int:
    """Return integer nanoseconds from digits; ValueError otherwise."""
    if not DIGITS.fullmatch(text):
        raise ValueError(f"the timestamp {text!r} is not a whole number of nanoseconds")
    return int(text)


def stamp_from_s(text: str) -> int:
    """Return exact integer nanoseconds from decimal seconds, never through a float; ValueError otherwise."""
    if not DECIMAL.fullmatch(text):
        raise ValueError(f"the timestamp {text!r} is not a decimal number of seconds")
    return round(Decimal(text) * 1_000_000_000)


def read_text(path: Path) -> str:
    """Return the file's text; InputError when it is missing or no text."""
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise InputError(str(path), "the file is missing") from error
    except UnicodeDecodeError as error:
        raise InputError(str(path), "is not a text file") from error
    except OSError as error:
        raise InputError(str(path), f"cannot be read: {error.strerror}") from error


def read_table(
    path: Path,
    stamp: Callable[[str], int],
    columns: Sequence[int],
    separator: str | None = None,
    repeats: bool = False,
) -> list[Row]:
    """Read rows of ``stamp, cell, ...``; ``columns`` are the allowed counts, stamp included.

    ``separator`` None splits at white space. Comments (#), blank lines and one line of titles are skipped. Stamps must
    increase; with ``repeats`` a row that repeats the stamp before it is left out. InputError names file and line.
    """
    rows: list[Row] = []
    for line, text in enumerate(read_text(path).splitlines(), start=1):
        cells = [cell.strip() for cell in text.split(separator)]
        if not text.strip() or text.lstrip().startswith("#") or (not rows and line == 1 and _is_title(cells)):
            continue
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


def _row(path: Path, line: int, cells: list[str], stamp: Callable[[str], int], columns: Sequence[int]) -> Row:
    where = f"{path}: line {line}"
    if len(cells) not in columns:
        raise InputError(where, f"{len(cells)} columns", " or ".join(str(count) for count in columns))
    try:
        return Row(line, stamp(cells[0]), tuple(cells[1:]))
    except ValueError as error:
        raise InputError(where, str(error)) from error


def _number(where: str, column: int, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError as error:
        raise InputError(where, f"column {column}: {cell!r} is not a number") from error
    if not math.isfinite(value):
        raise InputError(where, f"column {column}: {cell!r} is not a finite number")
    return value


def _is_title(cells: list[str]) -> bool:
    def is_word(cell: str) -> bool:
        try:
            float(cell)
        except ValueError:
            return True
        return False

    return len(cells) > 1 and all(is_word(cell) for cell in cells)
