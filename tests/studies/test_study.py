"""A study: its file's mistakes in one line each, its runs, resuming, workers, table and figures."""

import csv
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import yaml

from snakeslam.cli import main
from snakeslam.errors import InputError
from snakeslam.runtime.assembly.build import build_backend
from snakeslam.studies.measures import MEASURES, MeasureName
from snakeslam.studies.point import Measured, run_point
from snakeslam.studies.rows import Row
from snakeslam.studies.study import Point, Study, load_study
from snakeslam.studies.sweep import run_study
from snakeslam.studies.table import deviation, markdown, spread
from snakeslam.studies.workers import Failure, work_through

TINY: dict[str, Any] = {
    "settings": {
        "robot.model": "orthogonal24",
        "robot.head_posture": "flat",
        "gait.period_s": 1.0,
        "gait.wavelength_joints": 24,
        "run.rest_s": 0.0,
        "sim.world": "blank",
    },
    "axes": {"gait.alpha_pi": [0.05, 0.1], "head.controller": ["none", "direction"]},
    "start_up_periods": 0,
    "measured_periods": 1,
    "measure": ["yaw_rms_deg", "sway_pp_m", "roll_rms_deg", "speed_m_s"],
    "figures": [
        {"name": "curves", "kind": "curves", "x": "gait.alpha_pi", "lines": "head.controller", "log": ["yaw_rms_deg"]},
        {"name": "yaw", "kind": "yaw_over_time", "lines": "head.controller", "where": {"gait.alpha_pi": 0.1}},
    ],
}
Changes = Callable[[dict[str, Any]], object]


def write(folder: Path, change: Changes = lambda _: None) -> Path:
    """Write the tiny study with a change."""
    tree = yaml.safe_load(yaml.safe_dump(TINY))
    change(tree)
    path = folder / "tiny.yaml"
    path.write_text(yaml.safe_dump(tree, sort_keys=False))
    return path


def one_run(tree: dict[str, Any]) -> None:
    tree["axes"] = {"gait.alpha_pi": [0.1]}
    tree["figures"] = []


def pretend(point: Point) -> Measured:
    """A run that takes no time: its values tell of its point; alpha .4 fails, .5 takes its process along."""
    alpha = point.chosen["gait.alpha_pi"]
    assert isinstance(alpha, float)
    if alpha == 0.4:
        raise ValueError("the robot\nfell over")
    if alpha == 0.5:
        os._exit(3)
    return Measured(dict.fromkeys(point.measure, 10.0 * alpha + point.seed), np.zeros((2, 4)))


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_every_measure_is_defined() -> None:
    assert set(MEASURES) == set(get_args(MeasureName))


@pytest.mark.parametrize("name", ["head_stability", "swing_amplitude"])
def test_the_studies_that_come_along_are_in_order(checkout: Path, name: str) -> None:
    study = load_study(checkout / "configs" / "studies" / f"{name}.yaml")
    for point in study.points:
        assert point.estimator == (point.config.head.controller == "predictive")
        assert point.config.robot.head_posture == "flat"
        assert point.config.run.duration_s == pytest.approx(0.5 + 5 * 4.0)
    assert len({point.key for point in study.points}) == len(study.points)
    assert len(study.points) == {"head_stability": 4 * 4 * 2 * 3, "swing_amplitude": 4 * 2}[name]


def set_in(*path: str, to: Any) -> Changes:
    def change(tree: dict[str, Any]) -> None:
        for key in path[:-1]:
            tree = tree[key]
        tree[path[-1]] = to

    return change


