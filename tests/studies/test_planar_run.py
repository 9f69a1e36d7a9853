"""The paper's filter on the simulated robot, and over the recording of its own run."""

import json
from pathlib import Path

import pytest

from snakeslam.cli import main

# The head swings with the body, as in the paper: the gait model alone is then clearly worse.
FAST = ["--set", "sim.camera.rate_hz=10", "--set", "run.rest_s=0.2", "--set", "head.controller=none"]


def metrics(folder: str) -> dict[str, float]:
    found = json.loads(Path(folder, "run.json").read_text())["metrics"]
    return {"ate": found["ate_m"]["posyaw"], "tracked": found["tracked_fraction"], "path": found["path_m"]}


def test_planar_is_better_than_the_gait_alone(
    tmp_path: Path, checkout: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One run and two replays of its sensors: the same mode gives the same bytes, the raw odometry a larger error."""
    monkeypatch.chdir(tmp_path)
    record = ["--set", "recording.enabled=true", "--set", "estimator.mode=planar", *FAST]
    run = ["run", str(checkout / "configs/sim.yaml"), "--seed", "3", "--duration", "4", *record, "--out", "run"]
    assert main(run) == 0
    for mode in ("planar", "gait"):
        assert main(["replay", "run/sensors", "--set", f"estimator.mode={mode}", "--out", mode]) == 0
    assert Path("run/estimate.tum").read_bytes() == Path("planar/estimate.tum").read_bytes()
    planar, gait = metrics("planar"), metrics("gait")
    assert planar["path"] > 0.5
    assert planar["tracked"] > 0.95
    assert planar["ate"] < 0.01
    assert planar["ate"] < 0.7 * gait["ate"]
    assert gait["ate"] < 0.1 * gait["path"], "even the raw odometry is that of this robot"
    capsys.readouterr()


def test_planar_over_a_recording_without_joints_is_one_line(
    tmp_path: Path, shared_data: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for mode in ("planar", "gait"):
        clip = str(shared_data / "euroc_v101_moving")
        assert main(["replay", clip, "--set", f"estimator.mode={mode}", "--out", "x"]) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert f"'{mode}' needs a robot's joints, and here are none (allowed: visual, vio)" in said
    assert not list(tmp_path.iterdir())
