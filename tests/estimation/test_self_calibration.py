"""The camera's time offset and extrinsics as states: estimated in motion, unchanged without it."""

import numpy as np
import pytest

from bench.simulated import P_IC, R_IC, RIG, SETTINGS, SimulatedFrontend, SwingingHead
from snakeslam.calibration import SensorRig
from snakeslam.estimation.filter.extrinsics import Extrinsics, initial_extrinsics, readout_flow
from snakeslam.estimation.filter.ieskf import Information
from snakeslam.estimation.filter.settings import CalibrationSettings
from snakeslam.estimation.filter.state import CORE, State
from snakeslam.estimation.measurements.camera import (
    Observations,
    Poses,
    ReprojectionModel,
    all_jacobians,
    points_in_camera,
    predict,
    residuals,
)
from snakeslam.estimation.measurements.landmarks import LandmarkObservations
from snakeslam.estimation.measurements.projected_tracks import ProjectedTracks
from snakeslam.estimation.measurements.settings import NoiseSettings
from snakeslam.estimation.vio.odometry import VisualInertialOdometry
from snakeslam.geometry import numeric, se3, so3
from snakeslam.messages import Float

ROWS = ReprojectionModel(R_IC, P_IC, 1 / 400, NoiseSettings())
WIDE = CalibrationSettings(time_offset_sigma_ms=10.0, rotation_sigma_deg=2.0, position_sigma_mm=10.0)
POINTS_W = np.array([[2.0, 0.5, 0.3], [3.0, -0.8, 0.2], [2.5, 0.1, -0.4], [1.5, -0.3, 0.1]])


def rig(R_IC: Float, p_IC: Float) -> SensorRig:
    """The bench's sensors with other extrinsics in their calibration."""
    T_CI = se3.inv(se3.from_rt(R_IC, p_IC))
    return RIG.model_copy(update={"cam0": RIG.cam0.model_copy(update={"T_cam_imu": tuple(map(tuple, T_CI.tolist()))})})


def calibrated(
    head: SwingingHead, believed: SensorRig, settings: CalibrationSettings = WIDE, readout_s: float = 0.0
) -> tuple[Extrinsics, Float]:
    """Return the extrinsics that the filter estimates and one sigma of their error."""
    frontend = SimulatedFrontend(head, SETTINGS.noise, head.late_ns, readout_s)
    vio = VisualInertialOdometry(SETTINGS.model_copy(update={"calibration": settings}), believed, head.seed, frontend)
    for packet in head.packets():
        vio.process(packet)
    assert vio.extrinsics is not None
    extrinsics, cov = vio.extrinsics
    return extrinsics, np.sqrt(np.diag(cov))


def window() -> State:
    """Three poses of a camera with estimated extrinsics, and landmarks."""
    state = State(0, np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.eye(CORE) * 1e-4)
    freed = initial_extrinsics(RIG.cam0, WIDE)
    assert freed is not None
    state.add_extrinsics(*freed)
    for k in range(3):
        state.t_ns, state.p_WI = k, np.array([0.0, 0.1 * k, 0.02 * k])
        state.R_WI = so3.exp(np.array([0.1 * k, 0.05 * k, -0.1 * k]))
        state.inflate(slice(0, 6), 1e-4)
        state.add_clone(np.array([0.3, -0.2, 0.5, 0.2, 0.1, -0.1]))
    state.clones.p_fej, state.clones.R_fej = state.clones.p_WI, state.clones.R_WI
    count = len(POINTS_W)
    state.add_landmarks(
        np.arange(count), POINTS_W, np.zeros((count, 3, state.size)), np.tile(np.eye(3) * 1e8, (count, 1, 1))
    )
    return state


def observed_from(state: State, rng: np.random.Generator) -> Observations:
    """Return noisy observations of the points from the window."""
    xyz = predict(points_in_camera(POINTS_W, Poses.of(state), ROWS))
    return Observations.weighted(xyz + rng.normal(0, 0.3 / 400, xyz.shape), np.ones(xyz.shape[:2], bool), ROWS)


