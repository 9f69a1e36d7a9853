"""Starts: stationary with any gyro bias or a tremor; an IMU that is late, silent or ends."""

from collections.abc import Callable, Iterable

import numpy as np
import pytest

from snakeslam.estimation.base import FrameEstimate
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.estimation.vio.odometry import VisualInertialOdometry
from snakeslam.messages import ImuSample, Packet
from tests.estimation.wall import RIG, Wall


def run(packets: Iterable[Packet], keep: Callable[[ImuSample], bool] = lambda _: True) -> list[FrameEstimate]:
    vio = VisualInertialOdometry(EstimatorSettings(), RIG, seed=0)
    kept = (p for p in packets if not isinstance(p, ImuSample) or keep(p))
    return [e for e in map(vio.process, kept) if e is not None]


def moved_m(estimates: list[FrameEstimate]) -> float:
    p = np.array([e.pose.T_WI[:3, 3] for e in estimates if e.pose is not None])
    return float(np.linalg.norm(p - p[0], axis=1).max())


STATIONARY = [
    ((0.0, 0.06, 0.0), (0.05, -0.03, 0.02), 0.0),
    ((-0.0022, 0.0215, 0.077), (0.05, -0.03, 0.02), 0.0),
    ((0.12, -0.15, 0.1), (0.05, -0.03, 0.02), 0.0),
    ((-0.0022, 0.0215, 0.077), (0.2, 0.25, -0.2), 0.0003),
    ((-0.0022, 0.0215, 0.077), (0.05, -0.03, 0.02), 0.001),
]


@pytest.mark.parametrize(("bias_g", "bias_a", "tremor_m"), STATIONARY)
def test_a_stationary_camera_without_depth_has_a_stationary_start(
    bias_g: tuple[float, float, float], bias_a: tuple[float, float, float], tremor_m: float
) -> None:
    """Whatever the gyro's bias: the image shows that nothing moves, and the bias is the gyro's mean rate then."""
    wall = Wall(stationary=True, depth=False, bias_g=bias_g, bias_a=bias_a, tremor_m=tremor_m)
    estimates = run(wall.packets(3.0))
    assert any("initialised, stationary" in e.events for e in estimates)
    assert all(e.pose is not None and e.health.verdict.tracked for e in estimates if e.t_ns >= 500_000_000)
    assert moved_m(estimates) < 0.003 + 2.0 * tremor_m


def test_a_stationary_start_of_a_camera_that_then_moves() -> None:
    wall = Wall(depth=False, bias_g=(-0.0022, 0.0215, 0.077))
    estimates = run(wall.packets(3.0))
    assert not any("reset" in e.events for e in estimates)
    last, first = estimates[-1], next(e for e in estimates if e.pose is not None)
    went = np.linalg.norm(last.pose.T_WI[:3, 3] - first.pose.T_WI[:3, 3])
    true = np.linalg.norm(wall.pose(last.t_ns / 1e9)[:3, 3] - wall.pose(first.t_ns / 1e9)[:3, 3])
    assert abs(went - true) < 0.05


@pytest.mark.parametrize("stationary", [True, False])
def test_no_start_before_the_imu_is_there(stationary: bool) -> None:
    wall = Wall(stationary=stationary, depth=False, start_s=0.0 if stationary else 2.0)
    estimates = run(wall.packets(2.5), lambda s: s.t_ns > 1_000_000_000)
    assert all(e.pose is None for e in estimates if e.t_ns <= 1_000_000_000)
    assert any(e.pose is not None and e.health.verdict.tracked for e in estimates)


@pytest.mark.parametrize("ends_ns", [100_000_000, 0])
def test_an_imu_that_ends_before_the_start_gives_none(ends_ns: int) -> None:
    wall = Wall(depth=False, start_s=2.0)
    estimates = run(wall.packets(2.0), lambda s: s.t_ns < ends_ns)
    assert all(e.pose is None for e in estimates)


def test_a_gap_in_the_middle_of_a_start_begins_it_anew() -> None:
    """The start in motion integrates over 0.7 s: not over a time without samples."""
    wall = Wall(depth=False, start_s=2.0)
    estimates = run(wall.packets(2.0), lambda s: not 400_000_000 < s.t_ns < 600_000_000)
    first = next(e for e in estimates if e.pose is not None)
    assert first.t_ns >= 1_250_000_000