MISTAKES: list[tuple[Changes, str]] = [
    (set_in("axis", to={}), "tiny.yaml: axis: unknown: axis, did you mean axes? (allowed: title, base, settings, "),
    (set_in("axes", to={}), "tiny.yaml: axes: {} is not possible (allowed: not empty)"),
    (set_in("axes", "gait.alpha_pi", to=[]), "tiny.yaml: axes.gait.alpha_pi: is empty (allowed: a list of one or more"),
    (set_in("axes", "gait.alpha_pi", to=0.1), "tiny.yaml: axes.gait.alpha_pi: 0.1 is not possible (allowed: a list)"),
    (set_in("axes", "gait.alpha_pi", to=[0.1, 0.1]), "tiny.yaml: axes.gait.alpha_pi: 0.1 is given twice"),
    (set_in("axes", "gait.alpa_pi", to=[0.1]), "axes.gait.alpa_pi: unknown key gait.alpa_pi, did you mean gait.alpha"),
    (set_in("axes", "gait.alpha_pi", to=[0.1, 2.0]), "tiny.yaml: axes.gait.alpha_pi: 2.0 is not possible (allowed: <="),
    (set_in("axes", "run.seed", to=[1]), "tiny.yaml: axes.run.seed: is set by the study itself (allowed: seeds: gives"),
    (set_in("axes", "gait.period_s", to=[2.0]), "axes.gait.period_s: is among the settings: too"),
    (set_in("settings", "gait.perod_s", to=2.0), "tiny.yaml: settings.gait.perod_s: unknown key"),
    (
        set_in("settings", "sim.world", to="moon"),
        "tiny.yaml: settings.sim.world: 'moon' is not possible (allowed: corr",
    ),
    (
        lambda tree: (
            tree.update(axes={"head.neck_joints": [6, 2], "head.controller": ["position"]}, figures=[])
            or tree["settings"].update({"gait.alpha_pi": 0.5, "gait.wavelength_joints": 16, "gait.period_s": 4.0})
        ),
        "tiny.yaml: head.neck_joints=2, head.controller=position: head.neck_joints: 2 yaw joints would bend",
    ),
    (
        lambda tree: (
            tree.update(axes={"gait.alpha_pi": [0.1, 0.4]}, figures=[])
            or tree["settings"].update({"gait.period_s": 0.5})
        ),
        "tiny.yaml: gait.alpha_pi=0.4: gait.period_s: 0.50 s is too fast",
    ),
    (set_in("seeds", to=[]), "tiny.yaml: seeds: [] is not possible (allowed: not empty)"),
    (set_in("seeds", to=[-1]), "tiny.yaml: seeds.0: -1 is not possible (allowed: >= 0)"),
    (set_in("seeds", to=[True]), "tiny.yaml: seeds.0: True is not possible (allowed: a whole number)"),
    (set_in("seeds", to=list(range(20_000))), "tiny.yaml: axes: 80000 runs (allowed: up to 20000)"),
    (set_in("measured_periods", to=True), "tiny.yaml: measured_periods: True is not possible (allowed: a whole"),
    (set_in("duration_s", to="3"), "tiny.yaml: duration_s: '3' is not possible (allowed: a number)"),
    (
        set_in("axes", "gait.alpha_pi", to=[0.1, "off"]),
        "tiny.yaml: axes.gait.alpha_pi: 'off' is not possible (allowed: a",
    ),
    (set_in("estimator", to="of"), "tiny.yaml: estimator: 'of' is not possible (allowed: auto, on, off)"),
    (set_in("measured_periods", to=0), "tiny.yaml: measured_periods: 0 is not possible (allowed: >= 1)"),
    (set_in("measure", to=["yaw"]), "tiny.yaml: measure.0: 'yaw' is not possible (allowed: yaw_rms_deg, "),
    (lambda tree: tree.pop("measure"), "tiny.yaml: measure: is missing"),
    (
        lambda tree: tree.update(estimator="off", measure=["ate_se3_m"], figures=[]),
        "tiny.yaml: measure: ate_se3_m needs the estimator (allowed: estimator: auto, on)",
    ),
    (
        lambda tree: tree.update(estimator="off") or tree["axes"]["head.controller"].append("predictive"),
        "tiny.yaml: estimator: predictive head control, the default, feeds back the estimate (allowed: estimator: auto",
    ),
    (
        lambda tree: tree.update(estimator="off", figures=[]) or tree["axes"].pop("head.controller"),
        "tiny.yaml: estimator: predictive head control, the default, feeds back the estimate (allowed: estimator: auto",
    ),
    (set_in("base", to="none.yaml"), "none.yaml: no such configuration file"),
    (set_in("figures", to=[{"name": "a b", "kind": "curves"}]), "tiny.yaml: figures.0.name: 'a b' is not possible"),
    (
        set_in("figures", to=[{"name": "a", "kind": "curves", "y": 1}]),
        "tiny.yaml: figures.0.y: unknown: y (allowed: nam",
    ),
    (set_in("figures", to=[{"name": "a", "kind": "curves"}]), "tiny.yaml: figures.0.x: is missing"),
    (
        set_in("figures", to=[{"name": "a", "kind": "curves", "x": "gait.alpha_pi"}]),
        "tiny.yaml: figures.0: leaves head.controller open",
    ),
    (
        set_in("figures", to=[{"name": "a", "kind": "yaw_over_time", "where": {"gait.alpha_pi": 0.3}}]),
        "tiny.yaml: figures.0.where.gait.alpha_pi: 0.3 (allowed: 0.05, 0.1)",
    ),
    (
        set_in("cases", to={"slow": {"gait.alpha_pi": 0.2}}),
        "tiny.yaml: cases.slow.gait.alpha_pi: is among the axes: too (allowed: one of the two)",
    ),
    (
        set_in("cases", to={"slow": {"run.seed": 2}}),
        "tiny.yaml: cases.slow.run.seed: is set by the study itself",
    ),
    (set_in("cases", to={"slow": {"gait.nme": "pedal"}}), "tiny.yaml: cases.slow.gait.nme: unknown key gait.nme, did"),
    (set_in("cases", to=["slow"]), "tiny.yaml: cases: ['slow'] is not possible (allowed: keys with values)"),
    (set_in("estimators", to=["vio", "vio"]), "tiny.yaml: estimators: vio is given twice (allowed: each value once)"),
    (set_in("estimators", to=["orb"]), "tiny.yaml: estimators.0: 'orb' is not possible (allowed: visual, vio, planar"),
    (
        lambda tree: tree.update(estimators=["vio"]) or tree["settings"].update({"estimator.mode": "vio"}),
        "tiny.yaml: settings.estimator.mode: is set by the study itself (allowed: estimators: names them)",
    ),
    (
        lambda tree: tree.update(estimators=["vio"], estimator="off"),
        "tiny.yaml: estimators: estimator: is off (allowed: estimator: auto, on)",
    ),
    (
        set_in("duration_s", to=20.0),
        "tiny.yaml: duration_s: is given beside start_up_periods: (allowed: one of the two)",
    ),
    (
        lambda tree: tree.update(duration_s=0.5, start=tree.pop("start_up_periods")) or tree.pop("start"),
        "tiny.yaml: gait.alpha_pi=0.05, head.controller=none: duration_s: 0.5 s (allowed: 1 s or more to measure in)",
    ),
    (set_in("pooled", to=["sim.wolrd"]), "tiny.yaml: pooled: unknown: sim.wolrd (allowed: gait.alpha_pi, head.contro"),
    (set_in("average", to="mode"), "tiny.yaml: average: 'mode' is not possible (allowed: mean, median)"),
    (
        set_in("reference", to={"source": "a", "measure": "sway_pp_m", "axis": "gait.alpha_pi", "values": [1.0]}),
        "tiny.yaml: reference.values: 1 values (allowed: 2, one for each of the axis)",
    ),
]


