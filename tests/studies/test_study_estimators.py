"""A study of several estimators that hear the same run, and of cases that are no product."""

import csv
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import yaml

from snakeslam.errors import InputError
from snakeslam.estimation.settings import Mode
from snakeslam.studies.point import Measured, run_point
from snakeslam.studies.study import Point, Study, load_study
from snakeslam.studies.sweep import run_study

TINY: dict[str, Any] = {
    "settings": {
        "robot.model": "orthogonal24",
        "gait.period_s": 1.0,
        "gait.wavelength_joints": 24,
        "run.rest_s": 0.4,
    },
    "cases": {
        "narrow": {"gait.alpha_pi": 0.05},
        "rolling": {"gait.name": "arc_rolling", "robot.head_posture": "flat"},
    },
    "axes": {"sim.world": ["corridor", "office"]},
    "estimators": ["vio", "gait"],
    "seeds": [1, 2, 3],
    "duration_s": 1.4,
    "measured_periods": 1,
    "measure": ["ate_posyaw_m", "tracked_fraction", "resets", "path_m", "ate_percent_of_path"],
    "pooled": ["sim.world"],
    "average": "median",
    "figures": [{"name": "ate", "kind": "curves", "x": "case", "lines": "estimator", "panels": "sim.world"}],
}


def write(folder: Path, **changes: Any) -> Path:
    path = folder / "tiny.yaml"
    path.write_text(yaml.safe_dump(TINY | changes, sort_keys=False))
    return path


def pretend(point: Point) -> Measured:
    """A run that takes no time: seed squared, ten times as much in the office, a hundred times for listeners."""
    if point.chosen["case"] == "rolling" and point.seed == 2:
        raise InputError("robot", "fell over")
    value = point.seed**2 * (10.0 if point.chosen["sim.world"] == "office" else 1.0)
    return Measured(
        dict.fromkeys(point.measure, value),
        np.zeros((2, 4)),
        {mode: dict.fromkeys(point.measure, 100.0 * value) for mode in point.estimators[1:]},
    )


def rows_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "results.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_case_sets_what_it_says_and_nothing_else(tmp_path: Path) -> None:
    points = load_study(write(tmp_path)).points
    assert len(points) == 2 * 2 * 3
    assert [point.chosen["case"] for point in points[:4]] == ["narrow", "narrow", "rolling", "rolling"]
    narrow, rolling = points[0].config, points[2].config
    assert (narrow.gait.name, narrow.gait.alpha_pi, narrow.robot.head_posture) == ("serpentine", 0.05, "raised")
    assert (rolling.gait.name, rolling.gait.alpha_pi, rolling.robot.head_posture) == ("arc_rolling", None, "flat")
    assert {point.config.run.duration_s for point in points} == {1.4}
    assert {point.config.estimator.mode for point in points} == {"vio"}
    assert all(point.estimator for point in points)


def test_the_runs_that_come_along_are_those_of_the_issue(checkout: Path) -> None:
    folder = checkout / "configs" / "studies"
    every, seeds = load_study(folder / "estimator.yaml"), load_study(folder / "estimator_seeds.yaml")
    assert set(every.settings.estimators) == set(get_args(Mode))
    assert every.settings.cases == seeds.settings.cases
    assert every.settings.axes == seeds.settings.axes == {"sim.world": ["corridor", "office", "rubble"]}
    for study in (every, seeds):
        assert study.settings.estimators[0] == "fused"
        assert {point.config.run.duration_s for point in study.points} == {20.0}
        gaits = {point.config.gait.name for point in study.points}
        assert gaits == {"serpentine", "sidewinding", "arc_rolling", "helix_rolling", "pedal"}
    assert len(seeds.settings.seeds) == 10


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Study, Path, str]:
    folder = tmp_path_factory.mktemp("study")
    study = load_study(write(folder))
    result = run_study(study, folder / "out", 1, run=pretend)
    return study, folder / "out", result.table


