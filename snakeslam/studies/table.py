"""A study's rows over the seeds: averages and ranges, as a table and for the figures."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from snakeslam.studies.measures import MEASURES, MeasureName
from snakeslam.studies.rows import Row
from snakeslam.studies.study import Study
from snakeslam.studies.study_file import CASE, ESTIMATOR, ReferenceSettings, Scalar, text

Average = Literal["mean", "median"]

SAME = 0.005
"""A range narrower than this part of its mean is not shown."""


@dataclass(frozen=True, slots=True)
class Spread:
    """A measure over the seeds; ``average`` is the mean or the median."""

    average: float
    lowest: float
    highest: float

    def __str__(self) -> str:
        """The average, and the range where the seeds differ."""
        if self.highest - self.lowest <= SAME * abs(self.average):
            return _short(self.average)
        return f"{_short(self.average)} ({_short(self.lowest)} to {_short(self.highest)})"


def chosen_rows(rows: Sequence[Row], where: Mapping[str, Scalar]) -> list[Row]:
    """Return the rows with these values on these axes."""
    return [row for row in rows if all(row.chosen[axis] == value for axis, value in where.items())]


def spread(rows: Sequence[Row], name: MeasureName, average: Average = "mean") -> Spread | None:
    """Return a measure over ``rows``, those that have it; None without any."""
    found = [value for row in rows if (value := row.values.get(name)) is not None]
    if not found:
        return None
    # The mean of equal numbers may come out a rounding error outside of them.
    middle = np.mean(found) if average == "mean" else np.median(found)
    return Spread(float(np.clip(middle, min(found), max(found))), min(found), max(found))


def markdown(study: Study, rows: Sequence[Row]) -> str:
    """Return the study as text: a table with a line for each combination, the reference, and what failed."""
    pooled, measures = study.settings.pooled, study.settings.measure
    axes = [axis for axis in study.settings.row_axes if axis not in pooled]
    lines = [f"## {study.settings.title or study.name}", ""]
    names = [axis if axis in (CASE, ESTIMATOR) else f"`{axis}`" for axis in axes]
    lines += _head([*names, *(MEASURES[name].title for name in measures), "runs"])
    for chosen in _combinations(study, axes):
        same = chosen_rows(rows, chosen)
        cells = [text(value) for value in chosen.values()]
        cells += [_cell(spread(same, name, study.settings.average)) for name in measures]
        lines.append(_line([*cells, str(sum(row.status == "done" for row in same))]))
    if study.settings.reference is not None:
        lines += ["", *_reference(study, study.settings.reference, rows)]
    failed = [row for row in rows if row.status == "failed"]
    lines += ["", *(f"- failed: {row.words}: {row.reason}" for row in failed)] if failed else []
    return "\n".join(lines)


def deviation(study: Study, reference: ReferenceSettings, rows: Sequence[Row]) -> float | None:
    """Return the RMS of (measured - reference) / reference over the axis; None where a value is missing."""
    measured = [
        spread(chosen_rows(rows, {reference.axis: value}), reference.measure)
        for value in study.settings.row_axes[reference.axis]
    ]
    means = [value.average for value in measured if value is not None]
    if len(means) < len(measured):
        return None
    return float(np.sqrt(np.mean((np.array(means) / np.array(reference.values) - 1.0) ** 2)))


def others(study: Study, axis: str) -> list[dict[str, Scalar]]:
    """Return the combinations of the other axes."""
    return _combinations(study, [other for other in study.settings.row_axes if other != axis])


def _reference(study: Study, reference: ReferenceSettings, rows: Sequence[Row]) -> list[str]:
    """Return the table that sets a measure beside its published values."""
    values = study.settings.row_axes[reference.axis]
    measure = MEASURES[reference.measure].title
    lines = _head([f"{measure} at `{reference.axis}`", *map(text, values), "rms relative deviation"])
    lines.append(_line([reference.source, *map(_short, reference.values), ""]))
    for rest in others(study, reference.axis):
        same = chosen_rows(rows, rest)
        cells = [_cell(spread(chosen_rows(same, {reference.axis: value}), reference.measure)) for value in values]
        rms = deviation(study, reference, same)
        name = ", ".join(f"{key}={text(value)}" for key, value in rest.items()) or "measured"
        lines.append(_line([name, *cells, "-" if rms is None else f"{100.0 * rms:.1f} %"]))
    return lines


def _combinations(study: Study, axes: Sequence[str]) -> list[dict[str, Scalar]]:
    """Return every choice of values on ``axes``, the first the outermost."""
    values = [study.settings.row_axes[axis] for axis in axes]
    return [dict(zip(axes, choice, strict=True)) for choice in itertools.product(*values)]


def _head(names: list[str]) -> list[str]:
    return [_line(names), _line(["---"] * len(names))]


def _line(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _cell(value: Spread | None) -> str:
    return "-" if value is None else str(value)


def _short(value: float) -> str:
    """Return three digits, without an exponent."""
    if abs(value) >= 99.95:
        return f"{value:.0f}"
    digits = 3 if abs(value) < 0.9995 else 2 if abs(value) < 9.995 else 1
    return f"{value:.{digits}f}"