@pytest.mark.parametrize(("change", "expected"), MISTAKES, ids=[expected[:40] for _, expected in MISTAKES])
def test_a_mistake_is_one_line_and_nothing_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: Changes, expected: str
) -> None:
    path = write(tmp_path, change)
    assert main(["study", str(path), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert expected in said.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("word", "value"), [("off", "off"), ("Off", "off"), ("no", "off"), ("false", "off"), ("on", "on"), ("yes", "on")]
)
def test_the_estimator_is_switched_by_any_of_the_words_for_it(tmp_path: Path, word: str, value: str) -> None:
    """In YAML 1.1 ``off`` is false, which was refused where the documentation says off."""
    path = write(tmp_path)
    path.write_text(path.read_text() + f"estimator: {word}\n")
    assert load_study(path).settings.estimator == value


@pytest.mark.parametrize(
    ("title", "text"),
    [("2024", "2024"), ("2024-01-01", "2024-01-01"), ("1.5", "1.5"), ("yes", "yes"), ("on", "on"), ("010", "010")],
)
def test_a_title_may_look_like_a_number_a_date_or_a_switch(tmp_path: Path, title: str, text: str) -> None:
    path = write(tmp_path, one_run)
    figure = "\n- {name: 3, kind: curves, x: gait.alpha_pi, where: {case: 1}}\n"
    path.write_text(
        path.read_text().replace("figures: []", f"figures:{figure}title: {title}\ncases: {{1: {{}}, on: {{}}}}")
    )
    study = load_study(path)
    assert study.settings.title == text
    assert study.settings.run_axes["case"] == ["1", "on"]


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["none.yaml"], "none.yaml: no such"),
        (["{study}", "--workers", "0"], "--workers: 0 (allowed: 1 to"),
        (["{study}", "--scheduler", "tcp://host"], "--scheduler: 'tcp://host' is not built yet"),
        (["{study}", "--resume"], "--resume: needs the folder to go on with (allowed: --out DIR)"),
        (["{study}", "--resume", "--out", "{folder}/new"], "new: holds no study to resume"),
        (["{study}", "--out", "{folder}"], "exists already (allowed: a new or an empty folder, or --resume)"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_a_wrong_argument_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], expected: str
) -> None:
    study = write(tmp_path)
    filled = [argument.format(study=study, folder=tmp_path) for argument in arguments]
    assert main(["study", *filled]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert expected in said
    assert list(tmp_path.iterdir()) == [study]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Study, Path]:
    """The tiny study, really run by two workers through the command line."""
    folder = tmp_path_factory.mktemp("study")
    path = write(folder)
    assert main(["study", str(path), "--workers", "2", "--out", str(folder / "out")]) == 0
    return load_study(path), folder / "out"