def test_each_estimator_has_its_row_of_the_same_run(finished: tuple[Study, Path, str]) -> None:
    study, out, _ = finished
    rows = rows_of(out)
    assert len(rows) == study.row_count == 24
    assert [(row["run"], row["estimator"]) for row in rows[:4]] == [
        ("1", "vio"),
        ("1", "gait"),
        ("2", "vio"),
        ("2", "gait"),
    ]
    assert [float(row["path_m"]) for row in rows[:4]] == [1.0, 100.0, 10.0, 1000.0]
    failed = [row for row in rows if row["status"] == "failed"]
    assert [(row["seed"], row["case"], row["estimator"]) for row in failed] == [
        ("2", "rolling", mode) for _ in range(2) for mode in ("vio", "gait")
    ]
    assert {row["reason"] for row in failed} == {"robot: fell over"}


def test_the_table_pools_worlds_and_seeds_and_shows_medians(finished: tuple[Study, Path, str]) -> None:
    """Narrow, vio: 1, 4, 9, 10, 40, 90; rolling has no seed 2."""
    _, out, table = finished
    assert "| case | estimator | ATE, posyaw (m) |" in table
    lines = [line.split(" | ") for line in table.splitlines() if line.startswith("| ")][2:]
    assert [line[0] + " " + line[1] for line in lines] == [
        "| narrow vio",
        "| narrow gait",
        "| rolling vio",
        "| rolling gait",
    ]
    assert lines[0][2] == "9.50 (1.00 to 90.0)"
    assert lines[3][2] == "950 (100 to 9000)"
    assert [line[-1] for line in lines] == ["6 |", "6 |", "4 |", "4 |"]
    assert table.count("- failed: case=rolling") == 4
    assert (out / "figures" / "ate.png").read_bytes().startswith(b"\x89PNG")


def test_resume_runs_again_what_lacks_a_row(finished: tuple[Study, Path, str], tmp_path: Path) -> None:
    study, out, _ = finished
    whole = (out / "results.csv").read_text()
    lines = whole.splitlines(keepends=True)
    (out / "results.csv").write_text("".join(line for k, line in enumerate(lines) if k != 2))
    ran: list[str] = []
    run_study(study, out, resume=True, report=lambda row: ran.append(row.words), run=pretend)
    assert (out / "results.csv").read_text() == whole
    # First what is kept; then run 1, whose row of gait was gone, and the four rows that failed.
    assert ran[-6:-4] == [
        "case=narrow, sim.world=corridor, seed 1, vio",
        "case=narrow, sim.world=corridor, seed 1, gait",
    ]
    assert len(ran) == 24


def test_a_row_of_no_estimator_of_the_study_is_damaged(finished: tuple[Study, Path, str]) -> None:
    study, out, _ = finished
    whole = (out / "results.csv").read_text()
    (out / "results.csv").write_text(whole.replace(",gait,", ",guess,", 1))
    try:
        with pytest.raises(InputError, match=r"line 3: is damaged: estimator guess \(allowed: vio, gait\)"):
            run_study(study, out, resume=True, run=pretend)
    finally:
        (out / "results.csv").write_text(whole)


def test_a_listener_says_what_it_says_alone_and_changes_nothing(tmp_path: Path) -> None:
    """All five at once, really run; then each that is cheap by itself, over the same motion."""
    modes: tuple[Mode, ...] = ("fused", "vio", "planar", "visual", "gait")

    def run(estimators: tuple[Mode, ...]) -> Measured:
        return run_point(load_study(write(tmp_path, estimators=list(estimators), seeds=[1])).points[2])

    together = run(modes)
    assert list(together.heard) == list(modes[1:])
    assert together.values["tracked_fraction"] is not None
    assert together.values["tracked_fraction"] > 0.9
    for mode in ("fused", "visual"):
        alone = run((mode,))
        assert alone.heard == {}
        assert alone.values == (together.values if mode == "fused" else together.heard[mode])
    assert len({str(values) for values in (together.values, *together.heard.values())}) == len(modes)
