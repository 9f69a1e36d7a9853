"""What a study file must have right in itself, apart from the settings that it names."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from snakeslam.errors import InputError
from snakeslam.studies.measures import MEASURES, MeasureName
from snakeslam.studies.study_file import FigureSettings, Scalar, StudySettings, text, unknown_name

NOT_AN_AXIS = {
    "run.seed": "seeds: gives the seeds",
    "run.duration_s": "duration_s:, or start_up_periods: and measured_periods:, give the duration",
}


def check_study(path: Path, settings: StudySettings) -> None:
    """Raise InputError, one line with file and key, for axes, measures, reference and figures that do not fit."""
    _check_axes(path, settings)
    _check_cases(path, settings)
    _check_estimator(path, settings)
    _check_estimators(path, settings)
    _check_table(path, settings)
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


def _check_estimators(path: Path, settings: StudySettings) -> None:
    """Refuse estimators that do not exist, and a second setting that names one."""
    if not settings.estimators:
        return
    _check_list(f"{path}: estimators", settings.estimators)
    if settings.estimator == "off":
        raise InputError(f"{path}: estimators", "estimator: is off", "estimator: auto, on")
    for where, keys in _named_settings(settings):
        if "estimator.mode" in keys:
            raise InputError(f"{path}: {where}.estimator.mode", "is set by the study itself", "estimators: names them")


def _check_table(path: Path, settings: StudySettings) -> None:
    if settings.duration_s is not None and "start_up_periods" in settings.model_fields_set:
        raise InputError(f"{path}: duration_s", "is given beside start_up_periods:", "one of the two")
    for axis in settings.pooled:
        _check_axis(f"{path}: pooled", axis, settings)
    if settings.pooled:
        _check_list(f"{path}: pooled", settings.pooled)


def _check_cases(path: Path, settings: StudySettings) -> None:
    """Refuse settings of a case that stand elsewhere as well."""
    for name, case in settings.cases.items():
        for key in case:
            other = "axes" if key in settings.axes else "settings" if key in settings.settings else None
            if other is not None:
                raise InputError(f"{path}: cases.{name}.{key}", f"is among the {other}: too", "one of the two")


def _named_settings(settings: StudySettings) -> Iterator[tuple[str, Iterable[str]]]:
    """Yield the name of each group of settings in the file, with its keys."""
    yield "axes", settings.axes
    yield "settings", settings.settings
    yield from ((f"cases.{name}", case) for name, case in settings.cases.items())


def _check_axes(path: Path, settings: StudySettings) -> None:
    """Refuse axes without values, with a value twice, and what the study itself sets."""
    if not settings.run_axes:
        raise InputError(f"{path}: axes", "{} is not possible", "not empty")
    for group, keys in _named_settings(settings):
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
    wanted = len(settings.row_axes[reference.axis])
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
        if value not in settings.row_axes[axis]:
            raise InputError(f"{where}.where.{axis}", text(value), ", ".join(map(text, settings.row_axes[axis])))
    for name in (*figure.measures, *figure.log):
        _check_measure(f"{where}.measures", name, settings)
    if figure.kind == "curves" and figure.x is None:
        raise InputError(f"{where}.x", "is missing", ", ".join(settings.row_axes))
    if figure.kind == "yaw_over_time" and figure.x is not None:
        raise InputError(f"{where}.x", "is the time in this figure", "lines, panels, where")
    named = [*used.values(), *figure.where]
    for axis, values in settings.row_axes.items():
        if named.count(axis) > 1:
            raise InputError(where, f"uses {axis} twice", "each axis once among x, lines, panels, where")
        if axis not in named and len(values) > 1:
            raise InputError(where, f"leaves {axis} open", "each axis among x, lines, panels, where")


def _check_axis(where: str, axis: str, settings: StudySettings) -> None:
    if axis not in settings.row_axes:
        raise unknown_name(where, axis, list(settings.row_axes))


def _check_measure(where: str, name: MeasureName, settings: StudySettings) -> None:
    if name not in settings.measure:
        raise unknown_name(where, name, list(settings.measure))
