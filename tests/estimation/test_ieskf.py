"""The iterated update, Eq. (41), against dense formulas and against its own optimum."""

import numpy as np
import pytest

from snakeslam.estimation.filter.ieskf import update
from snakeslam.estimation.filter.state import CLONE, CORE, LANDMARK, State
from snakeslam.estimation.measurements.camera import (
    Observations,
    Poses,
    ReprojectionModel,
    jacobians,
    points_in_camera,
    predict,
    residuals,
)
from snakeslam.estimation.measurements.landmarks import LandmarkObservations
from snakeslam.estimation.measurements.projected_tracks import ProjectedTracks, promote
from snakeslam.estimation.measurements.settings import NoiseSettings
from snakeslam.geometry import numeric, so3

R_IC = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
ROWS = ReprojectionModel(R_IC, np.array([0.05, 0.0, 0.0]), 1 / 400, NoiseSettings())
POINTS_W = np.array([[2.0, 0.5, 0.3], [3.0, -0.8, 0.2], [2.5, 0.1, -0.4], [1.5, -0.3, 0.1], [2.2, 0.7, -0.2]])


def state_with_landmarks(scale: float) -> State:
    """A state of one clone that knows the points to 5 cm times ``scale`` and its pose to 1 cm and 0.6 deg times it."""
    cov = np.diag(np.repeat([1e-4, 1e-4, 1e-2, 1e-6, 1e-4], 3)) * scale**2
    state = State(0, np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), cov)
    state.add_clone()
    count = len(POINTS_W)
    noise = np.tile(np.eye(3) * (0.05 * scale) ** 2, (count, 1, 1))
    state.add_landmarks(np.arange(count), POINTS_W, np.zeros((count, LANDMARK, state.size)), noise)
    return state


def sightings_from(R_WI: np.ndarray, p_WI: np.ndarray) -> LandmarkObservations:
    """What is seen of the points from another pose than the state believes."""
    p_C = points_in_camera(POINTS_W, Poses(R_WI[None], p_WI[None]), ROWS)
    observed = Observations.weighted(predict(p_C), np.ones((len(POINTS_W), 1), bool), ROWS)
    return LandmarkObservations(np.arange(len(POINTS_W)), observed, ROWS)


def whitened(state: State, observations: LandmarkObservations) -> np.ndarray:
    """Return z - h of the whole state, all rows in one vector."""
    p_C = points_in_camera(state.landmarks.p_W, Poses.of(state), ROWS)
    return ((observations.observed.xyz - predict(p_C)) * ROWS.weights(observations.observed.xyz)).ravel()


def test_one_iteration_is_the_kalman_update() -> None:
    """Eq. (41): dx = P H^T (H P H^T + I)^-1 r and P <- (I - K H) P, with H by finite differences."""
    observations = sightings_from(so3.exp(np.array([0.001, -0.001, 0.002])), np.array([0.002, -0.001, 0.001]))
    state = state_with_landmarks(0.2)
    r = whitened(state, observations)
    assert np.abs(r.reshape(-1, 3)).max() < 1.5, "the robust weights must be one here"

    def rest(d: np.ndarray) -> np.ndarray:
        other = state_with_landmarks(0.2)
        other.plus(d)
        return -whitened(other, observations)

    H = numeric.jacobian(rest, state.size)
    P = state.cov.copy()
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + np.eye(len(r)))
    expected = state_with_landmarks(0.2)
    expected.plus(K @ r)
    update(state, [observations], 1)
    assert state.clones.p_WI[0] == pytest.approx(expected.clones.p_WI[0], abs=1e-8)
    assert state.R_WI == pytest.approx(expected.R_WI, abs=1e-8)
    assert state.v_W == pytest.approx(expected.v_W, abs=1e-8)
    assert state.cov == pytest.approx((np.eye(state.size) - K @ H) @ P, abs=1e-9)


def test_iterating_fits_better_than_one_step() -> None:
    """Eq. (41) with its iteration: from a poor start the rows are met better, and never worse."""
    observations = sightings_from(so3.exp(np.array([0.02, -0.05, 0.12])), np.array([0.15, -0.1, 0.05]))
    once, often = state_with_landmarks(10.0), state_with_landmarks(10.0)
    before = np.sum(whitened(once, observations) ** 2)
    update(once, [observations], 1)
    rounds = update(often, [observations], 8)
    assert rounds > 1
    after_one, after_all = (np.sum(whitened(s, observations) ** 2) for s in (once, often))
    assert after_all < 0.2 * after_one < before
    assert after_all < 2.0


