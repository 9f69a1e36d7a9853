"""A study file checked and laid out as its runs: what is wrong is said before anything runs."""

import hashlib
import itertools
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from snakeslam.backends.registry import BACKENDS
from snakeslam.config import Config, Override, load_config, override_config
from snakeslam.control import Control
from snakeslam.errors import InputError
from snakeslam.estimation.settings import Mode
from snakeslam.gaits.catalogue import resolve
from snakeslam.head.laws import feeds_back
from snakeslam.robot.model import snake_model
from snakeslam.studies.measures import MEASURES, MeasureName
from snakeslam.studies.study_checks import check_study
from snakeslam.studies.study_file import CASE, Scalar, StudySettings, read_study, words

KEY_LENGTH = 12
MAX_RUNS = 20_000


@dataclass(frozen=True, slots=True)
class Point:
    """One run of a study: the values ``chosen`` on the axes, and all that determines its result.

    ``period_s`` is the gait's; the last ``measured_periods`` of the run are measured. All ``estimators`` are fed by it,
    the first of them is the configured one.
    """

    number: int
    chosen: dict[str, Scalar]
    config: Config
    period_s: float
    measured_periods: int
    measure: tuple[MeasureName, ...]
    estimator: bool
    estimators: tuple[Mode, ...] = ()

    @property
    def seed(self) -> int:
        """Seed of everything random."""
        return self.config.run.seed

    @property
    def words(self) -> str:
        """The run in words."""
        return f"{words(self.chosen)}, seed {self.seed}"

    @property
    def key(self) -> str:
        """A digest of all that determines the result."""
        facts = [
            self.config.model_dump(mode="json"),
            self.measured_periods,
            self.measure,
            self.estimator,
            self.estimators,
        ]
        return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:KEY_LENGTH]


@dataclass(frozen=True, slots=True)
class Study:
    """A study with its runs in order: the seeds outermost, then the axes as the file has them."""

    path: Path
    settings: StudySettings
    points: tuple[Point, ...]

    @property
    def name(self) -> str:
        """Name of the file."""
        return self.path.stem

    @property
    def row_count(self) -> int:
        """How many rows there will be."""
        return len(self.points) * max(1, len(self.settings.estimators))


def load_study(path: Path) -> Study:
    """Return the study of the file ``path``; InputError for what is wrong with it or with one of its runs."""
    settings = read_study(path)
    check_study(path, settings)
    count = math.prod(map(len, [settings.seeds, *settings.run_axes.values()]))
    if count > MAX_RUNS:
        raise InputError(f"{path}: axes", f"{count} runs", f"up to {MAX_RUNS}")
    base = _base(path, settings)
    points: list[Point] = []
    for seed, chosen in itertools.product(settings.seeds, _combinations(settings)):
        points.append(_point(path, settings, base, len(points) + 1, seed, chosen))
    return Study(path, settings, tuple(points))


def _combinations(settings: StudySettings) -> Iterator[dict[str, Scalar]]:
    for values in itertools.product(*settings.run_axes.values()):
        yield dict(zip(settings.run_axes, values, strict=True))


def _base(path: Path, settings: StudySettings) -> Config:
    file = None if settings.base is None else path.parent / settings.base
    overrides = [Override(key, value, f"{path}: settings.{key}") for key, value in settings.settings.items()]
    return load_config(file, overrides)


def _point(
    path: Path, settings: StudySettings, base: Config, number: int, seed: int, chosen: dict[str, Scalar]
) -> Point:
    """Return one run; InputError where its settings do not go together."""
    given = [Override("run.seed", seed, f"{path}: seeds")]
    given += [Override("estimator.mode", mode, f"{path}: estimators") for mode in settings.estimators[:1]]
    config = override_config(base, [*_chosen_overrides(path, settings, chosen), *given])
    if BACKENDS[config.backend].recorded:
        raise InputError(f"{path}: backend", f"{config.backend} cannot be repeated with other settings", "a simulator")
    model = snake_model(config.robot)
    try:
        Control(model, config.gait, config.head)
        period_s = 2.0 * math.pi / resolve(config.gait, model).omega
        duration_s = _duration_s(settings, config.run.rest_s, period_s)
        config = override_config(config, [Override("run.duration_s", round(duration_s, 6), "duration")])
    except InputError as error:
        raise InputError(f"{path}: {words(chosen)}", f"{error.where}: {error.problem}", error.allowed) from error
    if settings.estimator == "off" and _feeds_back(config):
        allowed = "estimator: auto or on, or head.controller: none, direction or position"
        raise InputError(f"{path}: estimator", "predictive head control, the default, feeds back the estimate", allowed)
    estimator = needs_estimator(settings, config)
    return Point(
        number, chosen, config, period_s, settings.measured_periods, settings.measure, estimator, settings.estimators
    )


def _chosen_overrides(path: Path, settings: StudySettings, chosen: dict[str, Scalar]) -> list[Override]:
    case = chosen.get(CASE)
    of_case = settings.cases[str(case)] if case is not None else {}
    overrides = [Override(key, value, f"{path}: cases.{case}.{key}") for key, value in of_case.items()]
    return overrides + [Override(key, chosen[key], f"{path}: axes.{key}") for key in settings.axes]


def _duration_s(settings: StudySettings, rest_s: float, period_s: float) -> float:
    measured_s = rest_s + settings.measured_periods * period_s
    if settings.duration_s is None:
        return measured_s + settings.start_up_periods * period_s
    if settings.duration_s < measured_s:
        raise InputError("duration_s", f"{settings.duration_s:g} s", f"{measured_s:g} s or more to measure in")
    return settings.duration_s


def _feeds_back(config: Config) -> bool:
    return feeds_back(config.head.controller, resolve(config.gait, snake_model(config.robot)))


def needs_estimator(settings: StudySettings, config: Config) -> bool:
    """Return whether a run has camera and estimator."""
    if settings.estimators:
        return True
    if settings.estimator != "auto":
        return settings.estimator == "on"
    return _feeds_back(config) or any(MEASURES[name].estimated for name in settings.measure)
