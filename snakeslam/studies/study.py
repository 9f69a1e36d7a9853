"""A study file checked and laid out as its runs: what is wrong is said before anything runs."""

import hashlib
import itertools
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from snakeslam.config import Config, Override, load_config, override_config
from snakeslam.control import Control
from snakeslam.errors import InputError
from snakeslam.gaits.catalogue import resolve
from snakeslam.robot.model import snake_model
from snakeslam.studies.measures import MEASURES, MeasureName
from snakeslam.studies.study_checks import check_study
from snakeslam.studies.study_file import Scalar, StudySettings, read_study, words

KEY_LENGTH = 12


@dataclass(frozen=True, slots=True)
class Point:
    """One run of a study: the values ``chosen`` on the axes, and all that determines its result.

    ``period_s`` is the gait's; the last ``measured_periods`` of the run are measured.
    """

    number: int
    chosen: dict[str, Scalar]
    config: Config
    period_s: float
    measured_periods: int
    measure: tuple[MeasureName, ...]
    estimator: bool

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
        facts = [self.config.model_dump(mode="json"), self.measured_periods, self.measure, self.estimator]
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


def load_study(path: Path) -> Study:
    """Return the study of the file ``path``; InputError for what is wrong with it or with one of its runs."""
    settings = read_study(path)
    check_study(path, settings)
    base = _base(path, settings)
    points: list[Point] = []
    for seed, chosen in itertools.product(settings.seeds, _combinations(settings)):
        points.append(_point(path, settings, base, len(points) + 1, seed, chosen))
    return Study(path, settings, tuple(points))


def _combinations(settings: StudySettings) -> Iterator[dict[str, Scalar]]:
    for values in itertools.product(*settings.axes.values()):
        yield dict(zip(settings.axes, values, strict=True))


def _base(path: Path, settings: StudySettings) -> Config:
    file = None if settings.base is None else path.parent / settings.base
    overrides = [Override(key, value, f"{path}: settings.{key}") for key, value in settings.settings.items()]
    return load_config(file, overrides)


def _point(
    path: Path, settings: StudySettings, base: Config, number: int, seed: int, chosen: dict[str, Scalar]
) -> Point:
    """Return one run; InputError where its settings do not go together."""
    given = [Override(key, value, f"{path}: axes.{key}") for key, value in chosen.items()]
    config = override_config(base, [*given, Override("run.seed", seed, f"{path}: seeds")])
    model = snake_model(config.robot)
    try:
        Control(model, config.gait, config.head)
        period_s = 2.0 * math.pi / resolve(config.gait, model).omega
        duration_s = config.run.rest_s + (settings.start_up_periods + settings.measured_periods) * period_s
        config = override_config(config, [Override("run.duration_s", round(duration_s, 6), "duration")])
    except InputError as error:
        raise InputError(f"{path}: {words(chosen)}", f"{error.where}: {error.problem}", error.allowed) from error
    estimator = needs_estimator(settings, config)
    return Point(number, chosen, config, period_s, settings.measured_periods, settings.measure, estimator)


def needs_estimator(settings: StudySettings, config: Config) -> bool:
    """Return whether a run has camera and estimator."""
    if settings.estimator != "auto":
        return settings.estimator == "on"
    return config.head.controller == "predictive" or any(MEASURES[name].estimated for name in settings.measure)
