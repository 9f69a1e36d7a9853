"""The estimator on a known scene: accuracy, consistency, starts, determinism."""

import numpy as np
import pytest

from snakeslam.errors import InputError
from snakeslam.estimation.base import FrameEstimate
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.estimation.vio.odometry import VisualInertialOdometry
from snakeslam.geometry import se3, so3
from tests.estimation.wall import RIG, Wall


def run(wall: Wall, duration_s: float) -> list[FrameEstimate]:
    vio = VisualInertialOdometry(EstimatorSettings(), RIG, seed=0)
    estimates = (vio.process(packet) for packet in wall.packets(duration_s))
    return [estimate for estimate in estimates if estimate is not None]


def errors(wall: Wall, estimates: list[FrameEstimate]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return position and rotation errors after aligning yaw and position of the first pose, and variances."""
    tracked = [e for e in estimates if e.pose is not None and e.health.verdict.tracked]
    true = [wall.pose(e.t_ns / 1e9) for e in tracked]
    first = tracked[0].pose.T_WI
    R = so3.from_yaw(so3.yaw(first) - so3.yaw(true[0]))
    T = se3.from_rt(R, first[:3, 3] - R @ true[0][:3, 3])
    e_p = np.array([(T @ X)[:3, 3] - e.pose.T_WI[:3, 3] for e, X in zip(tracked, true, strict=True)])
    e_r = np.array([so3.log(e.pose.T_WI[:3, :3].T @ (T @ X)[:3, :3]) for e, X in zip(tracked, true, strict=True)])
    return e_p, e_r, np.array([e.pose.cov for e in tracked])


def test_rgbd_from_a_stationary_start() -> None:
    wall = Wall()
    estimates = run(wall, 4.0)
    e_p, e_r, _ = errors(wall, estimates)
    first = next(e for e in estimates if e.pose is not None)
    assert first.t_ns <= 300_000_000
    assert len(e_p) >= 0.98 * len(estimates) - 1
    assert np.linalg.norm(e_p, axis=1).max() < 0.01
    assert np.rad2deg(np.linalg.norm(e_r[-20:], axis=1)).max() < 1.0
    assert not any("reset" in e.events for e in estimates)


def test_monocular_start_in_motion() -> None:
    wall = Wall(depth=False, start_s=2.0)
    estimates = run(wall, 3.0)
    e_p, _, _ = errors(wall, estimates)
    assert any("initialised, in motion" in e.events for e in estimates)
    assert np.linalg.norm(e_p, axis=1).max() < 0.08


def test_a_stationary_head_does_not_drift() -> None:
    wall = Wall(stationary=True)
    e_p, _, _ = errors(wall, run(wall, 5.0))
    assert np.linalg.norm(e_p, axis=1).max() < 0.005


@pytest.mark.parametrize("depth", [True, False], ids=["depth", "mono"])
def test_a_nearly_stationary_head_keeps_its_position(depth: bool) -> None:
    """The first pose within 1 s, and at most 5 mm of drift in 5 s, without any parallax too."""
    wall = Wall(stationary=True, tremor_m=0.0005, depth=depth)
    estimates = run(wall, 6.0)
    first = next(e for e in estimates if e.pose is not None)
    assert first.t_ns <= 1_000_000_000
    e_p, _, _ = errors(wall, estimates)
    assert np.linalg.norm(e_p, axis=1).max() < 0.005
    assert not any("reset" in e.events for e in estimates)


def test_the_covariance_is_consistent_with_the_error() -> None:
    """NEES of position and orientation (3 each when exact), wide bounds: a few seeds on a rendered scene."""
    nees_p, nees_r = [], []
    for seed in range(2):
        wall = Wall(seed=seed)
        e_p, e_r, cov = errors(wall, run(wall, 3.0))
        nees_p += [e @ np.linalg.solve(P[3:6, 3:6], e) for e, P in zip(e_p[5:], cov[5:], strict=True)]
        nees_r += [e @ np.linalg.solve(P[:3, :3], e) for e, P in zip(e_r[5:], cov[5:], strict=True)]
    assert 0.05 < np.mean(nees_p) < 12.0
    assert 0.05 < np.mean(nees_r) < 12.0


def test_same_packets_same_bytes() -> None:
    once, again = (run(Wall(), 1.5) for _ in range(2))
    poses = [[e.pose.T_WI.tobytes() for e in estimates if e.pose is not None] for estimates in (once, again)]
    assert len(poses[0]) > 20
    assert poses[0] == poses[1]


def test_needs_an_imu() -> None:
    with pytest.raises(InputError, match="IMU"):
        VisualInertialOdometry(EstimatorSettings(), RIG.model_copy(update={"imu0": None}), 0)
