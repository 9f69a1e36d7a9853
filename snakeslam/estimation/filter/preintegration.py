"""Pre-integrated IMU measurements, Eq. (22)-(27), with bias Jacobians and covariance.

Between two times k and k+1 the samples are summed in the IMU frame of k, so that the sums depend on neither pose nor
velocity there: alpha (position), beta (velocity) and gamma (rotation) [Forster17],

    p_{k+1} = p_k + v_k dt + g dt^2 / 2 + R_k alpha,   v_{k+1} = v_k + g dt + R_k beta,   R_{k+1} = R_k gamma.

The paper's quaternion gamma is a rotation matrix here; its error is a right perturbation.
"""

from bisect import bisect_right
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from snakeslam.calibration import ImuCalibration
from snakeslam.estimation.filter.imu_doubt import ImuFaultDetector, MotionDoubt, SampleDoubt, motion_doubt
from snakeslam.geometry import so3
from snakeslam.messages import Float, ImuSample

ALPHA, BETA, GAMMA, BIAS_G, BIAS_A = (slice(3 * k, 3 * k + 3) for k in range(5))
SIZE = 15
MAX_RATE_RAD_S, MAX_ACCEL_M_S2 = 100.0, 500.0
"""Samples beyond these are errors: a consumer IMU ends at 2000 deg/s (35 rad/s) and 16 g (157 m/s^2)."""


@dataclass(frozen=True, slots=True)
class ImuSegments:
    """Constant rate and specific force over each of n spans: ``gyro_I`` (n, 3), ``accel_I`` (n, 3), ``dt_s`` (n,)."""

    gyro_I: Float
    accel_I: Float
    dt_s: Float

    def last_rate(self, span_s: float, noise: ImuCalibration) -> tuple[Float, float]:
        """Return the mean rate (3,) over about the last ``span_s`` and one sigma of its noise, rad/s."""
        until_end_s = np.cumsum(self.dt_s[::-1])[::-1]
        kept = until_end_s <= max(span_s, float(self.dt_s[-1])) + 1e-9
        dt_s = self.dt_s[kept]
        total_s = float(dt_s.sum())
        return dt_s @ self.gyro_I[kept] / total_s, noise.gyroscope_noise_density / total_s**0.5


@dataclass(frozen=True, slots=True)
class Preintegrated:
    """The sums of Eq. (26) and their first-order dependence on the biases with which they were made.

    ``alpha`` (3,) m, ``beta`` (3,) m/s, ``gamma`` (3, 3); ``J`` (15, 6) is the derivative of the error (alpha, beta,
    theta, b_g, b_a) with respect to (b_g, b_a); ``cov`` (15, 15) the covariance of that error.
    """

    dt_s: float
    alpha: Float
    beta: Float
    gamma: Float
    J: Float
    cov: Float
    bias_g: Float
    bias_a: Float

    def corrected(self, bias_g: Float, bias_a: Float) -> tuple[Float, Float, Float]:
        """Return alpha, beta, gamma for other biases, to first order: alpha + J_alpha db, gamma Exp(J_gamma db)."""
        d = np.concatenate([bias_g - self.bias_g, bias_a - self.bias_a])
        correction = self.J @ d
        return (
            self.alpha + correction[ALPHA],
            self.beta + correction[BETA],
            self.gamma @ so3.exp(correction[GAMMA]),
        )

    def residual(
        self,
        state_k: tuple[Float, Float, Float, Float, Float],
        state_k1: tuple[Float, Float, Float, Float, Float],
        gravity_W: Float,
    ) -> Float:
        """Return the residual of Eq. (27), (15,), for states (R_WI, p_WI, v_W, bias_g, bias_a) at both ends.

        The sign of the velocity row is corrected: beta is compared with R^T (v_k+1 - v_k - g_W dt).
        """
        R_k, p_k, v_k, bg_k, ba_k = state_k
        R_k1, p_k1, v_k1, bg_k1, ba_k1 = state_k1
        alpha, beta, gamma = self.corrected(bg_k, ba_k)
        dt = self.dt_s
        return np.concatenate(
            [
                R_k.T @ (p_k1 - p_k - v_k * dt - 0.5 * gravity_W * dt**2) - alpha,
                R_k.T @ (v_k1 - v_k - gravity_W * dt) - beta,
                so3.log(gamma.T @ R_k.T @ R_k1),
                bg_k1 - bg_k,
                ba_k1 - ba_k,
            ]
        )


