"""Knocks, spikes, stuck and missing samples: doubted, said, and corrected by the camera."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from snakeslam.estimation.base import FrameEstimate
from snakeslam.estimation.filter.imu_doubt import STUCK, ImuFaultDetector
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.estimation.vio.odometry import VisualInertialOdometry
from snakeslam.messages import ImuSample, Packet, Verdict
from tests.estimation.wall import RIG, Wall

AT_NS = 1_800_000_000
IMU_NS = 5_000_000
GRAVITY = np.array([0.0, 0.0, 9.81])


def run(wall: Wall, spoil: Callable[[ImuSample, int], Packet | None], duration_s: float = 3.0) -> list[FrameEstimate]:
    """Run with ``spoil(sample, k)`` from the sample at 1.8 s on, which is number 0."""
    vio = VisualInertialOdometry(EstimatorSettings(), RIG, seed=0)
    packets = (
        spoil(p, (p.t_ns - AT_NS) // IMU_NS) if isinstance(p, ImuSample) and p.t_ns >= AT_NS else p
        for p in wall.packets(duration_s)
    )
    return [e for e in (vio.process(p) for p in packets if p is not None) if e is not None]


def errors_m(wall: Wall, estimates: list[FrameEstimate]) -> np.ndarray:
    """Return the position errors of tracked frames, relative to the first, in the wall's frame (its yaw is zero)."""
    tracked = [e for e in estimates if e.pose is not None and e.health.verdict.tracked]
    p = np.array([e.pose.T_WI[:3, 3] for e in tracked])
    true = np.array([wall.pose(e.t_ns / 1e9)[:3, 3] for e in tracked])
    return np.linalg.norm((p - p[0]) - (true - true[0]), axis=1)


def added(count: int, accel: tuple[float, float, float], gyro: tuple[float, float, float] = (0.0, 0.0, 0.0)):
    def spoil(sample: ImuSample, k: int) -> ImuSample:
        if not 0 <= k < count:
            return sample
        return replace(sample, accel_I=sample.accel_I + accel, gyro_I=sample.gyro_I + gyro)

    return spoil


def stuck_for(count: int):
    held: list[ImuSample] = []

    def spoil(sample: ImuSample, k: int) -> ImuSample:
        if k == 0:
            held[:] = [sample]
        return replace(held[0], t_ns=sample.t_ns) if 0 <= k < count else sample

    return spoil


def dropped(sample: ImuSample, k: int) -> ImuSample | None:
    return None if 0 <= k < 20 else sample


FAULTS = {
    "spike": (added(1, (78.0, 0.0, 0.0)), "jump"),
    "three": (added(3, (-60.0, 0.0, 50.0)), "jump"),
    "knock": (added(3, (150.0, -80.0, 40.0)), "jump"),
    "gyro": (added(2, (0.0, 0.0, 0.0), (0.0, -12.0, 20.0)), "jump"),
    "stuck": (stuck_for(30), "repeat"),
    "dropped": (dropped, "IMU silent"),
}


@pytest.mark.parametrize("depth", [True, False], ids=["depth", "mono"])
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_samples_is_said_and_the_camera_corrects_it(fault: str, depth: bool) -> None:
    """Before, the images were rejected and not the IMU: up to metres off, with the verdict GOOD."""
    spoil, reasons = FAULTS[fault]
    wall = Wall(depth=depth)
    estimates = run(wall, spoil)
    said = [e for e in estimates if any(reasons in reason for reason in e.health.reasons)]
    assert said
    assert all(e.health.verdict is not Verdict.GOOD for e in said)
    assert not any("reset" in e.events for e in estimates)
    assert estimates[-1].health.verdict is Verdict.GOOD
    assert errors_m(wall, estimates).max() < (0.01 if depth else 0.05)


def samples(accel: np.ndarray, gyro: np.ndarray | None = None) -> list[ImuSample]:
    rates = np.zeros_like(accel) if gyro is None else gyro
    return [ImuSample(k * IMU_NS, rates[k], accel[k]) for k in range(len(accel))]


def test_vibration_and_a_step_are_no_lasting_doubt(rng: np.random.Generator) -> None:
    """Strong vibration is usual for its neighbours; a lasting change is believed after half of the neighbours."""
    detector = ImuFaultDetector()
    accel = GRAVITY + rng.normal(0, 3.0, (400, 3))
    assert sum(detector.check(s)[1] is not None for s in samples(accel)) == 0
    detector, step = ImuFaultDetector(), np.tile(GRAVITY, (60, 1)) + rng.normal(0, 0.03, (60, 3))
    step[30:, 0] += 20.0
    doubted = [k for k, s in enumerate(samples(step)) if detector.check(s)[1] is not None]
    assert doubted
    assert set(doubted) <= set(range(30, 36))


def test_a_spike_goes_on_with_its_neighbours(rng: np.random.Generator) -> None:
    detector, accel = ImuFaultDetector(), np.tile(GRAVITY, (20, 1)) + rng.normal(0, 0.03, (20, 3))
    accel[15] = [156.9, -156.9, 156.9]
    results = [detector.check(s) for s in samples(accel)]
    assert [k for k, (_, doubt) in enumerate(results) if doubt is not None] == [15]
    assert np.linalg.norm(results[15][0].accel_I - GRAVITY) < 0.2
    assert results[15][1].accel_m_s2 > 200.0


def test_a_stuck_sensor_is_doubted() -> None:
    detector = ImuFaultDetector()
    doubts = [detector.check(s)[1] for s in samples(np.tile(GRAVITY, (10, 1)))]
    assert [doubt is not None and doubt.stuck for doubt in doubts] == [k >= STUCK for k in range(10)]
