"""What is odd about a recording is said: on stderr, in run.json, on the timeline of the page."""

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from snakeslam.config import load_config
from snakeslam.runtime.assembly.spec import SessionSpec
from snakeslam.runtime.bus.topics import Event, Report
from snakeslam.runtime.session.recording import Session
from snakeslam.studies.experiment import run_experiment
from tests.small_recordings import HEIGHT, WIDTH, write_euroc, write_tum

TRUTH = "mav0/state_groundtruth_estimate0/data.csv"


def shift_truth(folder: Path, shift_ns: int) -> None:
    title, *rows = (folder / TRUTH).read_text().splitlines()
    moved = [f"{int(stamp) + shift_ns},{rest}" for stamp, rest in (row.split(",", 1) for row in rows)]
    (folder / TRUTH).write_text("\n".join([title, *moved]) + "\n")


def test_a_replay_that_tracks_nothing_says_so(tmp_path: Path) -> None:
    folder = write_euroc(tmp_path / "clip")
    for image in (folder / "mav0/cam0/data").iterdir():
        cv2.imwrite(str(image), np.zeros((HEIGHT, WIDTH), np.uint8))
    title, *samples = (folder / "mav0/imu0/data.csv").read_text().splitlines()
    shaken = [f"{row.split(',')[0]},{(-1) ** k},0,1,{9 * (-1) ** k},0,9.8" for k, row in enumerate(samples)]
    (folder / "mav0/imu0/data.csv").write_text("\n".join([title, *shaken]) + "\n")
    shift_truth(folder, -(10**18))
    command = [sys.executable, "-m", "snakeslam", "replay", str(folder), "--json", "--out", str(tmp_path / "run")]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0
    assert json.loads(ended.stdout.splitlines()[-1])["tracked_fraction"] == 0
    notes = [line for line in ended.stderr.splitlines() if line.startswith("snakeslam: note: ")]
    assert [line for line in notes if "the ground truth does not overlap the frames in time" in line]
    assert [line for line in notes if "nothing was tracked in 4 images: " in line]
    assert [line for line in notes if "the image has almost no contrast (grey 0 of 255" in line]
    written = json.loads((tmp_path / "run/run.json").read_text())["notes"]
    assert [f"snakeslam: note: {note}" for note in written] == notes


@pytest.mark.parametrize("shift_ns", [-(10**18), 10**18])
def test_a_truth_that_does_not_overlap_is_said(shared_data: Path, tmp_path: Path, shift_ns: int) -> None:
    source, folder = shared_data / "euroc_v101_moving/mav0", tmp_path / "clip/mav0"
    (folder / "state_groundtruth_estimate0").mkdir(parents=True)
    for name in ("cam0", "imu0"):
        (folder / name).symlink_to(source / name)
    (tmp_path / "clip" / TRUTH).write_text((source.parent / TRUTH).read_text())
    shift_truth(tmp_path / "clip", shift_ns)
    result = run_experiment(load_config(), tmp_path / "clip", duration_s=2.5, out=tmp_path / "run")
    assert result.metrics.ate_m.posyaw is None
    first, second = (note for note in result.notes if not note.startswith("head is null"))
    assert "the ground truth does not overlap the frames in time" in first
    assert second.startswith("the ground truth is known for 0 of ")
    assert second.endswith(" tracked poses, no error is known; path and speed are the estimate's")


def test_positions_without_orientation_are_compared_as_far_as_they_go(shared_data: Path, tmp_path: Path) -> None:
    source, folder = shared_data / "euroc_v101_moving/mav0", tmp_path / "clip/mav0"
    (folder / "leica0").mkdir(parents=True)
    for name in ("cam0", "imu0"):
        (folder / name).symlink_to(source / name)
    rows = [line.split(",")[:4] for line in (source.parent / TRUTH).read_text().splitlines()]
    (folder / "leica0/data.csv").write_text("\n".join(",".join(row) for row in rows) + "\n")
    metrics = run_experiment(load_config(), tmp_path / "clip", duration_s=3.0, out=tmp_path / "run").metrics
    assert metrics.ate_m.posyaw is not None
    assert metrics.ate_m.posyaw < 0.05
    assert metrics.rpe_1s.rot_deg is None
    assert metrics.nees.orientation is None


def test_a_played_recordings_notes_are_on_the_timeline(tmp_path: Path) -> None:
    folder = write_tum(tmp_path / "clip")
    lines = (folder / "depth.txt").read_text().splitlines()
    (folder / "depth.txt").write_text("\n".join(lines[:2] + lines[3:]) + "\n")
    reports: list[Report] = []
    Session(SessionSpec(load_config(), recording=folder), reports.append)
    events = [report for report in reports if isinstance(report, Event)]
    assert [event.level for event in events] == ["warning"]
    assert "depth.txt: 1 of 4 colour images have no depth image" in events[0].text
