"""What a study file must have right in itself, apart from the settings that it names."""

from collections.abc import Sequence
from pathlib import Path

from snakeslam.errors import InputError
from snakeslam.studies.measures import MEASURES, MeasureName
from snakeslam.studies.study_file import FigureSettings, Scalar, StudySettings, text, unknown_name

NOT_AN_AXIS = {
    "run.seed": "seeds: gives the seeds",
    "run.duration_s": "start_up_periods: and measured_periods: give the duration",
}


def check_study(path: Path, settings: StudySettings) -> None:
    """Raise InputError, one line with file and key, for axes, measures, reference and figures that do not fit."""
    _check_axes(path, settings)
    _check_estimator(path, settings)
    _check_reference(path, settings)
    for k, figure in enumerate(settings.figures):
        where = f"{path}: figures.{k}"
        if figure.name in [other.name for other in settings.figures[:k]]:
            raise InputError(f"{where}.name", f"{figure.name} is given twice", "each name once")
        _check_figure(where, figure, settings)


def _check_estimator(path: Path, settings: StudySettings) -> None:
    if settings.estimator != "off":
        return
    needing = next((name for name in settings.measure if MEASURES[name].estimated), None)
    if needing is not None:
        raise InputError(f"{path}: measure", f"{needing} needs the estimator", "estimator: auto, on")
    controllers = [settings.settings.get("head.controller"), *settings.axes.get("head.controller", [])]
    if "predictive" in controllers:
        raise InputError(f"{path}: estimator", "predictive control feeds back the estimate", "auto, on")


def _check_axes(path: Path, settings: StudySettings) -> None:
    """Refuse axes without values, with a value twice, and what the study itself sets."""
    for group, keys in (("axes", settings.axes), ("settings", settings.settings)):
        for key in keys:
            if key in NOT_AN_AXIS:
                raise InputError(f"{path}: {group}.{key}", "is set by the study itself", NOT_AN_AXIS[key])
    for key, values in settings.axes.items():
        if key in settings.settings:
            raise InputError(f"{path}: axes.{key}", "is among the settings: too", "one of the two")
        _check_list(f"{path}: axes.{key}", values)
    _check_list(f"{path}: seeds", settings.seeds)
    _check_list(f"{path}: measure", settings.measure)


def _check_list(where: str, values: Sequence[Scalar]) -> None:
    if not values:
        raise InputError(where, "is empty", "a list of one or more values")
    twice = next((value for k, value in enumerate(values) if value in values[:k]), None)
    if twice is not None:
        raise InputError(where, f"{text(twice)} is given twice", "each value once")


def _check_reference(path: Path, settings: StudySettings) -> None:
    reference = settings.reference
    if reference is None:
        return
    where = f"{path}: reference"
    _check_axis(f"{where}.axis", reference.axis, settings)
    _check_measure(f"{where}.measure", reference.measure, settings)
    wanted = len(settings.axes[reference.axis])
    if len(reference.values) != wanted:
        raise InputError(f"{where}.values", f"{len(reference.values)} values", f"{wanted}, one for each of the axis")


def _check_figure(where: str, figure: FigureSettings, settings: StudySettings) -> None:
    """Refuse axes, values and measures that the study does not have, and an axis that the figure leaves open."""
    roles = {"x": figure.x, "lines": figure.lines, "panels": figure.panels}
    used = {role: axis for role, axis in roles.items() if axis is not None}
    for role, axis in used.items():
        _check_axis(f"{where}.{role}", axis, settings)
    for axis, value in figure.where.items():
        _check_axis(f"{where}.where", axis, settings)
        if value not in settings.axes[axis]:
            raise InputError(f"{where}.where.{axis}", text(value), ", ".join(map(text, settings.axes[axis])))
    for name in (*figure.measures, *figure.log):
        _check_measure(f"{where}.measures", name, settings)
    if figure.kind == "curves" and figure.x is None:
        raise InputError(f"{where}.x", "is missing", ", ".join(settings.axes))
    if figure.kind == "yaw_over_time" and figure.x is not None:
        raise InputError(f"{where}.x", "is the time in this figure", "lines, panels, where")
    named = [*used.values(), *figure.where]
    for axis, values in settings.axes.items():
        if named.count(axis) > 1:
            raise InputError(where, f"uses {axis} twice", "each axis once among x, lines, panels, where")
        if axis not in named and len(values) > 1:
            raise InputError(where, f"leaves {axis} open", "each axis among x, lines, panels, where")


def _check_axis(where: str, axis: str, settings: StudySettings) -> None:
    if axis not in settings.axes:
        raise unknown_name(where, axis, list(settings.axes))


def _check_measure(where: str, name: MeasureName, settings: StudySettings) -> None:
    if name not in settings.measure:
        raise unknown_name(where, name, list(settings.measure))
