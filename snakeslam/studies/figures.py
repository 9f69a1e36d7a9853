"""The figures of a study, drawn with matplotlib into files."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from snakeslam.messages import Float
from snakeslam.studies.measures import MEASURES, MeasureName
from snakeslam.studies.rows import Row
from snakeslam.studies.study import Study
from snakeslam.studies.study_file import FigureSettings, ReferenceSettings, Scalar, text
from snakeslam.studies.table import chosen_rows, deviation, spread

COLOURS = ("#5b6770", "#e07b39", "#2a7fba", "#2e8b57", "#8e5ea2", "#b8860b", "#c0392b", "#008b8b")
MARKERS = "osD^vPXh"
STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e3e6e8",
    "grid.linewidth": 0.6,
    "axes.edgecolor": "#9aa3a9",
    "axes.axisbelow": True,
    "legend.frameon": False,
}
NAMES = {
    "gait.alpha_pi": "alpha (pi rad)",
    "sim.friction_ratio": "friction ratio",
    "head.controller": "head control",
    "gait.period_s": "period (s)",
    "gait.wavelength_joints": "wavelength (joints)",
    "head.neck_joints": "neck (yaw joints)",
}
DPI = 110
HEADROOM = 1.05
LETTERS_PER_INCH, KEY_LETTERS = 13, 8
"""How wide a legend's text is, and what a line's sample takes beside it."""


def draw(study: Study, figure: FigureSettings, rows: Sequence[Row], series: Mapping[int, Float], path: Path) -> None:
    """Draw ``figure`` from the rows that are there, and from the ``series`` of each run, into ``path`` (PNG)."""
    rows = chosen_rows(rows, figure.where)
    with mpl.rc_context(STYLE):
        drawn = _curves(study, figure, rows) if figure.kind == "curves" else _yaw_over_time(study, figure, rows, series)
        FigureCanvasAgg(drawn)
        drawn.savefig(path, dpi=DPI, facecolor="white")


def _curves(study: Study, figure: FigureSettings, rows: Sequence[Row]) -> Figure:
    """Draw measures against the axis x: a row of panels for each measure, a column for each value of ``panels``."""
    measures = figure.measures or study.settings.measure
    columns, lines = _values(study, figure.panels), _values(study, figure.lines)
    drawn = Figure(figsize=(1.2 + 3.4 * len(columns), 1.2 + 2.0 * len(measures)), layout="constrained")
    panels: Any = drawn.subplots(len(measures), len(columns), squeeze=False, sharex=True, sharey="row")
    for name, row_of_panels in zip(measures, panels, strict=True):
        for column, axes in zip(columns, row_of_panels, strict=True):
            here = chosen_rows(rows, column)
            for k, line in enumerate(lines):
                _curve(study, figure, axes, k, line, chosen_rows(here, line), name)
            _reference(study, figure, axes, name)
        _scale(row_of_panels[0], name in figure.log)
        row_of_panels[0].set_ylabel(MEASURES[name].title)
    _label(study, figure, drawn, panels, columns, str(figure.x))
    return drawn


def _scale(axes: Any, logarithmic: bool) -> None:
    """Scale a row of panels, which share the axis, once all of it is drawn: set earlier, the limits would stay."""
    if logarithmic:
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter(NullFormatter())
    else:
        axes.set_ylim(0.0, HEADROOM * axes.get_ylim()[1])


def _curve(
    study: Study,
    figure: FigureSettings,
    axes: Any,
    k: int,
    line: dict[str, Scalar],
    rows: Sequence[Row],
    name: MeasureName,
) -> None:
    """Draw one line with the range over the seeds."""
    values = study.settings.row_axes[str(figure.x)]
    found = [(x, s) for x in values if (s := spread(chosen_rows(rows, {str(figure.x): x}), name)) is not None]
    if not found:
        return
    numeric = all(isinstance(x, int | float) for x in values)
    xs = [x if numeric else text(x) for x, _ in found]
    mean = np.array([s.average for _, s in found])
    reach = np.array([[s.average - s.lowest for _, s in found], [s.highest - s.average for _, s in found]])
    off = _deviation(study, figure, rows, name)
    style: dict[str, Any] = {"color": COLOURS[k % len(COLOURS)], "marker": MARKERS[k % len(MARKERS)]}
    axes.errorbar(xs, mean, yerr=reach, markersize=4, linewidth=1.4, capsize=2, label=_name(line) + off, **style)
    if numeric:
        axes.set_xticks(values)


def _deviation(study: Study, figure: FigureSettings, rows: Sequence[Row], name: MeasureName) -> str:
    """Return how far a line is from the published values, for its name in the only row of panels."""
    reference = _published(study, figure, name)
    rms = deviation(study, reference, rows) if reference is not None and figure.measures == (name,) else None
    return "" if rms is None else f": {100.0 * rms:.1f} % rms off"


def _published(study: Study, figure: FigureSettings, name: MeasureName) -> ReferenceSettings | None:
    """Return the published values where they are of this measure, against this figure's axis."""
    reference = study.settings.reference
    return reference if reference is not None and (reference.measure, reference.axis) == (name, figure.x) else None


