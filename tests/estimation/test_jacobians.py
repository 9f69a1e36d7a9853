"""Every analytic Jacobian of the estimator against a numeric one."""

import numpy as np
import pytest

from snakeslam.calibration import ImuCalibration
from snakeslam.estimation.filter.preintegration import ImuSegments, preintegrate
from snakeslam.estimation.filter.state import BIASES, CORE, State
from snakeslam.estimation.measurements.camera import Observations, Poses, ReprojectionModel, jacobians, residuals
from snakeslam.estimation.measurements.settings import NoiseSettings
from snakeslam.estimation.measurements.zero_velocity import StationaryPeriod, ZeroVelocity
from snakeslam.geometry import numeric, so3

GRAVITY_W = np.array([0.0, 0.0, -9.81])
NOISE = ImuCalibration(
    gyroscope_noise_density=2e-4,
    gyroscope_random_walk=2e-5,
    accelerometer_noise_density=2e-3,
    accelerometer_random_walk=3e-4,
    update_rate=200.0,
)


def segments(rng: np.random.Generator, n: int = 10) -> ImuSegments:
    return ImuSegments(rng.normal(0, 1.0, (n, 3)), rng.normal([0, 0, 9.81], 3.0, (n, 3)), np.full(n, 0.005))


def test_bias_jacobians_of_preintegration(rng: np.random.Generator) -> None:
    """Eq. (26): the derivatives of alpha, beta, gamma by the biases."""
    spans = segments(rng)
    at = preintegrate(spans, np.zeros(3), np.zeros(3), NOISE)

    def error(d: np.ndarray) -> np.ndarray:
        moved = preintegrate(spans, d[:3], d[3:], NOISE)
        return np.concatenate([moved.alpha - at.alpha, moved.beta - at.beta, so3.log(at.gamma.T @ moved.gamma)])

    assert at.J[:9] == pytest.approx(numeric.jacobian(error, 6), abs=2e-6)


def test_propagation_of_the_error_state(rng: np.random.Generator) -> None:
    """Eq. (23) in error form: the covariance moves with the derivative of the propagated state."""
    spans = segments(rng)

    def state() -> State:
        R = so3.exp(np.array([0.3, -0.2, 1.0]))
        return State(0, R, np.array([1.0, 2, 3]), np.array([0.4, -0.2, 0.1]), np.zeros(3), np.zeros(3), np.eye(CORE))

    pre = preintegrate(spans, np.zeros(3), np.zeros(3), NOISE)
    ahead = state()
    ahead.propagate(pre, 50_000_000, GRAVITY_W)

    def moved(d: np.ndarray) -> np.ndarray:
        other = state()
        other.plus(d)
        other.propagate(pre, 50_000_000, GRAVITY_W)
        return np.concatenate(
            [so3.log(ahead.R_WI.T @ other.R_WI), other.p_WI - ahead.p_WI, other.v_W - ahead.v_W, d[BIASES]]
        )

    Phi = numeric.jacobian(moved, CORE)
    noise = state()
    noise.cov = np.zeros((CORE, CORE))
    noise.propagate(pre, 50_000_000, GRAVITY_W)
    assert ahead.cov - noise.cov == pytest.approx(Phi @ Phi.T, abs=1e-6)


def test_rows_of_zero_velocity(rng: np.random.Generator) -> None:
    """Zero velocity and no motion between the last two clones."""

    def state() -> State:
        at = State(
            0, so3.exp(np.array([0.3, -0.2, 1.0])), np.ones(3), np.zeros(3), np.zeros(3), np.zeros(3), np.eye(CORE)
        )
        at.add_clone()
        at.add_clone()
        return at

    rows = ZeroVelocity.of(StationaryPeriod(0, 0.4, 0.001), state(), True)

    def rest(d: np.ndarray) -> np.ndarray:
        moved = state()
        moved.plus(d)
        return -rows.residual(moved)

    H = numeric.jacobian(rest, state().size)
    assert rows.jacobian(state()) == pytest.approx(H, abs=1e-4)
    assert np.linalg.matrix_rank(H) == 9


def camera_rows() -> ReprojectionModel:
    R_IC = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]) @ so3.exp(np.array([0.02, -0.03, 0.01]))
    return ReprojectionModel(R_IC, np.array([0.05, 0.01, -0.02]), 1 / 400, NoiseSettings())


def test_camera_rows(rng: np.random.Generator) -> None:
    """u, v and depth of a point with respect to the pose and the point."""
    rows = camera_rows()
    R, p, f = so3.exp(rng.normal(0, 0.3, 3)), rng.normal(0, 0.3, 3), np.array([3.0, 0.4, -0.3])
    observed = Observations.weighted(np.array([[[0.1, 0.05, 2.5]]]), np.ones((1, 1), bool), rows)

    def rest(d: np.ndarray) -> np.ndarray:
        poses = Poses((R @ so3.exp(d[:3]))[None], (p + d[3:6])[None])
        return -residuals((f + d[6:])[None], poses, observed, rows)

    Hx, Hf = jacobians(f[None], Poses(R[None], p[None]), observed, rows)
    assert np.hstack([Hx[0, 0], Hf[0, 0]]) == pytest.approx(numeric.jacobian(rest, 9), rel=1e-5, abs=1e-4)
    assert np.linalg.norm(Hx[0, 0, 2]) > 0.0


def test_a_blurred_feature_weighs_less() -> None:
    """sigma^2 = pixel^2 + (blur_share * blur)^2 for u and v of blurred images; that of depth stays."""
    rows = ReprojectionModel(np.eye(3), np.zeros(3), 1 / 400, NoiseSettings(blur_share=0.25))
    weight = rows.weights(np.full((1, 2, 3), 1.0), np.array([0.0, 0.03]))[0]
    assert weight[0, :2] == pytest.approx(400.0)
    assert weight[1, :2] == pytest.approx(1 / np.hypot(1 / 400, 0.25 * 0.03))
    assert weight[0, 2] == weight[1, 2] > 0.0