def test_rows_stand_in_the_order_of_the_runs(finished: tuple[Study, Path]) -> None:
    study, out = finished
    rows = rows_of(out / "results.csv")
    assert [(row["gait.alpha_pi"], row["head.controller"]) for row in rows] == [
        ("0.05", "none"),
        ("0.05", "direction"),
        ("0.1", "none"),
        ("0.1", "direction"),
    ]
    assert [row["run"] for row in rows] == ["1", "2", "3", "4"]
    assert [row["key"] for row in rows] == [point.key for point in study.points]
    assert {row["status"] for row in rows} == {"done"}


def test_what_is_measured_is_the_heads_motion(finished: tuple[Study, Path]) -> None:
    """A wider wave swings the head more, and direction control swings it less."""
    yaw = [float(row["yaw_rms_deg"]) for row in rows_of(finished[1] / "results.csv")]
    assert yaw[2] > 1.5 * yaw[0] > 1.0
    assert yaw[1] < 0.5 * yaw[0]
    assert yaw[3] < 0.5 * yaw[2]


def test_the_result_does_not_depend_on_the_workers_or_what_ran_before(finished: tuple[Study, Path]) -> None:
    """The last run alone, in this process, gives the very numbers of its row."""
    study, out = finished
    measured = run_point(study.points[-1])
    assert Row(study.points[-1], measured.values).cells() == list(rows_of(out / "results.csv")[-1].values())


