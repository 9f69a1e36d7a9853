"""Relocalisation after a blind time: in the keyframes, within their covariance and that of the fit, or not at all."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from snakeslam.estimation.base import FrameEstimate
from snakeslam.estimation.filter.state import CORE, P, State
from snakeslam.estimation.frontend.tracking import TrackedFeatures
from snakeslam.estimation.health_settings import HealthSettings
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.estimation.vio import relocalisation
from snakeslam.estimation.vio.odometry import VisualInertialOdometry
from snakeslam.estimation.vio.relocalisation import MAX_KEYFRAMES, Keyframes, MeasuredPosition
from snakeslam.geometry import numeric, so3
from snakeslam.messages import CameraFrame, Float, Packet, Verdict
from tests.estimation.wall import RIG, Wall

SETTINGS = EstimatorSettings()
COVERED_NS = (2_500_000_000, 4_000_000_000)
PUSH_M_S2 = 0.04
"""An error of the accelerometer in a blind time, forth and back: 22 mm after 1.5 s, without an error of velocity."""


def covered(duration_s: float, wall: Wall | None = None) -> Iterator[Packet]:
    """A hand-held camera, covered for 1.5 s, while the accelerometer has an error as well."""
    for packet in (wall or Wall()).packets(duration_s):
        if not COVERED_NS[0] < packet.t_ns <= COVERED_NS[1]:
            yield packet
        elif isinstance(packet, CameraFrame):
            level = np.uint8(packet.seq % 2)
            yield replace(packet, gray=np.full_like(packet.gray, level), depth_m=np.zeros_like(packet.depth_m))
        else:
            back = packet.t_ns > sum(COVERED_NS) // 2
            yield replace(packet, accel_I=packet.accel_I + np.array([0.0, -PUSH_M_S2 if back else PUSH_M_S2, 0.0]))


def run(packets: Iterator[Packet], settings: EstimatorSettings = SETTINGS) -> list[FrameEstimate]:
    vio = VisualInertialOdometry(settings, RIG, seed=0)
    return [e for e in map(vio.process, packets) if e is not None]


def error_m(estimates: list[FrameEstimate], t_s: float) -> float:
    """Distance from the truth relative to the first pose."""
    first = next(e.pose for e in estimates if e.pose is not None)
    now = min((e.pose for e in estimates if e.pose is not None), key=lambda pose: abs(pose.t_ns / 1e9 - t_s))
    wall = Wall()
    T0, T1 = wall.pose(first.t_ns / 1e9), wall.pose(now.t_ns / 1e9)
    moved = first.T_WI[:3, :3] @ T0[:3, :3].T @ (T1[:3, 3] - T0[:3, 3])
    return float(np.linalg.norm(now.T_WI[:3, 3] - first.T_WI[:3, 3] - moved))


def events(estimates: list[FrameEstimate]) -> list[str]:
    return [word for e in estimates for word in e.events]


def test_the_drift_of_a_blind_time_is_removed(monkeypatch: pytest.MonkeyPatch) -> None:
    found = run(covered(5.0))
    assert events(found) == ["initialised, stationary", "relocalised"]
    assert max(e.t_ns for e in found if "relocalised" in e.events) < COVERED_NS[1] + 1_000_000_000
    monkeypatch.setattr(Keyframes, "measure", lambda *_: None)
    alone = run(covered(5.0))
    assert error_m(found, 4.0) > 0.015
    assert error_m(found, 5.0) < 0.006 < 0.015 < error_m(alone, 5.0)


def test_after_a_reset_it_starts_at_its_position_in_the_keyframes() -> None:
    """After too long a blind time it starts anew, at the position measured in the keyframes."""
    patient = SETTINGS.model_copy(update={"health": HealthSettings(max_blind_s=0.5)})
    found = run(covered(6.0), patient)
    assert events(found)[:2] == ["initialised, stationary", "reset"]
    assert events(found)[-1] == "relocalised"
    assert error_m(found, 6.0) < 0.03


def test_another_scene_is_not_recognised() -> None:
    """After the blind time the camera is in front of another wall."""

    def swapped() -> Iterator[Packet]:
        for one, other in zip(covered(5.0), covered(5.0, Wall(seed=5)), strict=True):
            yield other if isinstance(one, CameraFrame) and one.t_ns > COVERED_NS[1] else one

    estimates = run(swapped())
    assert "relocalised" not in events(estimates)
    assert estimates[-1].health.verdict in (Verdict.GOOD, Verdict.DEGRADED)


def test_a_short_gap_is_bridged_without() -> None:
    """Blind for less than 0.3 s: the features of the window are enough."""
    gap = (2_500_000_000, 2_700_000_000)
    packets = (
        replace(p, gray=np.zeros_like(p.gray)) if isinstance(p, CameraFrame) and gap[0] < p.t_ns <= gap[1] else p
        for p in Wall().packets(4.0)
    )
    assert "relocalised" not in events(run(packets))


# -- Keyframes and rows -----------------------------------------------------------------------------------------------


def state_at(p_W: Float) -> State:
    return State(0, np.eye(3), p_W, np.zeros(3), np.zeros(3), np.zeros(3), np.eye(CORE) * 1e-4)


def features(motion_blur_rad: float = 0.0) -> TrackedFeatures:
    none = np.empty((0, 2), np.float32), np.empty(0, np.int64)
    return TrackedFeatures(*none, np.empty((0, 2)), np.empty(0), *none, None, False, 0, motion_blur_rad)


def first_frame(wall: Wall) -> CameraFrame:
    return next(p for p in wall.packets(0.0) if isinstance(p, CameraFrame))


def test_only_sharp_frames_with_depth_and_a_new_view_become_keyframes() -> None:
    frame, kept = first_frame(Wall()), Keyframes(SETTINGS, RIG.cam0, 0)
    away = np.array([1.01 * relocalisation.APART_M, 0.0, 0.0])
    for k in range(2 * MAX_KEYFRAMES):
        kept.add(frame, features(), state_at(k * away))
        kept.add(frame, features(), state_at((k + 0.5) * away))
        assert len(kept._present) == min(k + 1, MAX_KEYFRAMES)
    kept.begin(1)
    kept.add(first_frame(Wall(depth=False)), features(), state_at(away))
    kept.add(frame, features(motion_blur_rad=0.1), state_at(away))
    assert not kept._present


def test_a_position_is_measured_to_the_millimetre_within_its_covariance() -> None:
    """Frames of a moving head, measured in the first one, predicted 10 mm beside their true positions."""
    wall, kept = Wall(), Keyframes(SETTINGS, RIG.cam0, 0)
    frames = [p for p in wall.packets(3.0) if isinstance(p, CameraFrame)]
    at = state_at(wall.pose(0.0)[:3, 3])
    at.cov[P, P] = np.zeros((3, 3))
    kept.add(frames[0], features(), at)
    beside, nees, errors = np.eye(4), [], []
    beside[:3, 3] = 0.006
    for frame in frames[20:]:
        T_WI = wall.pose(frame.t_ns / 1e9)
        measured = kept.measure(frame, beside @ T_WI)
        assert measured is not None
        e = measured.T_WI[:3, 3] - T_WI[:3, 3]
        nees.append(e @ np.linalg.solve(measured.cov_p, e))
        errors.append(np.linalg.norm(e))
    assert np.mean(errors) < 0.003
    assert np.mean(nees) < 4.0
    assert np.sqrt(np.trace(measured.cov_p)) < 0.01


def test_jacobian_of_the_rows(rng: np.random.Generator) -> None:
    T_WI = np.eye(4)
    T_WI[:3, :3], T_WI[:3, 3] = so3.exp(rng.normal(size=3)), rng.normal(size=3)
    rows = MeasuredPosition(T_WI, np.diag([1e-4, 2e-4, 3e-4]), np.zeros((3, 3)))

    def residual(d: Float) -> Float:
        moved = state_at(np.ones(3))
        moved.plus(d)
        return rows.residual(moved)

    at = state_at(np.ones(3))
    np.testing.assert_allclose(-rows.jacobian(at), numeric.jacobian(residual, at.size), atol=1e-4)
