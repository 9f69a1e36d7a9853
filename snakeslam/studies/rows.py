"""A study's CSV: a row for each run and estimator, in the order of the runs, whole after every run."""

import csv
import math
import os
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from snakeslam.errors import InputError
from snakeslam.estimation.settings import Mode
from snakeslam.studies.measures import MeasureName
from snakeslam.studies.study import Point, Study
from snakeslam.studies.study_file import ESTIMATOR, Scalar, text

Status = Literal["done", "failed"]
LONGEST_ROW = 64 * 1024
FIRST, LAST = ("run", "seed"), ("status", "reason", "key")


@dataclass(frozen=True, slots=True)
class Row:
    """The outcome of a run; ``values`` are None where unknown, all of them when it failed.

    ``estimator`` is the one whose row it is, where the study has several.
    """

    point: Point
    values: dict[MeasureName, float | None]
    status: Status = "done"
    reason: str = ""
    estimator: Mode | None = None

    @property
    def chosen(self) -> dict[str, Scalar]:
        """The row's values on the axes."""
        return self.point.chosen if self.estimator is None else {**self.point.chosen, ESTIMATOR: self.estimator}

    @property
    def words(self) -> str:
        """The row in words."""
        return self.point.words if self.estimator is None else f"{self.point.words}, {self.estimator}"

    @property
    def known(self) -> dict[MeasureName, float]:
        """The values that there are."""
        return {name: value for name, value in self.values.items() if value is not None}

    def cells(self) -> list[str]:
        """Return the row as text: run, seed, axes, measures, status, reason, key."""
        chosen = [text(value) for value in self.chosen.values()]
        measured = [_number(self.values.get(name)) for name in self.point.measure]
        return [
            str(self.point.number),
            str(self.point.seed),
            *chosen,
            *measured,
            self.status,
            self.reason,
            self.point.key,
        ]


def header(study: Study) -> list[str]:
    """Return the names of the columns."""
    return [*FIRST, *study.settings.row_axes, *study.settings.measure, *LAST]


def write_rows(path: Path, study: Study, rows: Iterable[Row]) -> None:
    """Write the rows in the order of the runs; the file is replaced at once, never half written."""
    part = path.with_name(f".{path.name}.part")
    with part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header(study))
        writer.writerows(row.cells() for row in sorted(rows, key=lambda row: row.point.number))
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)


def read_rows(path: Path, study: Study) -> list[Row]:
    """Return the rows of the study's runs, by what determines them; InputError for a file that is none of its.

    Rows of runs that the study does not have (any more) are left out, and runs of which a row is missing.
    """
    points = {point.key: point for point in study.points}
    lines = _lines(path, len(study.points) * max(1, len(study.settings.estimators)))
    if not lines or lines[0] != header(study):
        raise InputError(str(path), "has other columns than the study", "the folder of the same study, or a new one")
    found: list[Row] = []
    for number, cells in enumerate(lines[1:], start=2):
        named = dict(zip(lines[0], cells, strict=False))
        point = points.get(named.get("key", ""))
        if point is not None:
            found.append(_row(f"{path}: line {number}", point, named))
    counts = Counter(row.point.number for row in found)
    return [row for row in found if counts[row.point.number] == max(1, len(study.settings.estimators))]


def _lines(path: Path, rows: int) -> list[list[str]]:
    """Return the cells of the file's lines; InputError for what is no table of up to ``rows`` rows."""
    try:
        if path.stat().st_size > (rows + 1) * LONGEST_ROW:
            raise InputError(str(path), "is too large to be the study's table", f"{rows} rows")
        with path.open(newline="", encoding="utf-8") as file:
            return list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(str(path), f"cannot be read: {' '.join(str(error).split())}") from error


def _row(where: str, point: Point, named: dict[str, str]) -> Row:
    try:
        values: dict[MeasureName, float | None] = {
            name: _finite(named[name]) if named[name] else None for name in point.measure
        }
    except (KeyError, ValueError) as error:
        raise InputError(where, f"is damaged: {error}", "numbers, or nothing") from error
    status: Status = "done" if named.get("status") == "done" else "failed"
    estimator: Mode | None = next((mode for mode in point.estimators if mode == named.get(ESTIMATOR)), None)
    if point.estimators and estimator is None:
        raise InputError(where, f"is damaged: estimator {named.get(ESTIMATOR)}", ", ".join(point.estimators))
    return Row(point, values, status, named.get("reason", ""), estimator)


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is no finite number")
    return value


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"
