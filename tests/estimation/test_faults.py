"""The fault table: each fault of the inputs is reported, survived, and passes."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from snakeslam.estimation.base import FrameEstimate
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.estimation.vio.odometry import VisualInertialOdometry
from snakeslam.messages import CameraFrame, ImuSample, Packet, Verdict
from tests.estimation.wall import RIG, Wall

FROM_NS, TO_NS = 2_000_000_000, 2_500_000_000


def during(packet: Packet) -> bool:
    return FROM_NS < packet.t_ns <= TO_NS


def run(
    spoil: Callable[[Packet], Packet | None],
    duration_s: float = 4.0,
    lost: Callable[[Packet], bool] = lambda _: False,
) -> list[FrameEstimate]:
    def packets() -> Iterator[Packet]:
        for packet in Wall().packets(duration_s):
            if lost(packet):
                continue
            spoiled = spoil(packet) if during(packet) else packet
            if spoiled is not None:
                yield spoiled

    vio = VisualInertialOdometry(EstimatorSettings(), RIG, seed=0)
    return [e for e in map(vio.process, packets()) if e is not None]


def nan_imu(packet: Packet) -> Packet:
    return replace(packet, gyro_I=np.full(3, np.nan)) if isinstance(packet, ImuSample) else packet


def spike_imu(packet: Packet) -> Packet:
    return replace(packet, accel_I=np.array([0.0, 1e6, 0.0])) if isinstance(packet, ImuSample) else packet


def no_imu(packet: Packet) -> Packet | None:
    return None if isinstance(packet, ImuSample) else packet


def black(packet: Packet) -> Packet:
    if not isinstance(packet, CameraFrame):
        return packet
    # The noise of a covered sensor: no two images are the same.
    level = np.uint8(packet.seq % 2)
    return replace(packet, gray=np.full_like(packet.gray, level), depth_m=np.zeros_like(packet.depth_m))


FAULTS = [
    (nan_imu, "not numbers", Verdict.DEGRADED),
    (spike_imu, "not possible", Verdict.DEGRADED),
    (no_imu, "IMU silent", Verdict.DEGRADED),
    (black, "few features", Verdict.BLIND),
]


@pytest.mark.parametrize(("spoil", "words", "verdict"), FAULTS, ids=["nan", "spike", "gap", "black"])
def test_a_fault_is_reported_and_passes(spoil: Callable[[Packet], Packet | None], words: str, verdict: Verdict) -> None:
    estimates = run(spoil)
    hit = [e for e in estimates if FROM_NS + 100_000_000 < e.t_ns <= TO_NS]
    assert hit
    assert all(e.health.verdict is verdict for e in hit), [e.health for e in hit]
    assert all(any(words in reason for reason in e.health.reasons) for e in hit)
    after = [e for e in estimates if e.t_ns > 3_500_000_000]
    assert all(e.health.verdict is Verdict.GOOD for e in after), [e.health for e in after]
    assert not any("reset" in e.events for e in estimates)
    last = after[-1]
    assert last.pose is not None
    first = next(e for e in estimates if e.pose is not None)
    went = np.linalg.norm(last.pose.T_WI[:3, 3] - first.pose.T_WI[:3, 3])
    true = np.linalg.norm(Wall().pose(last.t_ns / 1e9)[:3, 3] - Wall().pose(first.t_ns / 1e9)[:3, 3])
    assert abs(went - true) < 0.05


def test_a_frozen_image_is_reported() -> None:
    held: list[CameraFrame] = []

    def freeze(packet: Packet) -> Packet:
        if not isinstance(packet, CameraFrame):
            return packet
        held.append(packet)
        return replace(packet, gray=held[0].gray, depth_m=held[0].depth_m)

    hit = [e for e in run(freeze) if FROM_NS + 100_000_000 < e.t_ns <= TO_NS]
    assert all(e.health.verdict is Verdict.BLIND and "does not change" in e.health.reasons[0] for e in hit)


def test_a_frozen_image_of_a_stationary_head_does_not_drift() -> None:
    """An image that does not change while the IMU is stationary too is reported, and the pose does not drift."""
    first: list[CameraFrame] = []

    def freeze(packet: Packet) -> Packet:
        if not isinstance(packet, CameraFrame):
            return packet
        first.append(packet)
        return replace(packet, gray=first[0].gray, depth_m=first[0].depth_m)

    vio = VisualInertialOdometry(EstimatorSettings(), RIG, seed=0)
    estimates = [e for e in (vio.process(freeze(p)) for p in Wall(stationary=True).packets(5.0)) if e is not None]
    assert not any("reset" in e.events for e in estimates)
    assert all("does not change" in e.health.reasons[0] for e in estimates[-10:])
    poses = [e.pose for e in estimates if e.pose is not None]
    assert np.linalg.norm(poses[-1].T_WI[:3, 3] - poses[0].T_WI[:3, 3]) < 0.005


def test_a_second_without_imu_is_reported_and_passes() -> None:
    estimates = run(lambda p: p, 4.0, lambda p: isinstance(p, ImuSample) and 2_000_000_000 < p.t_ns <= 3_000_000_000)
    hit = [e for e in estimates if 2_100_000_000 < e.t_ns <= 3_000_000_000]
    assert all(any("IMU silent" in reason for reason in e.health.reasons) for e in hit)
    assert estimates[-1].health.verdict is Verdict.GOOD
    assert not any("reset" in e.events for e in estimates)


def test_covered_camera_is_bridged_without_a_reset() -> None:
    """Two seconds without a camera while moving: dead reckoning by the IMU, then vision continues from there."""
    dark = 2_000_000_000, 4_000_000_000
    wall = Wall()
    vio = VisualInertialOdometry(EstimatorSettings(), RIG, seed=0)
    packets = (black(p) if dark[0] < p.t_ns <= dark[1] else p for p in wall.packets(5.0))
    estimates = [e for e in map(vio.process, packets) if e is not None]
    hit = [e for e in estimates if dark[0] + 100_000_000 < e.t_ns <= dark[1]]
    assert all(e.health.verdict is Verdict.BLIND and e.pose is not None for e in hit)
    assert not any("reset" in e.events for e in estimates)
    assert all(e.health.verdict is Verdict.GOOD for e in estimates[-10:])
    by_t = {e.t_ns: e.pose.T_WI[:3, 3] for e in estimates if e.pose is not None}
    went = by_t[4_200_000_000] - by_t[2_000_000_000]
    true = wall.pose(4.2)[:3, 3] - wall.pose(2.0)[:3, 3]
    sigma = np.sqrt(np.trace(hit[-1].pose.cov[3:6, 3:6]))
    assert np.linalg.norm(went - true) < min(0.1, 3.5 * sigma)


@pytest.mark.parametrize("jump_s", [20, -20])
def test_one_wrong_stamp_is_left_out(jump_s: int) -> None:
    def jump(packet: Packet) -> Packet:
        wrong = isinstance(packet, CameraFrame) and packet.seq == 45
        return replace(packet, t_ns=max(1, packet.t_ns + jump_s * 1_000_000_000)) if wrong else packet

    estimates = run(jump)
    wrong = next(e for e in estimates if e.seq == 45)
    assert wrong.health.verdict is Verdict.BLIND
    assert any("time" in reason for reason in wrong.health.reasons)
    assert all(e.health.verdict is Verdict.GOOD for e in estimates if e.seq > 45)


@pytest.mark.parametrize("jump_s", [20, -1])
def test_a_clock_set_anew_ends_in_a_new_start(jump_s: int) -> None:
    """All stamps jump permanently: it is reported, followed by a reset and a new start."""

    def shifted(packet: Packet) -> Packet:
        return replace(packet, t_ns=packet.t_ns + jump_s * 1_000_000_000)

    vio = VisualInertialOdometry(EstimatorSettings(), RIG, seed=0)
    packets = (shifted(p) if p.t_ns > FROM_NS else p for p in Wall(stationary=True).packets(4.0))
    estimates = [e for e in map(vio.process, packets) if e is not None]
    assert any("reset" in e.events for e in estimates)
    assert estimates[-1].health.verdict is Verdict.GOOD


def test_depth_that_is_not_a_number_is_unknown() -> None:
    def spoil(packet: Packet) -> Packet:
        if not isinstance(packet, CameraFrame):
            return packet
        depth = packet.depth_m.copy()
        depth[::3] = np.nan
        depth[1::3] = np.inf
        return replace(packet, depth_m=depth)

    estimates = run(spoil)
    assert all(e.pose is None or np.all(np.isfinite(e.pose.T_WI)) for e in estimates)
    assert estimates[-1].health.verdict is Verdict.GOOD


def test_a_clock_that_goes_back_is_reported() -> None:
    def back(packet: Packet) -> Packet:
        return replace(packet, t_ns=1_000_000_000) if isinstance(packet, CameraFrame) else packet

    hit = [e for e in run(back) if e.t_ns == 1_000_000_000 and e.seq > 30]
    assert hit
    assert all("time goes back" in e.health.reasons[0] for e in hit)


def test_long_blindness_ends_in_a_reset_and_a_new_start() -> None:
    def cover(packet: Packet) -> Packet:
        return black(packet) if FROM_NS < packet.t_ns <= FROM_NS + 3_500_000_000 else packet

    vio = VisualInertialOdometry(EstimatorSettings(), RIG, seed=0)
    estimates = [e for e in (vio.process(cover(p)) for p in Wall(stationary=True).packets(7.0)) if e is not None]
    assert any("reset" in e.events for e in estimates)
    assert estimates[-1].health.verdict is Verdict.GOOD