def _reference(study: Study, figure: FigureSettings, axes: Any, name: MeasureName) -> None:
    """Draw the published values where there are any."""
    reference = _published(study, figure, name)
    if reference is None:
        return
    style: dict[str, Any] = {"color": "black", "marker": "x", "linestyle": "none", "zorder": 5}
    axes.plot(study.settings.row_axes[reference.axis], reference.values, label=reference.source, **style)


def _yaw_over_time(study: Study, figure: FigureSettings, rows: Sequence[Row], series: Mapping[int, Float]) -> Figure:
    """Draw the head's yaw in the measured window, of the first seed, a column for each value of ``panels``."""
    columns, lines = _values(study, figure.panels), _values(study, figure.lines)
    drawn = Figure(figsize=(0.8 + 3.9 * len(columns), 3.3), layout="constrained")
    panels: Any = drawn.subplots(1, len(columns), squeeze=False, sharex=True, sharey="row")
    for column, axes in zip(columns, panels[0], strict=True):
        for k, line in enumerate(lines):
            here = [row for row in chosen_rows(rows, {**column, **line}) if row.point.number in series]
            for row in here[:1]:
                t_s, yaw_rad = series[row.point.number][:, :2].T
                colour = COLOURS[k % len(COLOURS)]
                axes.plot(t_s, np.rad2deg(yaw_rad), color=colour, linewidth=1.3, label=_name(line))
    panels[0][0].set_ylabel("head yaw about its mean (deg)")
    _label(study, figure, drawn, panels, columns, "time in the measured window (s)")
    return drawn


def _label(
    study: Study, figure: FigureSettings, drawn: Figure, panels: Any, columns: list[dict[str, Scalar]], x: str
) -> None:
    """Name columns, axes and lines; the legend stands above the panels."""
    for column, axes in zip(columns, panels[0], strict=True):
        if column:
            axes.set_title(", ".join(_said(key, value) for key, value in column.items()), fontsize=9)
    for axes in panels[-1]:
        axes.set_xlabel(NAMES.get(x, x))
    names: dict[str, Any] = {}
    for axes in panels.flat:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            names.setdefault(label, handle)
    title = ", ".join(_said(key, value) for key, value in figure.where.items())
    drawn.suptitle(", ".join(part for part in (study.settings.title or study.name, title) if part), fontsize=10)
    if len(names) > 1:
        fitting = int(LETTERS_PER_INCH * drawn.get_figwidth() / (max(map(len, names)) + KEY_LETTERS))
        ncols = min(max(1, fitting), len(names))
        drawn.legend(list(names.values()), list(names), loc="outside lower center", ncols=ncols)


def _values(study: Study, axis: str | None) -> list[dict[str, Scalar]]:
    """Return the values of an axis, each as a choice of rows; one free choice without an axis."""
    return [{}] if axis is None else [{axis: value} for value in study.settings.row_axes[axis]]


def _name(line: dict[str, Scalar]) -> str:
    return (
        ", ".join(
            text(value) if key in ("head.controller", "case", "estimator") else _said(key, value)
            for key, value in line.items()
        )
        or "measured"
    )


def _said(key: str, value: Scalar) -> str:
    """Return an axis with its value, the unit behind it."""
    name, _, unit = NAMES.get(key, key).partition(" (")
    return f"{name} {text(value)} {unit.rstrip(')')}".rstrip()