def test_the_clone_and_the_imu_stay_one_pose() -> None:
    """A clone of the present pose is the same unknown: the update moves both alike."""
    state = state_with_landmarks(1.0)
    update(state, [sightings_from(so3.exp(np.array([0.0, 0.0, 0.01])), np.zeros(3))], 3)
    assert state.clones.p_WI[0] == pytest.approx(state.p_WI, abs=1e-9)
    assert state.clones.R_WI[0] == pytest.approx(state.R_WI, abs=1e-9)
    assert np.linalg.norm(so3.log(state.R_WI)) > 1e-3
    assert state.size == CORE + CLONE + LANDMARK * len(POINTS_W)


def test_nothing_seen_changes_nothing() -> None:
    state = state_with_landmarks(1.0)
    cov = state.cov.copy()
    assert update(state, [], 3) == 0
    assert np.array_equal(state.cov, cov)


def window_seeing_points(rng: np.random.Generator) -> tuple[State, ProjectedTracks]:
    """Three poses a step apart, each uncertain, and noisy observations of the points from all of them."""
    state = State(0, np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.eye(CORE) * 1e-4)
    for k in range(3):
        state.t_ns, state.p_WI = k, np.array([0.0, 0.1 * k, 0.02 * k])
        state.inflate(slice(0, 6), 1e-4)
        state.add_clone()
    state.clones.p_fej = state.clones.p_WI
    xyz = predict(points_in_camera(POINTS_W, Poses.of(state), ROWS))
    xyz[..., :2] += rng.normal(0, 0.3 / 400, (*xyz.shape[:2], 2))
    observed = Observations.weighted(xyz, np.ones(xyz.shape[:2], bool), ROWS)
    return state, ProjectedTracks.of(np.arange(len(POINTS_W)), observed, state, ROWS)


def test_projected_features_are_points_with_a_flat_prior(rng: np.random.Generator) -> None:
    """L = sum Hx^T Hx - Hx^T Hf (Hf^T Hf)^-1 Hf^T Hx: as a joint update with points of which nothing is known."""
    state, features = window_seeing_points(rng)
    joint, seen = window_seeing_points(np.random.default_rng(7))
    count = len(POINTS_W)
    flat = np.tile(np.eye(3) * 1e8, (count, 1, 1))
    joint.add_landmarks(np.arange(count), seen.points_W, np.zeros((count, LANDMARK, joint.size)), flat)
    r, Hx, Hf = rows_of(joint, seen)
    H = np.zeros((r.size, joint.size))
    for m in range(count):
        for n in range(3):
            at = slice(9 * m + 3 * n, 9 * m + 3 * n + 3)
            H[at, joint.clone_slice(n)] = Hx[m, n]
            H[at, joint.window.stop + 3 * m : joint.window.stop + 3 * m + 3] = Hf[m, n]
    expected = np.linalg.inv(np.linalg.inv(joint.cov + 1e-12 * np.eye(joint.size)) + H.T @ H)
    update(state, [features], 1)
    assert state.cov == pytest.approx(expected[: state.size, : state.size], abs=1e-7)
    promote(state, features, np.ones(count, bool))
    assert state.cov == pytest.approx(expected, abs=1e-6)


def rows_of(state: State, features: ProjectedTracks) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    r = residuals(features.points_W, Poses.of(state), features.observed, ROWS)
    return r, *jacobians(features.points_W, Poses.first_estimates_of(state), features.observed, ROWS)


def test_a_new_origin_is_exact_and_keeps_what_is_relative(rng: np.random.Generator) -> None:
    """Errors relative to the present pose stay as they are; its own position and yaw have none."""
    state, _ = window_seeing_points(rng)
    state.R_WI = so3.exp(np.array([0.1, -0.2, 0.7]))
    relative = np.zeros((3, state.size))
    relative[:, 3:6], relative[:, state.window.stop - 3 :] = -np.eye(3), np.eye(3)
    relative -= np.outer(
        np.cross([0, 0, 1], state.clones.p_WI[-1] - state.p_WI), np.r_[state.R_WI[2], np.zeros(state.size - 3)]
    )
    before = relative @ state.cov @ relative.T
    R = so3.from_yaw(0.3 - so3.yaw(state.R_WI))
    state.make_origin(0.3, np.array([1.0, 2.0, 3.0]))
    assert state.p_WI == pytest.approx([1.0, 2.0, 3.0])
    assert so3.yaw(state.R_WI) == pytest.approx(0.3)
    assert state.cov[3:6, 3:6] == pytest.approx(np.zeros((3, 3)), abs=1e-15)
    assert state.R_WI[2] @ state.cov[:3, :3] @ state.R_WI[2] == pytest.approx(0.0, abs=1e-15)
    last = slice(state.window.stop - 3, state.window.stop)
    assert R.T @ state.cov[last, last] @ R == pytest.approx(before, abs=1e-12)