def preintegrate(segments: ImuSegments, bias_g: Float, bias_a: Float, noise: ImuCalibration) -> Preintegrated:
    """Return the sums of Eq. (26) over what the IMU measures, Eq. (22), with their covariance and bias Jacobians.

    In each span i rate and specific force are constant, w = w_m - b_g and a = a_m - b_a; the rotation is integrated by
    Eq. (23)-(24).

    """
    dt = segments.dt_s
    rotations = (segments.gyro_I - bias_g) * dt[:, None]
    a = segments.accel_I - bias_a

    # 1. Rotation, Eq. (23)-(24): gamma_{i+1} = gamma_i Exp(w dt). The force acts at the middle of its span, at
    #    gamma_i Exp(w dt / 2).
    steps = so3.exp(np.concatenate([rotations, 0.5 * rotations]))
    steps, halves = steps[: len(dt)], steps[len(dt) :]
    R = np.empty((len(dt) + 1, 3, 3))
    R[0] = np.eye(3)
    for k, step in enumerate(steps):
        np.matmul(R[k], step, out=R[k + 1])
    middle = R[:-1] @ halves

    # 2. Velocity and position, Eq. (26): beta += f dt, alpha += beta dt + f dt^2 / 2, with f = gamma a.
    force = (middle @ a[..., None])[..., 0]
    beta = np.concatenate([np.zeros((1, 3)), np.cumsum(force * dt[:, None], axis=0)])
    alpha = np.sum(beta[:-1] * dt[:, None] + 0.5 * force * dt[:, None] ** 2, axis=0)

    # 3. Error transition of each span, e_{i+1} = F e_i + noise, e = (alpha, beta, theta, b_g, b_a), with
    #    df/dtheta_i = -gamma_i [Exp(w dt / 2) a]x, df/db_a = -gamma Exp(w dt / 2), df/db_g = df/dtheta_i (-dt / 2).
    n, dt_1 = len(dt), dt[:, None, None]
    minus_force_D_theta = R[:-1] @ so3.hat((halves @ a[..., None])[..., 0])
    F = np.tile(np.eye(SIZE), (n, 1, 1))
    F[:, ALPHA, BETA] = np.eye(3) * dt_1
    F[:, ALPHA, GAMMA] = -0.5 * dt_1**2 * minus_force_D_theta
    F[:, BETA, GAMMA] = -dt_1 * minus_force_D_theta
    F[:, GAMMA, GAMMA] = np.swapaxes(steps, 1, 2)
    F[:, ALPHA, BIAS_A] = -0.5 * dt_1**2 * middle
    F[:, BETA, BIAS_A] = -dt_1 * middle
    F[:, ALPHA, BIAS_G] = 0.25 * dt_1**3 * minus_force_D_theta
    F[:, BETA, BIAS_G] = 0.5 * dt_1**2 * minus_force_D_theta
    F[:, GAMMA, BIAS_G] = -so3.right_jacobian(rotations) * dt_1

    # 4. White noise of a span, from densities per sqrt(Hz): sigma_a^2 dt in beta, of which alpha takes dt / 2;
    #    sigma_g^2 dt in theta; the biases walk by sigma_b^2 dt.
    eye, white = np.eye(3), noise.accelerometer_noise_density**2 * dt_1
    Q = np.zeros((n, SIZE, SIZE))
    Q[:, ALPHA, ALPHA] = eye * (white * dt_1**2 / 4.0)
    Q[:, ALPHA, BETA] = Q[:, BETA, ALPHA] = eye * (white * dt_1 / 2.0)
    Q[:, BETA, BETA] = eye * white
    Q[:, GAMMA, GAMMA] = eye * (noise.gyroscope_noise_density**2 * dt_1)
    Q[:, BIAS_G, BIAS_G] = eye * (noise.gyroscope_random_walk**2 * dt_1)
    Q[:, BIAS_A, BIAS_A] = eye * (noise.accelerometer_random_walk**2 * dt_1)

    # 5. Covariance P <- F P F^T + Q and Jacobian by the biases J <- F J, from one span to the next.
    J, cov = np.eye(SIZE), np.zeros((SIZE, SIZE))
    for F_k, Q_k in zip(F, Q, strict=True):
        cov = F_k @ cov @ F_k.T + Q_k
        J = F_k @ J
    return Preintegrated(
        float(dt.sum()), alpha, beta[-1], R[-1], J[:, BIAS_G.start :], cov, bias_g.copy(), bias_a.copy()
    )


def _time(sample: ImuSample) -> int:
    return sample.t_ns


def _all_below(vector: Float, limit: float) -> bool:
    # A comparison with NaN is false.
    return all(-limit < x < limit for x in vector.tolist())


