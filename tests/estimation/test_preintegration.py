"""Pre-integration, Eq. (22)-(27): against its meaning, and against gtsam's."""

import numpy as np
import pytest

from snakeslam.calibration import ImuCalibration
from snakeslam.estimation.filter.preintegration import ALPHA, BETA, GAMMA, ImuBuffer, ImuSegments, preintegrate
from snakeslam.geometry import so3
from snakeslam.messages import ImuSample

GRAVITY_W = np.array([0.0, 0.0, -9.81])
NOISE = ImuCalibration(
    gyroscope_noise_density=2e-4,
    gyroscope_random_walk=2e-5,
    accelerometer_noise_density=2e-3,
    accelerometer_random_walk=3e-4,
    update_rate=200.0,
)
ZERO = np.zeros(3)


def spans(rng: np.random.Generator, parts: int = 1) -> ImuSegments:
    """Return 20 spans of 5 ms with rates and forces of a violent motion, each cut into parts."""
    gyro, accel = rng.normal(0, 1, (20, 3)), rng.normal([0, 0, 9.81], 2, (20, 3))
    return ImuSegments(gyro.repeat(parts, 0), accel.repeat(parts, 0), np.full(20 * parts, 0.005 / parts))


def test_sums_are_the_motion_in_the_first_frame(rng: np.random.Generator) -> None:
    """Eq. (22)-(25): R, v, p at the end follow from those at the start, whatever they are."""
    s = spans(rng, 40)
    R, v, p = so3.exp(np.array([0.4, -0.3, 2.0])), np.array([0.5, -1.0, 0.2]), np.array([1.0, 2.0, 3.0])
    R0, v0, p0 = R, v, p
    for w, a, dt in zip(s.gyro_I, s.accel_I, s.dt_s, strict=True):
        force = R @ so3.exp(w * dt / 2) @ a + GRAVITY_W
        p, v, R = p + v * dt + 0.5 * force * dt**2, v + force * dt, R @ so3.exp(w * dt)
    pre = preintegrate(s, ZERO, ZERO, NOISE)
    t = pre.dt_s
    assert t == pytest.approx(0.1)
    assert R0.T @ (p - p0 - v0 * t - 0.5 * GRAVITY_W * t**2) == pytest.approx(pre.alpha, abs=1e-12)
    assert R0.T @ (v - v0 - GRAVITY_W * t) == pytest.approx(pre.beta, abs=1e-12)
    assert R0.T @ R == pytest.approx(pre.gamma, abs=1e-12)


def test_residual_vanishes_on_the_motion_and_shows_errors(rng: np.random.Generator) -> None:
    """Eq. (27), 15 rows, with the velocity row's sign corrected."""
    bias_g, bias_a = np.array([0.02, -0.01, 0.03]), np.array([0.1, 0.05, -0.08])
    pre = preintegrate(spans(rng), bias_g, bias_a, NOISE)
    R, v, p, t = so3.exp(np.array([0.4, -0.3, 2.0])), np.array([0.5, -1.0, 0.2]), np.array([1.0, 2.0, 3.0]), pre.dt_s
    start = (R, p, v, bias_g, bias_a)
    p1 = p + v * t + 0.5 * GRAVITY_W * t**2 + R @ pre.alpha
    end = (R @ pre.gamma, p1, v + GRAVITY_W * t + R @ pre.beta, bias_g, bias_a)
    assert pre.residual(start, end, GRAVITY_W) == pytest.approx(np.zeros(15), abs=1e-12)
    d = np.array([0.01, -0.02, 0.03])
    moved = (end[0] @ so3.exp(d), end[1] + d, end[2] + 2 * d, bias_g + 3 * d, bias_a + 4 * d)
    expected = np.concatenate([R.T @ d, R.T @ (2 * d), d, 3 * d, 4 * d])
    assert pre.residual(start, moved, GRAVITY_W) == pytest.approx(expected, abs=1e-12)


def test_first_order_bias_correction(rng: np.random.Generator) -> None:
    s, d_g, d_a = spans(rng), np.array([2e-3, -1e-3, 1e-3]), np.array([0.02, -0.01, 0.03])
    alpha, beta, gamma = preintegrate(s, ZERO, ZERO, NOISE).corrected(d_g, d_a)
    again = preintegrate(s, d_g, d_a, NOISE)
    assert alpha == pytest.approx(again.alpha, abs=1e-6)
    assert beta == pytest.approx(again.beta, abs=1e-5)
    assert gamma == pytest.approx(again.gamma, abs=1e-6)


def test_covariance_against_samples(rng: np.random.Generator) -> None:
    """Eq. (26): the covariance is that of sums over noisy samples."""
    s = spans(rng)
    at = preintegrate(s, ZERO, ZERO, NOISE)
    errors = []
    for _ in range(400):
        white = rng.normal(0, 1 / np.sqrt(0.005), (2, 20, 3))
        gyro = s.gyro_I + white[0] * NOISE.gyroscope_noise_density
        accel = s.accel_I + white[1] * NOISE.accelerometer_noise_density
        noisy = preintegrate(ImuSegments(gyro, accel, s.dt_s), ZERO, ZERO, NOISE)
        errors.append(np.concatenate([noisy.alpha - at.alpha, noisy.beta - at.beta, so3.log(at.gamma.T @ noisy.gamma)]))
    sampled = np.sqrt(np.var(errors, axis=0))
    for part in (ALPHA, BETA, GAMMA):
        assert sampled[part] == pytest.approx(np.sqrt(np.diag(at.cov)[part]), rel=0.15)


def test_agrees_with_gtsam(rng: np.random.Generator) -> None:
    """Eq. (22)-(24) against an independent implementation, on spans so short that the rules of integration agree."""
    gtsam = pytest.importorskip("gtsam")
    s = spans(rng, 500)
    theirs = gtsam.PreintegratedImuMeasurements(gtsam.PreintegrationParams.MakeSharedU(9.81))
    for w, a, dt in zip(s.gyro_I, s.accel_I, s.dt_s, strict=True):
        theirs.integrateMeasurement(a, w, dt)
    ours = preintegrate(s, ZERO, ZERO, NOISE)
    assert ours.gamma == pytest.approx(theirs.deltaRij().matrix(), abs=1e-6)
    assert ours.beta == pytest.approx(theirs.deltaVij(), abs=5e-6)
    assert ours.alpha == pytest.approx(theirs.deltaPij(), abs=1e-6)


def test_buffer_cuts_means_and_points_at_any_time() -> None:
    """A mean holds over the interval that it ends; a point value is joined by straight lines."""
    samples = [ImuSample(k * 10, np.full(3, float(k)), np.zeros(3)) for k in range(5)]
    for kind, expected in (("mean", [2.0, 3.0]), ("point", [1.75, 2.25])):
        buffer = ImuBuffer(NOISE.model_copy(update={"sample_kind": kind}))
        for sample in samples:
            buffer.add(sample)
        cut = buffer.segments(15, 25)
        assert cut is not None
        assert cut.dt_s == pytest.approx([5e-9, 5e-9])
        assert cut.gyro_I[:, 0] == pytest.approx(expected)
