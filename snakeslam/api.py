"""The public functions of the package: a scripted run, a replay and a study, as the command line makes them."""

import os
from pathlib import Path

from snakeslam.config import Config, load_config
from snakeslam.studies.experiment import RunResult, run_experiment
from snakeslam.studies.study import load_study
from snakeslam.studies.sweep import StudyResult, run_study


def run(
    config: Config | None = None, *, duration_s: float | None = None, out: str | os.PathLike[str] | None = None
) -> RunResult:
    """Make a scripted run of ``config`` (the defaults without one) and return what was measured.

    The same settings and seed give the same result. The run's files are written to the new folder ``out``,
    runs/<UTC time>-<name> without one; ``duration_s`` is simulated time, that of the settings without one.

    Raises:
        InputError: Settings that cannot be run, an ``out`` that exists; the text says what, where and what is allowed.
        SnakeslamError: A run that failed; it leaves no files.
    """
    return run_experiment(config or load_config(), duration_s=duration_s, out=_path(out))


def replay(
    path: str | os.PathLike[str],
    config: Config | None = None,
    *,
    duration_s: float | None = None,
    out: str | os.PathLike[str] | None = None,
) -> RunResult:
    """Run the estimator over the recording at ``path``, an EuRoC or TUM RGB-D folder, and return what was measured.

    ``estimator.mode`` and ``run.seed`` are those that suit the recording unless ``config`` sets them; it is played for
    ``duration_s``, to its end without one. Files and errors as in ``run``.
    """
    return run_experiment(config or load_config(), Path(path), duration_s, _path(out))


def study(
    path: str | os.PathLike[str],
    *,
    workers: int = 1,
    out: str | os.PathLike[str] | None = None,
    resume: bool = False,
) -> StudyResult:
    """Make all runs of the study file at ``path``, on ``workers`` processes, and return its rows and its table.

    The result does not depend on ``workers``. ``resume`` keeps the finished rows of ``out``. With several workers call
    it below ``if __name__ == "__main__":``, as ``multiprocessing`` demands.

    Raises:
        InputError: A study file that is wrong, before anything runs.
    """
    return run_study(load_study(Path(path)), _path(out), workers, resume)


def _path(out: str | os.PathLike[str] | None) -> Path | None:
    return None if out is None else Path(out)
