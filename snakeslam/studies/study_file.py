"""The form of a study file (configs/studies/*.yaml)."""

import difflib
import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationError
from pydantic_core import ErrorDetails

from snakeslam.config import input_error, read_tree
from snakeslam.errors import InputError
from snakeslam.estimation.settings import Mode
from snakeslam.settings import Settings
from snakeslam.studies.measures import MeasureName

Scalar = bool | int | float | str | None


def _as_text(value: object) -> object:
    """Return a number, or true or false, as text: a title may be 2024."""
    return json.dumps(value) if isinstance(value, bool | int | float) else value


def _as_switch(value: object) -> object:
    """Return on or off for the words that mean it."""
    words = {"true": "on", "yes": "on", "false": "off", "no": "off"}
    word = str(value).lower() if isinstance(value, bool | str) else None
    return value if word is None else words.get(word, word)


def _with_names(where: object) -> object:
    """Return a figure's ``where`` with text for the axes whose values are names."""
    if not isinstance(where, dict):
        return where
    return {axis: _as_text(value) if axis in (CASE, ESTIMATOR) else value for axis, value in where.items()}


Text = Annotated[str, BeforeValidator(_as_text)]
FileName = Annotated[str, BeforeValidator(_as_text), Field(pattern=r"^[a-z0-9_]+$")]
Seed = Annotated[int, Field(ge=0, lt=2**32)]
CASE, ESTIMATOR = "case", "estimator"
"""Axes that are no settings: the named cases, and the estimators fed by one and the same run."""


class FigureSettings(Settings):
    """One figure. ``curves``: measures against an axis; ``yaw_over_time``: the head's yaw in the measured window."""

    name: FileName
    """Of the file figures/NAME.png."""
    kind: Literal["curves", "yaw_over_time"]
    x: Text | None = None
    """The axis along which curves run."""
    lines: Text | None = None
    """An axis with a line for each value."""
    panels: Text | None = None
    """An axis with a column for each value."""
    measures: tuple[MeasureName, ...] = ()
    """A row of panels for each; empty: all that are measured (curves)."""
    log: tuple[MeasureName, ...] = ()
    """Those on a logarithmic scale."""
    where: Annotated[dict[str, Scalar], BeforeValidator(_with_names)] = Field(default_factory=dict[str, Scalar])
    """Only the runs with these values."""


class ReferenceSettings(Settings):
    """Published values to compare a measure with."""

    source: Text
    measure: MeasureName
    axis: Text
    values: Annotated[tuple[float, ...], Field(min_length=1)]
    """One for each value of the axis, in its order."""


class StudySettings(Settings):
    """A study: every combination of the axes' values with every seed."""

    title: Text = ""
    base: Text | None = None
    """A configuration to start from, beside the study file; None: the defaults."""
    settings: dict[str, Scalar] = Field(default_factory=dict[str, Scalar])
    """Settings of every run."""
    axes: dict[str, list[Scalar]] = Field(default_factory=dict[str, list[Scalar]])
    """Settings and the values of each."""
    cases: dict[str, dict[str, Scalar]] = Field(default_factory=dict[str, dict[str, Scalar]])
    """What is no product: names, and the settings of each; an axis ``case`` before the others."""
    seeds: Annotated[tuple[Seed, ...], Field(min_length=1)] = (1,)
    start_up_periods: Annotated[int, Field(ge=0, le=100)] = 2
    """Gait periods after the start that are left out."""
    measured_periods: Annotated[int, Field(ge=1, le=1000)] = 3
    """Gait periods that are measured then."""
    duration_s: Annotated[float, Field(gt=0, le=86400)] | None = None
    """Length of every run; None: the rest and all these periods."""
    estimator: Annotated[Literal["auto", "on", "off"], BeforeValidator(_as_switch)] = "auto"
    """Camera and estimator; auto: in the runs that need them (predictive control, or a measure of the estimate)."""
    estimators: tuple[Mode, ...] = ()
    """Each run feeds all of them, the first one head control, and gives a row for each; empty: the configured one."""
    measure: Annotated[tuple[MeasureName, ...], Field(min_length=1)]
    pooled: tuple[Text, ...] = ()
    """Axes over which the table averages as over the seeds."""
    average: Literal["mean", "median"] = "mean"
    """What the table shows, beside the range."""
    reference: ReferenceSettings | None = None
    figures: tuple[FigureSettings, ...] = ()

    @property
    def run_axes(self) -> dict[str, list[Scalar]]:
        """What distinguishes the runs of one seed."""
        cases: dict[str, list[Scalar]] = {CASE: list(self.cases)} if self.cases else {}
        return cases | self.axes

    @property
    def row_axes(self) -> dict[str, list[Scalar]]:
        """What distinguishes the rows of one seed: that, and the estimator."""
        estimators: dict[str, list[Scalar]] = {ESTIMATOR: list(self.estimators)} if self.estimators else {}
        return self.run_axes | estimators


GROUPS: dict[str, type[Settings]] = {"figures": FigureSettings, "reference": ReferenceSettings}
WORDS = {
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "keys with values",
    "missing": "has to be given",
    "too_short": "not empty",
}


def read_study(path: Path) -> StudySettings:
    """Return the study file ``path``; InputError names file, key and what is allowed."""
    try:
        # Strict: a value of another type is refused, never converted; in JSON a list is a tuple's form.
        return StudySettings.model_validate_json(json.dumps(read_tree(path)), strict=True)
    except ValidationError as error:
        raise _study_error(path, error.errors()[0]) from error


def _study_error(path: Path, error: ErrorDetails) -> InputError:
    """Turn pydantic's first complaint into one line."""
    location = [str(part) for part in error["loc"]]
    where = f"{path}: {'.'.join(location)}"
    if error["type"] == "extra_forbidden":
        group = GROUPS.get(location[0], StudySettings) if len(location) > 1 else StudySettings
        return unknown_name(where, location[-1], list(group.model_fields))
    if error["type"] == "missing":
        return InputError(where, "is missing", f"a study has {', '.join(StudySettings.model_fields)}")
    if error["type"] in WORDS:
        return InputError(where, f"{_short(error['input'])} is not possible", WORDS[error["type"]])
    return input_error(error, lambda _: where)


def unknown_name(where: str, name: str, known: list[str]) -> InputError:
    """Return the error for a name that is none of ``known``, with the nearest of them."""
    close = difflib.get_close_matches(name, known, n=1, cutoff=0.6)
    return InputError(where, f"unknown: {name}" + (f", did you mean {close[0]}?" if close else ""), ", ".join(known))


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def words(chosen: dict[str, Scalar]) -> str:
    """Return settings as KEY=VALUE, ..."""
    return ", ".join(f"{key}={text(value)}" for key, value in chosen.items())


def text(value: Scalar) -> str:
    """Return a value as YAML has it."""
    return value if isinstance(value, str) else json.dumps(value)
