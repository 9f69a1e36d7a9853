"""Pre-integrated IMU measurements, Eq. (22)-(27), with bias Jacobians and covariance.

Between two times b_k and b_k+1 the samples are summed in the IMU frame of b_k, so that the result does not depend on
the pose or velocity there: alpha (position), beta (velocity) and gamma (rotation) [Forster17]. The paper's
quaternion gamma is a rotation matrix here; its errors are right perturbations.
"""

from bisect import bisect_right
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from snakeslam.calibration import ImuCalibration
from snakeslam.estimation.filter.imu_doubt import MotionDoubt, SampleDoubt, SampleJudge, motion_doubt
from snakeslam.geometry import so3
from snakeslam.messages import Float, ImuSample

ALPHA, BETA, GAMMA, BIAS_G, BIAS_A = (slice(3 * k, 3 * k + 3) for k in range(5))
SIZE = 15
MAX_RATE_RAD_S, MAX_ACCEL_M_S2 = 100.0, 500.0
"""What no IMU measures on anything that crawls."""


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
    """The summed motion and its first-order dependence on the biases it was summed with.

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
        """Return alpha, beta, gamma for other biases, to first order."""
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

    Each span turns by Exp(w dt), Eq. (23)-(24) for a constant rate; its force acts at the rotation of its middle.
    """
    dt = segments.dt_s
    turns = (segments.gyro_I - bias_g) * dt[:, None]
    a = segments.accel_I - bias_a
    steps = so3.exp(np.concatenate([turns, 0.5 * turns]))
    halves = steps[len(dt) :]
    R = _running_product(steps[: len(dt)])
    middle = R[:-1] @ halves
    force = (middle @ a[..., None])[..., 0]
    beta = np.concatenate([np.zeros((1, 3)), np.cumsum(force * dt[:, None], axis=0)])
    alpha = np.sum(beta[:-1] * dt[:, None] + 0.5 * force * dt[:, None] ** 2, axis=0)
    r_force_theta = R[:-1] @ so3.hat((halves @ a[..., None])[..., 0])
    F = _transitions(middle, r_force_theta, steps[: len(dt)], so3.right_jacobian(turns), dt)
    Q = _noise(dt, noise)
    J, cov = np.eye(SIZE), np.zeros((SIZE, SIZE))
    for F_k, Q_k in zip(F, Q, strict=True):
        cov = F_k @ cov @ F_k.T + Q_k
        J = F_k @ J
    return Preintegrated(
        float(dt.sum()), alpha, beta[-1], R[-1], J[:, BIAS_G.start :], cov, bias_g.copy(), bias_a.copy()
    )


def _running_product(steps: Float) -> Float:
    """Return I, R_1, R_1 R_2, ... of turns (n, 3, 3), (n + 1, 3, 3)."""
    R = np.empty((len(steps) + 1, 3, 3))
    R[0] = np.eye(3)
    for k, step in enumerate(steps):
        np.matmul(R[k], step, out=R[k + 1])
    return R


def _transitions(middle: Float, r_force_theta: Float, steps: Float, jacobians: Float, dt_s: Float) -> Float:
    """Return the error transition of each span, (n, 15, 15), first order in dt for the biases' part in the force."""
    n, dt = len(dt_s), dt_s[:, None, None]
    F = np.tile(np.eye(SIZE), (n, 1, 1))
    F[:, ALPHA, BETA] = np.eye(3) * dt
    F[:, ALPHA, GAMMA] = -0.5 * dt**2 * r_force_theta
    F[:, BETA, GAMMA] = -dt * r_force_theta
    F[:, GAMMA, GAMMA] = np.swapaxes(steps, 1, 2)
    F[:, ALPHA, BIAS_A] = -0.5 * dt**2 * middle
    F[:, BETA, BIAS_A] = -dt * middle
    F[:, ALPHA, BIAS_G] = 0.25 * dt**3 * r_force_theta
    F[:, BETA, BIAS_G] = 0.5 * dt**2 * r_force_theta
    F[:, GAMMA, BIAS_G] = -jacobians * dt
    return F


def _noise(dt_s: Float, noise: ImuCalibration) -> Float:
    """Return the covariance that each span adds, (n, 15, 15)."""
    dt, eye = dt_s[:, None, None], np.eye(3)
    Q = np.zeros((len(dt_s), SIZE, SIZE))
    force = noise.accelerometer_noise_density**2 * dt
    Q[:, ALPHA, ALPHA] = eye * (force * dt**2 / 4.0)
    Q[:, ALPHA, BETA] = Q[:, BETA, ALPHA] = eye * (force * dt / 2.0)
    Q[:, BETA, BETA] = eye * force
    Q[:, GAMMA, GAMMA] = eye * (noise.gyroscope_noise_density**2 * dt)
    Q[:, BIAS_G, BIAS_G] = eye * (noise.gyroscope_random_walk**2 * dt)
    Q[:, BIAS_A, BIAS_A] = eye * (noise.accelerometer_random_walk**2 * dt)
    return Q


def _time(sample: ImuSample) -> int:
    return sample.t_ns


def _all_below(vector: Float, limit: float) -> bool:
    # Comparisons with what is not a number are false.
    return all(-limit < x < limit for x in vector.tolist())