def test_rows_by_the_extrinsics(rng: np.random.Generator) -> None:
    """p_C = R_CI (p_I - p_IC): [p_C]x by the orientation, -R_CI by the position."""
    R, p = so3.exp(rng.normal(0, 0.3, 3)), rng.normal(0, 0.3, 3)
    extrinsics = Extrinsics(R_IC, P_IC, estimates_pose=True)
    observed = Observations.weighted(np.array([[[0.1, 0.05, 2.5]]]), np.ones((1, 1), bool), ROWS)

    def rest(d: Float) -> Float:
        return -residuals(POINTS_W[:1], Poses(R[None], p[None], extrinsics.plus(d)), observed, ROWS)

    _, _, Hc = all_jacobians(POINTS_W[:1], Poses(R[None], p[None], extrinsics), observed, ROWS)
    assert Hc[0, 0] == pytest.approx(numeric.jacobian(rest, 6), rel=1e-5, abs=1e-4)


def test_an_error_of_the_time_moves_the_clone() -> None:
    """(theta + w t_d, p + v t_d) [Li14]: the clone's error is that of the pose t_d later."""
    state = State(0, np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.eye(CORE) * 1e-4)
    state.add_extrinsics(Extrinsics(R_IC, P_IC, estimates_time=True), np.array([1e-4]))
    before, r_pose_t = state.cov.copy(), np.array([0.3, -0.2, 0.5, 0.2, 0.1, -0.1])
    state.add_clone(r_pose_t)
    J = np.vstack([np.eye(CORE + 1), np.hstack([np.eye(6), np.zeros((6, CORE - 6)), r_pose_t[:, None]])])
    assert state.cov == pytest.approx(J @ before @ J.T, abs=1e-15)


def test_projected_tracks_and_landmarks_agree_with_dense_rows(rng: np.random.Generator) -> None:
    """L and H^T r of both kinds of rows against a dense, numeric Jacobian; the innovation against S = H P H^T + I."""
    state = window()
    observed = observed_from(state, rng)
    features = ProjectedTracks(np.arange(len(POINTS_W)), observed, POINTS_W, ROWS)

    def rest(d: Float) -> Float:
        moved = window()
        moved.plus(d)
        return -residuals(moved.landmarks.p_W, Poses.of(moved), observed, ROWS).ravel()

    H, r = numeric.jacobian(rest, state.size), -rest(np.zeros(state.size))
    points = np.arange(state.window.stop, state.size)
    Hx, Hf = H[:, state.camera_poses_part], H[:, points]
    assert np.linalg.norm(H[:, state.extrinsics_part]) > 0.0
    away = np.eye(len(r)) - Hf @ np.linalg.inv(Hf.T @ Hf) @ Hf.T
    total = Information.none(state.size)
    innovation = features.innovation(state)
    features.linearise(state, total)
    scale = np.abs(Hx.T @ Hx).max()
    assert total.L[state.camera_poses_part, state.camera_poses_part] == pytest.approx(
        Hx.T @ away @ Hx, abs=1e-6 * scale
    )
    assert total.gradient[state.camera_poses_part] == pytest.approx(Hx.T @ away @ r, rel=1e-4, abs=1e-3)
    own = slice(0, 9)
    S = (
        Hx[own] @ state.cov[state.camera_poses_part, state.camera_poses_part] @ Hx[own].T
        + 1e4 * Hf[own, :3] @ Hf[own, :3].T
        + np.eye(9)
    )
    assert innovation.distance[0] == pytest.approx(r[own] @ np.linalg.solve(S, r[own]), rel=1e-4)

    newest = Observations(observed.xyz[:, -1:], observed.seen[:, -1:], observed.weight[:, -1:])
    seen = Information.none(state.size)
    LandmarkObservations(np.arange(len(POINTS_W)), newest, ROWS).linearise(state, seen)
    rows = np.arange(len(r)).reshape(-1, 3, 3)[:, -1].ravel()
    assert seen.L == pytest.approx(H[rows].T @ H[rows], abs=1e-6 * scale)
    assert seen.gradient == pytest.approx(H[rows].T @ r[rows], rel=1e-4, abs=1e-3)


def test_wrong_time_offset_and_extrinsics_are_estimated() -> None:
    """Frames stamped 10 ms late, the camera 2 deg and 1 cm from where the calibration puts it."""
    rotation, shift = np.deg2rad(2.0) * np.array([0.6, -0.64, 0.48]), 0.01 * np.array([0.48, 0.6, -0.64])
    head = SwingingHead(seed=1, duration_s=8.0, tracks=80, late_ns=10_000_000)
    extrinsics, sigma = calibrated(head, rig(R_IC @ so3.exp(rotation), P_IC + shift))
    off_s = extrinsics.offset_s + 0.010
    off_rad = so3.log(R_IC.T @ extrinsics.R_IC)
    off_m = extrinsics.p_IC - P_IC
    assert abs(off_s) < 5e-4
    assert np.rad2deg(np.linalg.norm(off_rad)) < 0.2
    assert np.linalg.norm(off_m) < 0.008
    assert np.all(np.abs(np.concatenate([[off_s], off_rad, off_m])) < 4.0 * sigma)


