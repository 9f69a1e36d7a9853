"""The real EuRoC clip, which starts in motion, through the loop that ``snakeslam replay`` turns."""

from pathlib import Path

from snakeslam.config import load_config
from snakeslam.studies.experiment import run_experiment


def test_euroc_in_motion(shared_data: Path, tmp_path: Path) -> None:
    result = run_experiment(load_config(), shared_data / "euroc_v101_moving", out=tmp_path / "run")
    metrics = result.metrics
    assert metrics.frames == 90
    assert metrics.tracked_fraction is not None
    assert metrics.tracked_fraction >= 0.6
    assert metrics.ate_m.posyaw is not None
    assert metrics.ate_m.posyaw <= 0.06
    assert metrics.resets == 0