class ImuBuffer:
    """The samples since some time, cut into spans between any two times."""

    def __init__(self, calibration: ImuCalibration) -> None:
        self._means = calibration.sample_kind == "mean"
        self._samples: list[ImuSample] = []
        self._last_ns: int | None = None
        self._bad = 0
        self._cut: tuple[int, int, ImuSegments] | None = None
        self._judge = SampleJudge()
        self._doubts: list[tuple[int, SampleDoubt]] = []
        self._period_s = 1.0 / calibration.update_rate

    def add(self, sample: ImuSample) -> None:
        """Take the next sample; one that is late or not possible is only counted."""
        late = self._last_ns is not None and sample.t_ns <= self._last_ns
        if late or not (_all_below(sample.gyro_I, MAX_RATE_RAD_S) and _all_below(sample.accel_I, MAX_ACCEL_M_S2)):
            self._bad += 1
            return
        self._last_ns = sample.t_ns
        sample, doubt = self._judge.judge(sample)
        if doubt is not None:
            self._doubts.append((sample.t_ns, doubt))
        self._samples.append(sample)
        self._cut = None

    def doubt(self, start_ns: int, end_ns: int) -> MotionDoubt | None:
        """Return what doubted samples may make wrong between two times, None without any."""
        return motion_doubt(self._doubts, start_ns, end_ns, self._period_s)

    def take_bad_count(self) -> int:
        """Return how many samples were refused since the last call."""
        bad, self._bad = self._bad, 0
        return bad

    def forget_before(self, t_ns: int) -> None:
        """Drop what no span after ``t_ns`` needs."""
        keep = bisect_right(self._samples, t_ns, key=_time)
        del self._samples[: max(0, keep - 1)]
        self._doubts = [(at_ns, doubt) for at_ns, doubt in self._doubts if at_ns > t_ns]
        self._cut = None

    def clear(self) -> None:
        """Forget all, the time of the last sample too."""
        self._samples.clear()
        self._doubts.clear()
        self._judge.clear()
        self._last_ns = self._cut = None

    def ahead_s(self, t_ns: int) -> float:
        """Return how long before ``t_ns`` the last sample was, 0 without any."""
        return 0.0 if self._last_ns is None else max(0.0, (t_ns - self._last_ns) / 1e9)

    def recent(self, t_ns: int) -> list[ImuSample]:
        """Return the samples after ``t_ns``."""
        return self._samples[bisect_right(self._samples, t_ns, key=_time) :]

    @property
    def samples(self) -> tuple[ImuSample, ...]:
        """What is held, oldest first."""
        return tuple(self._samples)

    def covered_since_ns(self, t_ns: int, max_gap_s: float) -> int | None:
        """Return since when samples follow each other up to ``t_ns`` without a gap; None if the last is too old."""
        until_ns, max_gap_ns = t_ns, round(max_gap_s * 1e9)
        for sample in reversed(self._samples):
            if until_ns - sample.t_ns > max_gap_ns:
                break
            until_ns = min(until_ns, sample.t_ns)
        return None if until_ns == t_ns and not self._reaches(t_ns, max_gap_ns) else until_ns

    def _reaches(self, t_ns: int, max_gap_ns: int) -> bool:
        return self._last_ns is not None and t_ns - self._last_ns <= max_gap_ns

    def longest_gap_s(self, start_ns: int, end_ns: int) -> float:
        """Return the longest time without a sample up to ``end_ns``, counted from the last one before ``start_ns``."""
        first = bisect_right(self._samples, start_ns, key=_time)
        begin_ns = self._samples[first - 1].t_ns if first else start_ns
        times = [begin_ns, *(s.t_ns for s in self._samples[first:] if s.t_ns < end_ns), end_ns]
        return max(b - a for a, b in pairwise(times)) / 1e9

    def segments(self, start_ns: int, end_ns: int) -> ImuSegments | None:
        """Return the spans between two times; the nearest sample serves where there is none. None if empty."""
        if not self._samples or end_ns <= start_ns:
            return None
        if self._cut is None or self._cut[:2] != (start_ns, end_ns):
            self._cut = start_ns, end_ns, self._segments(start_ns, end_ns)
        return self._cut[2]

    def _segments(self, start_ns: int, end_ns: int) -> ImuSegments:
        first = max(0, bisect_right(self._samples, start_ns, key=_time) - 1)
        near = self._samples[first : bisect_right(self._samples, end_ns, key=_time) + 1]
        t = np.array([s.t_ns for s in near], dtype=np.int64)
        cuts = np.unique(np.concatenate([[start_ns, end_ns], t[(t > start_ns) & (t < end_ns)]]))
        values = np.concatenate([[s.gyro_I for s in near], [s.accel_I for s in near]], axis=1)
        if self._means:
            span = values[np.minimum(np.searchsorted(t, cuts[1:]), len(t) - 1)]
        else:
            seconds = (t - start_ns) / 1e9
            at_cuts = np.stack([np.interp((cuts - start_ns) / 1e9, seconds, values[:, k]) for k in range(6)], axis=-1)
            span = 0.5 * (at_cuts[:-1] + at_cuts[1:])
        return ImuSegments(span[:, :3], span[:, 3:], np.diff(cuts) / 1e9)