def test_table_and_figures_are_written(finished: tuple[Study, Path]) -> None:
    out = finished[1]
    for name in ("curves", "yaw"):
        assert (out / "figures" / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    table = (out / "summary.md").read_text()
    assert "| `gait.alpha_pi` | `head.controller` | head yaw RMS (deg) | sway, peak to peak (m) |" in table
    assert table.count("\n| 0.") == 4


def test_the_motion_is_the_same_with_and_without_the_camera(finished: tuple[Study, Path]) -> None:
    config = finished[0].points[0].config
    truths: list[np.ndarray] = []
    for camera in (True, False):
        backend = build_backend(config, "here" if camera else "none")
        for _ in range(5):
            backend.step(None)
        truths.append(np.array([sample.T_WI for sample in backend.read_ground_truth()]))
        backend.close()
    assert len(truths[0]) == 10
    np.testing.assert_array_equal(truths[0], truths[1])


def test_resume_runs_what_is_missing_and_gives_the_same_file(
    finished: tuple[Study, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study, out = finished
    whole = (out / "results.csv").read_bytes()
    lines = whole.decode().splitlines(keepends=True)
    (out / "results.csv").write_text("".join([lines[0], lines[4], lines[1], lines[2]]))
    ran: list[int] = []
    result = run_study(study, out, resume=True, report=lambda row: ran.append(row.point.number), run=_only_third)
    assert ran == [4, 1, 2, 3]
    assert result.rows[2].status == "failed"
    assert result.failed == 1
    # What failed is run again.
    assert main(["study", str(study.path), "--workers", "1", "--out", str(out), "--resume"]) == 0
    assert (out / "results.csv").read_bytes() == whole


def _only_third(point: Point) -> Measured:
    raise InputError("run", f"{point.number} again")


def _failing(tree: dict[str, Any]) -> None:
    tree["axes"] = {"gait.alpha_pi": [0.1, 0.5, 0.4, 0.2]}
    tree["figures"] = []
    tree["settings"]["gait.period_s"] = 10.0


def test_a_run_that_fails_is_a_row_and_stops_no_other(tmp_path: Path) -> None:
    study = load_study(write(tmp_path, _failing))
    out, counts = tmp_path / "out", list[int]()
    result = run_study(study, out, 1, report=lambda _: counts.append(len(rows_of(out / "results.csv"))), run=pretend)
    rows = rows_of(out / "results.csv")
    assert result.failed == 2
    # Each row is there as soon as its run has ended.
    assert counts == [1, 2, 3, 4]
    assert [row["status"] for row in rows] == ["done", "failed", "failed", "done"]
    assert rows[1]["reason"] == "its process ended with code 3"
    assert rows[2]["reason"] == "ValueError: the robot fell over"
    assert rows[2]["sway_pp_m"] == ""
    assert [float(rows[k]["sway_pp_m"]) for k in (0, 3)] == [2.0, 3.0]
    assert "- failed: gait.alpha_pi=0.5, seed 1: its process ended with code 3" in result.table


def test_a_study_with_a_failure_ends_with_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run whose simulator cannot be made: the physics' rate does not fit the IMU's."""
    path = write(tmp_path, lambda tree: one_run(tree) or tree["settings"].update({"sim.physics.rate_hz": 401}))
    assert main(["study", str(path), "--workers", "1", "--out", str(tmp_path / "out")]) == 1
    said = capsys.readouterr()
    assert "1 of 1 runs failed" in said.err
    assert "sim.physics.rate_hz: 401 is not possible (allowed: multiples of 400)" in said.out


def test_resume_refuses_the_folder_of_another_study(finished: tuple[Study, Path], tmp_path: Path) -> None:
    other = load_study(write(tmp_path, lambda tree: tree.update(measure=["speed_m_s"], figures=[])))
    before = (finished[1] / "results.csv").read_bytes()
    with pytest.raises(InputError, match="has other columns than the study"):
        run_study(other, finished[1], resume=True, run=pretend)
    assert (finished[1] / "results.csv").read_bytes() == before


def _row(study: Study, number: int, sway_m: float) -> Row:
    return Row(study.points[number], {"sway_pp_m": sway_m})


def test_the_reference_is_set_beside_with_its_rms_deviation(tmp_path: Path) -> None:
    """.11 against .10 and .18 against .20: both 10 % off."""
    reference = {"source": "Paper", "measure": "sway_pp_m", "axis": "gait.alpha_pi", "values": [0.1, 0.2]}

    def change(tree: dict[str, Any]) -> None:
        tree.update(axes={"gait.alpha_pi": [0.1, 0.2]}, figures=[], reference=reference, measure=["sway_pp_m"])

    study = load_study(write(tmp_path, change))
    assert study.settings.reference is not None
    rows = [_row(study, 0, 0.11), _row(study, 1, 0.18)]
    assert deviation(study, study.settings.reference, rows) == pytest.approx(0.1)
    assert deviation(study, study.settings.reference, rows[:1]) is None
    assert markdown(study, rows).splitlines()[-2:] == [
        "| Paper | 0.100 | 0.200 |  |",
        "| measured | 0.110 | 0.180 | 10.0 % |",
    ]


def test_the_mean_of_equal_seeds_is_within_their_range(tmp_path: Path) -> None:
    """numpy's mean of three times .1 is above .1, and a negative error bar cannot be drawn."""
    study = load_study(write(tmp_path, lambda tree: one_run(tree) or tree.update(seeds=[1, 2, 3])))
    found = spread([_row(study, k, 0.1) for k in range(3)], "sway_pp_m")
    assert found is not None
    assert np.mean([0.1] * 3) > 0.1
    assert found.lowest == found.average == found.highest == 0.1


def test_the_table_tells_the_range_where_seeds_differ(tmp_path: Path) -> None:
    study = load_study(write(tmp_path, lambda tree: one_run(tree) or tree.update(seeds=[1, 2], measure=["sway_pp_m"])))
    differing = markdown(study, [_row(study, 0, 0.1), _row(study, 1, 0.2)])
    same = markdown(study, [_row(study, 0, 0.1), _row(study, 1, 0.1)])
    assert "| 0.1 | 0.150 (0.100 to 0.200) | 2 |" in differing
    assert "| 0.1 | 0.100 | 2 |" in same


def _square(job: int) -> int:
    return job * job


def test_leaving_the_work_early_leaves_no_process(tmp_path: Path) -> None:
    import multiprocessing

    results: Sequence[tuple[int, int | Failure]] = []
    work = work_through(range(4), _square, 2)
    results = [next(work)]
    work.close()
    assert results[0][1] == results[0][0] ** 2
    assert multiprocessing.active_children() == []


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"\xff\xfe\x00", "results.csv: cannot be read: 'utf-8' codec"),
        (b"run,seed\x00\n", "results.csv: "),
        (b'"' + b"x" * 200_000, "results.csv: is too large"),
        (b"x" * 30_000_000, "results.csv: is too large"),
        (b"", "results.csv: has other columns"),
    ],
)
def test_a_table_that_is_none_is_one_line_when_a_study_goes_on(tmp_path: Path, data: bytes, expected: str) -> None:
    study = load_study(write(tmp_path, one_run))
    run_study(study, tmp_path / "out", run=pretend)
    (tmp_path / "out" / "results.csv").write_bytes(data)
    with pytest.raises(InputError, match=expected) as caught:
        run_study(study, tmp_path / "out", resume=True, run=pretend)
    assert "\n" not in str(caught.value)