@pytest.mark.parametrize("late_ms", [0, 3, 6])
def test_a_camera_whose_clock_is_off_needs_no_setting(late_ms: int) -> None:
    head = SwingingHead(seed=2, duration_s=6.0, tracks=80, late_ns=late_ms * 1_000_000)
    extrinsics, sigma = calibrated(head, RIG, CalibrationSettings())
    assert len(sigma) == 1
    assert extrinsics.offset_s == pytest.approx(-late_ms * 1e-3, abs=5e-4)


def with_shutter(shutter: str) -> SensorRig:
    return RIG.model_copy(update={"cam0": RIG.cam0.model_copy(update={"shutter": shutter})})


@pytest.mark.parametrize("readout_ms", [0, 25, -25])
def test_the_readout_of_a_rolling_shutter_is_found(readout_ms: int) -> None:
    head = SwingingHead(seed=3, duration_s=8.0, tracks=80)
    extrinsics, sigma = calibrated(head, with_shutter("unknown"), CalibrationSettings(), readout_ms * 1e-3)
    assert len(sigma) == 2
    assert extrinsics.readout_s == pytest.approx(readout_ms * 1e-3, abs=1.5e-3)
    assert sigma[1] < 1e-3


def test_rows_move_by_the_readout_as_the_camera_rotates(rng: np.random.Generator) -> None:
    """d(x, y)/dt_r against a rotation of the camera at w (v / H - 1/2) for a short time."""
    xy, height, w_C, short_s = rng.normal(size=(5, 2)), rng.uniform(size=5), np.array([0.4, -0.7, 1.1]), 1e-6
    rotated = np.column_stack([xy, np.ones(5)])
    for n in range(5):
        rotated[n] = so3.exp(w_C * (height[n] - 0.5) * short_s).T @ rotated[n]
    moved = (rotated[:, :2] / rotated[:, 2:] - xy) / short_s
    assert readout_flow(xy, height, w_C) == pytest.approx(moved, abs=1e-4)


def test_the_calibration_has_precedence_over_the_settings() -> None:
    known = RIG.cam0.model_copy(update={"timeshift_sigma_s": 0.0})
    assert initial_extrinsics(known, CalibrationSettings()) is None
    loose = RIG.cam0.model_copy(update={"timeshift_sigma_s": 0.02, "shutter": "rolling"})
    freed = initial_extrinsics(loose, CalibrationSettings())
    assert freed is not None
    assert freed[1] == pytest.approx([0.02**2, 0.015**2])


class Resting(SwingingHead):
    """A head that never moves."""

    def pose(self, t_s: Float) -> tuple[Float, Float]:
        return np.tile(np.eye(3), (len(t_s), 1, 1)), np.zeros((len(t_s), 3))


def test_a_stationary_head_does_not_observe_its_camera() -> None:
    extrinsics, sigma = calibrated(Resting(seed=0, duration_s=8.0, tracks=60), RIG)
    assert extrinsics.offset_s == 0.0
    assert sigma[0] == pytest.approx(0.010)
    assert np.all(sigma[1:4] > 0.85 * np.deg2rad(2.0))
    assert np.all(sigma[4:] > 0.98 * 0.010)
    assert np.all(np.abs(so3.log(R_IC.T @ extrinsics.R_IC)) < np.deg2rad(1.0))
    assert np.linalg.norm(extrinsics.p_IC - P_IC) < 0.003


def test_without_a_sigma_nothing_is_estimated() -> None:
    rotation = np.deg2rad(1.0) * np.array([0.0, 1.0, 0.0])
    time_alone = CalibrationSettings(time_offset_sigma_ms=5.0)
    head = SwingingHead(seed=1, duration_s=3.0, tracks=60)
    believed = rig(R_IC @ so3.exp(rotation), P_IC)
    extrinsics, sigma = calibrated(head, believed, time_alone)
    assert np.array_equal(extrinsics.p_IC, believed.cam0.T_IC[:3, 3])
    assert np.array_equal(extrinsics.R_IC, believed.cam0.T_IC[:3, :3])
    assert len(sigma) == 1
    assert initial_extrinsics(RIG.cam0, CalibrationSettings(time_offset_sigma_ms=0.0)) is None