class ImuBuffer:
    """The last IMU samples, from which the spans between any two times are cut."""

    def __init__(self, calibration: ImuCalibration) -> None:
        self._samples_are_means = calibration.sample_kind == "mean"
        self._samples: list[ImuSample] = []
        self._last_ns: int | None = None
        self._bad = 0
        self._cut: tuple[int, int, ImuSegments] | None = None
        """The last spans with their start and end: several parts of a frame ask for the same ones."""
        self._faults = ImuFaultDetector()
        self._doubts: list[tuple[int, SampleDoubt]] = []
        self._period_s = 1.0 / calibration.update_rate

    def add(self, sample: ImuSample) -> None:
        """Add the next sample; one that is late, not finite or beyond every full scale is only counted."""
        late = self._last_ns is not None and sample.t_ns <= self._last_ns
        if late or not (_all_below(sample.gyro_I, MAX_RATE_RAD_S) and _all_below(sample.accel_I, MAX_ACCEL_M_S2)):
            self._bad += 1
            return
        self._last_ns = sample.t_ns
        sample, doubt = self._faults.check(sample)
        if doubt is not None:
            self._doubts.append((sample.t_ns, doubt))
        self._samples.append(sample)
        self._cut = None

    def doubt(self, start_ns: int, end_ns: int) -> MotionDoubt | None:
        """Return the error that doubted samples may cause between two times, None without such samples."""
        return motion_doubt(self._doubts, start_ns, end_ns, self._period_s)

    def pop_bad_count(self) -> int:
        """Return how many samples were refused since the last call."""
        bad, self._bad = self._bad, 0
        return bad

    def forget_before(self, t_ns: int) -> None:
        """Drop the samples that no span after ``t_ns`` needs."""
        keep = bisect_right(self._samples, t_ns, key=_time)
        del self._samples[: max(0, keep - 1)]
        self._doubts = [(at_ns, doubt) for at_ns, doubt in self._doubts if at_ns > t_ns]
        self._cut = None

    def clear(self) -> None:
        """Drop all samples and the time of the last one, after the clock has been set."""
        self._samples.clear()
        self._doubts.clear()
        self._faults.clear()
        self._last_ns = self._cut = None

    def ahead_s(self, t_ns: int) -> float:
        """Return how far ``t_ns`` is ahead of the last sample, in s; 0 without samples."""
        return 0.0 if self._last_ns is None else max(0.0, (t_ns - self._last_ns) / 1e9)

    def recent(self, t_ns: int) -> list[ImuSample]:
        """Return the samples after ``t_ns``."""
        return self._samples[bisect_right(self._samples, t_ns, key=_time) :]

    @property
    def samples(self) -> tuple[ImuSample, ...]:
        """The samples in the buffer, oldest first."""
        return tuple(self._samples)

    def covered_since_ns(self, t_ns: int, max_gap_s: float) -> int | None:
        """Return since when samples cover the time up to ``t_ns`` without a gap; None if the last one is too old."""

        until_ns, max_gap_ns = t_ns, round(max_gap_s * 1e9)
        for sample in reversed(self._samples):
            if until_ns - sample.t_ns > max_gap_ns:
                break
            until_ns = min(until_ns, sample.t_ns)
        reaches_t = self._last_ns is not None and t_ns - self._last_ns <= max_gap_ns
        return None if until_ns == t_ns and not reaches_t else until_ns

    def longest_gap_s(self, start_ns: int, end_ns: int) -> float:
        """Return the longest time without a sample up to ``end_ns``, counted from the last one before ``start_ns``."""
        first = bisect_right(self._samples, start_ns, key=_time)
        begin_ns = self._samples[first - 1].t_ns if first else start_ns
        times = [begin_ns, *(s.t_ns for s in self._samples[first:] if s.t_ns < end_ns), end_ns]
        return max(b - a for a, b in pairwise(times)) / 1e9

    def segments(self, start_ns: int, end_ns: int) -> ImuSegments | None:
        """Return the spans between two times, cut at every sample; None without samples.

        A sample of kind "mean" is constant over the interval that ends at its stamp; between instantaneous samples the
        mean of the two ends is taken. Where there are no samples the nearest one is used.
        """
        if not self._samples or end_ns <= start_ns:
            return None
        if self._cut is not None and self._cut[:2] == (start_ns, end_ns):
            return self._cut[2]
        # Cut the time at every sample; the value of a span is that of the sample at its end, or the mean of both ends.
        first = max(0, bisect_right(self._samples, start_ns, key=_time) - 1)
        near = self._samples[first : bisect_right(self._samples, end_ns, key=_time) + 1]
        t = np.array([s.t_ns for s in near], dtype=np.int64)
        cuts = np.unique(np.concatenate([[start_ns, end_ns], t[(t > start_ns) & (t < end_ns)]]))
        values = np.concatenate([[s.gyro_I for s in near], [s.accel_I for s in near]], axis=1)
        if self._samples_are_means:
            span = values[np.minimum(np.searchsorted(t, cuts[1:]), len(t) - 1)]
        else:
            seconds = (t - start_ns) / 1e9
            at_cuts = np.stack([np.interp((cuts - start_ns) / 1e9, seconds, values[:, k]) for k in range(6)], axis=-1)
            span = 0.5 * (at_cuts[:-1] + at_cuts[1:])
        segments = ImuSegments(span[:, :3], span[:, 3:], np.diff(cuts) / 1e9)
        self._cut = start_ns, end_ns, segments
        return segments