def test_a_damaged_series_is_run_again(tmp_path: Path) -> None:
    study = load_study(write(tmp_path, one_run))
    run_study(study, tmp_path / "out", run=pretend)
    (series,) = sorted((tmp_path / "out" / "series").iterdir())[:1]
    series.write_bytes(b"\x00\xff")
    assert run_study(study, tmp_path / "out", resume=True, run=pretend).failed == 0
    assert series.read_text().startswith("t_s,")


def test_a_folder_in_which_a_study_is_at_work_is_another_ones(tmp_path: Path) -> None:
    study = load_study(write(tmp_path, one_run))
    refused: list[str] = []

    def second(row: Row) -> None:
        with pytest.raises(InputError, match="out: is being written by another study") as caught:
            run_study(study, tmp_path / "out", resume=True, run=pretend)
        refused.append(str(caught.value))

    run_study(study, tmp_path / "out", run=pretend, report=second)
    assert len(refused) == len(study.points)


def test_studies_of_one_name_in_one_second_get_folders_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    study = load_study(write(tmp_path, one_run))
    outs = {run_study(study, None, run=pretend).out for _ in range(3)}
    assert len(outs) == 3
    assert sorted(path.parent.name for path in tmp_path.glob("runs/*/results.csv")) == sorted(out.name for out in outs)
