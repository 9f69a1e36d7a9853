"""The iterated update, Eq. (41), against dense formulas and against its own optimum."""

import numpy as np
import pytest

from snakeslam.estimation.ieskf import Features, LandmarkSightings, update
from snakeslam.estimation.measurements import CameraRows, Observations, Poses, points_in_camera, predict
from snakeslam.estimation.settings import NoiseSettings
from snakeslam.estimation.state import CLONE, CORE, LANDMARK, Landmark, State
from snakeslam.geometry import numeric, so3

R_IC = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
ROWS = CameraRows(R_IC, np.array([0.05, 0.0, 0.0]), 1 / 400, NoiseSettings())
POINTS_W = np.array([[2.0, 0.5, 0.3], [3.0, -0.8, 0.2], [2.5, 0.1, -0.4], [1.5, -0.3, 0.1], [2.2, 0.7, -0.2]])


def state_with_landmarks(scale: float) -> State:
    """A state of one clone that knows the points to 5 cm times ``scale`` and its pose to 1 cm and 0.6 deg times it."""
    cov = np.diag(np.repeat([1e-4, 1e-4, 1e-2, 1e-6, 1e-4], 3)) * scale**2
    state = State(0, np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), cov)
    state.add_clone()
    for k, p_W in enumerate(POINTS_W):
        state.add_landmark(Landmark(k, p_W, p_W), np.zeros((LANDMARK, state.size)), np.eye(3) * (0.05 * scale) ** 2)
    return state


def sightings_from(R_WI: np.ndarray, p_WI: np.ndarray) -> LandmarkSightings:
    """What is seen of the points from another pose than the state believes."""
    _, p_C = points_in_camera(POINTS_W, Poses(R_WI[None], p_WI[None]), ROWS)
    observed = Observations.weighed(predict(p_C), np.ones((len(POINTS_W), 1), bool), ROWS)
    return LandmarkSightings(np.arange(len(POINTS_W)), observed)


def no_features() -> Features:
    return Features([], Observations.of([], [0], ROWS), np.empty((0, 3)))


def whitened(state: State, sightings: LandmarkSightings) -> np.ndarray:
    """Return z - h of the whole state, all rows in one vector."""
    pose = Poses(state.clones[0].R_WI[None], state.clones[0].p_WI[None])
    _, p_C = points_in_camera(np.array([m.p_W for m in state.landmarks]), pose, ROWS)
    return ((sightings.observed.xyz - predict(p_C)) * ROWS.weights(sightings.observed.xyz)).ravel()


def test_one_iteration_is_the_kalman_update() -> None:
    """Eq. (41): dx = P H^T (H P H^T + I)^-1 r and P <- (I - K H) P, with H by finite differences."""
    sightings = sightings_from(so3.exp(np.array([0.001, -0.001, 0.002])), np.array([0.002, -0.001, 0.001]))
    state = state_with_landmarks(0.2)
    r = whitened(state, sightings)
    assert np.abs(r.reshape(-1, 3)).max() < 1.5, "the robust weights must be one here"

    def rest(d: np.ndarray) -> np.ndarray:
        other = state_with_landmarks(0.2)
        other.plus(d)
        return -whitened(other, sightings)

    H = numeric.jacobian(rest, state.size)
    P = state.cov.copy()
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + np.eye(len(r)))
    expected = state_with_landmarks(0.2)
    expected.plus(K @ r)
    update(state, no_features(), sightings, ROWS, 1)
    assert state.clones[0].p_WI == pytest.approx(expected.clones[0].p_WI, abs=1e-8)
    assert state.R_WI == pytest.approx(expected.R_WI, abs=1e-8)
    assert state.v_W == pytest.approx(expected.v_W, abs=1e-8)
    assert state.cov == pytest.approx((np.eye(state.size) - K @ H) @ P, abs=1e-9)


def test_iterating_fits_better_than_one_step() -> None:
    """Eq. (41) with its iteration: from a poor start the rows are met better, and never worse."""
    sightings = sightings_from(so3.exp(np.array([0.02, -0.05, 0.12])), np.array([0.15, -0.1, 0.05]))
    once, often = state_with_landmarks(10.0), state_with_landmarks(10.0)
    before = np.sum(whitened(once, sightings) ** 2)
    update(once, no_features(), sightings, ROWS, 1)
    rounds = update(often, no_features(), sightings, ROWS, 8)
    assert rounds > 1
    after_one, after_all = (np.sum(whitened(s, sightings) ** 2) for s in (once, often))
    assert after_all < 0.2 * after_one < before
    assert after_all < 2.0


def test_the_clone_and_the_imu_stay_one_pose() -> None:
    """A clone of the present pose is the same unknown: the update moves both alike."""
    state = state_with_landmarks(1.0)
    update(state, no_features(), sightings_from(so3.exp(np.array([0.0, 0.0, 0.01])), np.zeros(3)), ROWS, 3)
    assert state.clones[0].p_WI == pytest.approx(state.p_WI, abs=1e-9)
    assert state.clones[0].R_WI == pytest.approx(state.R_WI, abs=1e-9)
    assert np.linalg.norm(so3.log(state.R_WI)) > 1e-3
    assert state.size == CORE + CLONE + LANDMARK * len(POINTS_W)


def test_nothing_seen_changes_nothing() -> None:
    state = state_with_landmarks(1.0)
    cov = state.cov.copy()
    assert update(state, no_features(), LandmarkSightings.none(), ROWS, 3) == 0
    assert np.array_equal(state.cov, cov)
