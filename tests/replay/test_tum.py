"""The visual mode on a real RGB-D recording: fast turns, blur."""

from pathlib import Path

import numpy as np
import pytest

from snakeslam.backends.replay.backend import ReplayBackend
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.mapping.settings import MappingSettings
from snakeslam.messages import GroundTruth, SlamUpdate
from snakeslam.recording.settings import ReplaySettings
from snakeslam.slam import Slam
from snakeslam.studies.metrics import Metrics, evaluate

Replay = tuple[list[SlamUpdate], list[GroundTruth]]


@pytest.fixture(scope="module")
def replay(shared_data: Path) -> Replay:
    path = shared_data / "tum_fr1_rpy_part1"
    if not path.is_dir():
        pytest.skip(f"no recording at {path}")
    backend = ReplayBackend(path, ReplaySettings())
    slam = Slam(EstimatorSettings(mode="visual"), MappingSettings(), backend.rig, 0)
    updates: list[SlamUpdate] = []
    truth: list[GroundTruth] = []
    while (packets := backend.step(None)) is not None:
        updates += [update for packet in packets if (update := slam.process(packet)) is not None]
        truth += backend.read_ground_truth()
    truth += backend.read_ground_truth()
    return updates, truth


def judge(replay: Replay) -> Metrics:
    updates, truth = replay
    return evaluate(updates, truth, [], (updates[-1].t_ns - updates[0].t_ns) / 1e9, 1.0, False, None)


def test_fast_rotations_are_tracked(replay: Replay) -> None:
    metrics = judge(replay)
    assert metrics.frames == 200
    assert metrics.resets == 0
    assert metrics.tracked_fraction is not None
    assert metrics.tracked_fraction >= 0.99
    assert metrics.ate_m.se3 is not None
    assert metrics.ate_m.se3 <= 0.045
    assert metrics.rpe_1s.rot_deg is not None
    assert metrics.rpe_1s.rot_deg <= 3.5


def test_the_map_is_near_the_camera_and_coloured(replay: Replay) -> None:
    chunks = [chunk for update in replay[0] for chunk in update.chunks]
    assert len(chunks) >= 3
    points = np.concatenate([chunk.points_K for chunk in chunks])
    assert 1000 < len(points)
    assert 0.25 <= points[:, 2].min()
    assert points[:, 2].max() <= MappingSettings().depth_max_m
    rgb = np.concatenate([chunk.rgb for chunk in chunks])
    assert np.ptp(rgb.astype(int), axis=1).max() > 50
