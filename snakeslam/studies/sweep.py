"""Works a study through: every run in a process of its own, a row as soon as it ends, the figures at the end."""

import json
import shutil
from collections.abc import Callable, Generator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from snakeslam.claims import Claim, lock
from snakeslam.errors import InputError
from snakeslam.messages import Float
from snakeslam.studies.experiment import commit, versions
from snakeslam.studies.point import Measured, run_point
from snakeslam.studies.rows import Row, read_rows, write_rows
from snakeslam.studies.run_directory import default_out
from snakeslam.studies.study import Point, Study
from snakeslam.studies.table import markdown
from snakeslam.studies.workers import Failure, work_through

RESULTS, SUMMARY, SERIES, FIGURES, FACTS, COPY = (
    "results.csv",
    "summary.md",
    "series",
    "figures",
    "study.json",
    "study.yaml",
)
SERIES_HEADER = "t_s,yaw_rad,x_m,y_m"
Report = Callable[[Row], None]


@dataclass(frozen=True, slots=True)
class StudyResult:
    """Where a study was written, its rows in order, and its table."""

    out: Path
    rows: tuple[Row, ...]
    table: str

    @property
    def failed(self) -> int:
        """Number of runs that failed."""
        return sum(row.status == "failed" for row in self.rows)


def run_study(
    study: Study,
    out: Path | None,
    workers: int = 1,
    resume: bool = False,
    report: Report | None = None,
    run: Callable[[Point], Measured] = run_point,
) -> StudyResult:
    """Run what is not yet done of ``study`` and write the folder ``out``, runs/<UTC time>-<name> without one.

    ``resume``: keep the finished rows of ``out``; those that failed are run again. ``report`` is called with each row,
    the kept ones first. The results do not depend on the number of ``workers``. InputError, before anything runs, when
    ``out`` is not what it should be, or another process is at work in it.
    """
    with _held(_claimed(study.name, out, resume)) as folder:
        return _run(study, folder, _prepare(study, folder, resume), workers, report, run)


@contextmanager
def _held(claim: Claim) -> Generator[Path]:
    """Yield a claimed folder and give it up at the end; it stays."""
    try:
        yield claim.path
    finally:
        claim.release()


def _run(
    study: Study,
    out: Path,
    rows: list[Row],
    workers: int,
    report: Report | None,
    run: Callable[[Point], Measured],
) -> StudyResult:
    """Run what ``rows`` do not have yet."""
    for row in rows:
        if report is not None:
            report(row)
    done = {row.point.number for row in rows}
    with closing(work_through([p for p in study.points if p.number not in done], run, workers)) as results:
        for point, result in results:
            new = _keep(out, point, result)
            rows += new
            write_rows(out / RESULTS, study, rows)
            for row in new:
                if report is not None:
                    report(row)
    rows.sort(key=lambda row: row.point.number)
    return StudyResult(out, tuple(rows), write_summary(study, out, rows))


def write_summary(study: Study, out: Path, rows: list[Row]) -> str:
    """Write table and figures of ``rows`` and return the table."""
    # Matplotlib is slow to load, and workers do not need it.
    from snakeslam.studies.figures import draw

    table = markdown(study, rows)
    (out / SUMMARY).write_text(table + "\n", encoding="utf-8")
    series = {row.point.number: _load_series(out, row.point) for row in rows if row.status == "done"}
    (out / FIGURES).mkdir(exist_ok=True)
    for figure in study.settings.figures:
        draw(study, figure, rows, series, out / FIGURES / f"{figure.name}.png")
    return table


def _claimed(name: str, out: Path | None, resume: bool) -> Claim:
    """Make or find the folder and lock it, so that no other study writes there."""
    while True:
        folder = default_out(name) if out is None else out
        _check_folder(folder, resume)
        try:
            folder.mkdir(parents=True, exist_ok=out is not None)
        except OSError as error:
            if out is None and isinstance(error, FileExistsError):
                continue
            raise InputError(str(folder), f"the output folder cannot be made: {error.strerror}") from error
        found = lock(folder)
        if found is not None:
            _check_folder(folder, resume)
            return found
        if out is not None:
            raise InputError(str(folder), "is being written by another study", "a folder of its own")


def _check_folder(out: Path, resume: bool) -> None:
    if not resume and out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError(str(out), "exists already", "a new or an empty folder, or --resume")
    if resume and not (out / FACTS).is_file():
        raise InputError(str(out), "holds no study to resume", "the --out of a study that was begun")


def _prepare(study: Study, out: Path, resume: bool) -> list[Row]:
    """Fill the folder; return the rows that are kept."""
    rows: list[Row] = []
    if resume and (out / RESULTS).is_file():
        rows = [row for row in read_rows(out / RESULTS, study) if row.status == "done" and _has_series(out, row.point)]
    try:
        (out / SERIES).mkdir(parents=True, exist_ok=True)
        shutil.copyfile(study.path, out / COPY)
    except OSError as error:
        raise InputError(str(out), f"the output folder cannot be made: {error.strerror}") from error
    facts = {"study": study.name, "runs": len(study.points), "versions": versions(), "commit": commit()}
    facts["config"] = study.points[0].config.model_dump(mode="json")
    (out / FACTS).write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
    return rows


def _keep(out: Path, point: Point, result: Measured | Failure) -> list[Row]:
    """Return the rows of a result; its series is written beside."""
    first, others = point.estimators[0] if point.estimators else None, point.estimators[1:]
    if isinstance(result, Failure):
        return [Row(point, {}, "failed", result.reason, estimator) for estimator in (first, *others)]
    np.savetxt(
        _series_path(out, point),
        result.series,
        fmt="%.6g",
        delimiter=",",
        header=SERIES_HEADER,
        comments="",
    )
    return [Row(point, result.values, estimator=first), *(Row(point, result.heard[m], estimator=m) for m in others)]


def _series_path(out: Path, point: Point) -> Path:
    return out / SERIES / f"{point.key}.csv"


def _has_series(out: Path, point: Point) -> bool:
    """Whether the series can be read; a run whose series is missing or damaged is run again."""
    try:
        return _load_series(out, point).shape[1] == len(SERIES_HEADER.split(","))
    except (OSError, ValueError):
        return False


def _load_series(out: Path, point: Point) -> Float:
    return np.loadtxt(_series_path(out, point), delimiter=",", skiprows=1, ndmin=2)
