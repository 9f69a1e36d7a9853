"""Where the filter starts: gravity, velocity and biases, from a still moment or from motion.

W is z up with its origin at the IMU and its yaw zero at the start.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize

from snakeslam.calibration import ImuCalibration
from snakeslam.estimation.measurements import (
    CameraRows,
    Observations,
    Poses,
    jacobians,
    residuals,
    robust_scale,
    triangulate,
)
from snakeslam.estimation.preintegration import (
    ALPHA,
    GAMMA,
    ImuBuffer,
    ImuSegments,
    Preintegrated,
    preintegrate,
)
from snakeslam.estimation.state import BIAS_A as X_BIAS_A
from snakeslam.estimation.state import BIAS_G as X_BIAS_G
from snakeslam.estimation.state import CORE, THETA, P, State, V
from snakeslam.estimation.tracks import Track
from snakeslam.geometry import so3
from snakeslam.messages import Float, ImuSample

SIGMA_BIAS_A = 0.08
SIGMA_BIAS_G = 0.05
STILL_GYRO_STD = 0.02
STILL_GYRO_MEAN = 0.15
STILL_ACCEL_STD = 0.25
STILL_GRAVITY_OFF = 0.6
MIN_STILL_SAMPLES = 10
MIN_TRACK = 4
MIN_TRACKS = 20
MAX_RESIDUAL = 3.0
MAX_SIGMA_V = 0.25
MAX_SIGMA_TILT = np.deg2rad(3.0)
MAX_BIAS_G = 0.5
MAX_BIAS_A = 1.0
CAUTION = 2.0
REFINE_ROUNDS = 10
SUM_AGAIN = 3
SETTLED = 1e-4
DAMPING = 1e-4
FREE_BIAS_G = 4.0
"""Information on the gyro's bias, (rad/s)^-2: next to none."""


def upright(gravity_I: Float) -> Float:
    """Return R_WI with zero yaw for the specific force at rest ``gravity_I`` (3,) (it points up)."""
    up = gravity_I / np.linalg.norm(gravity_I)
    ahead = np.array([1.0, 0.0, 0.0]) - up[0] * up
    if np.linalg.norm(ahead) < 0.1:
        ahead = np.array([0.0, 1.0, 0.0]) - up[1] * up
    ahead /= np.linalg.norm(ahead)
    return np.asarray(np.stack([ahead, np.cross(up, ahead), up]), dtype=np.float64)


def start_still(samples: Sequence[ImuSample], t_ns: int, gravity_m_s2: float, noise: ImuCalibration) -> State | None:
    """Return the state of an IMU at rest at ``t_ns``, or None when ``samples`` show that it moves.

    Tilt comes from the mean specific force, the gyro's bias from its mean; what a bias of the accelerometer does to the
    tilt is in the covariance, as their correlation.
    """
    if len(samples) < MIN_STILL_SAMPLES:
        return None
    gyro = np.array([s.gyro_I for s in samples])
    accel = np.array([s.accel_I for s in samples])
    mean_gyro, mean_accel = gyro.mean(axis=0), accel.mean(axis=0)
    white_gyro = noise.gyroscope_noise_density * np.sqrt(noise.update_rate)
    white_accel = noise.accelerometer_noise_density * np.sqrt(noise.update_rate)
    moves = (
        np.any(gyro.std(axis=0) > STILL_GYRO_STD + 2.0 * white_gyro)
        or np.any(accel.std(axis=0) > STILL_ACCEL_STD + 2.0 * white_accel)
        or np.linalg.norm(mean_gyro) > STILL_GYRO_MEAN
        or abs(np.linalg.norm(mean_accel) - gravity_m_s2) > STILL_GRAVITY_OFF
    )
    if moves:
        return None
    R_WI = upright(mean_accel)
    state = State(t_ns, R_WI, np.zeros(3), np.zeros(3), mean_gyro, np.zeros(3), np.zeros((CORE, CORE)))
    state.cov = _still_covariance(R_WI, len(samples), gravity_m_s2, white_gyro, white_accel)
    return state


def _still_covariance(R_WI: Float, n: int, gravity: float, white_gyro: float, white_accel: float) -> Float:
    """Return the covariance of a still start: an accelerometer bias b tilts the estimate by theta = [g_I]x b / g^2."""
    cov = np.zeros((CORE, CORE))
    cov[X_BIAS_A, X_BIAS_A] = np.eye(3) * SIGMA_BIAS_A**2
    cov[X_BIAS_G, X_BIAS_G] = np.eye(3) * (white_gyro**2 / n + 1e-3**2)
    cov[V, V] = np.eye(3) * 0.01**2
    r_theta_bias = so3.hat(R_WI.T @ np.array([0.0, 0.0, gravity])) / gravity**2
    cov[THETA, THETA] = r_theta_bias @ r_theta_bias.T * (SIGMA_BIAS_A**2 + white_accel**2 / n) + np.eye(3) * 1e-10
    cov[THETA, X_BIAS_A] = r_theta_bias * SIGMA_BIAS_A**2
    cov[X_BIAS_A, THETA] = cov[THETA, X_BIAS_A].T
    cov[P, P] = np.eye(3) * 1e-10
    return cov


@dataclass(frozen=True, slots=True)
class _Window:
    """What a start in motion works on: times from the first frame, spans of IMU up to each frame, points seen."""

    t_s: Float
    spans: list[ImuSegments]
    observed: Observations
    rows: CameraRows
    noise: ImuCalibration
    gravity_m_s2: float

    def motions(self, bias_g: Float, bias_a: Float) -> list[Preintegrated]:
        """Return the pre-integration from the first frame to each later one."""
        return [preintegrate(span, bias_g, bias_a, self.noise) for span in self.spans]


def start_moving(
    tracks: Sequence[Track],
    times_ns: Sequence[int],
    imu: ImuBuffer,
    rows: CameraRows,
    noise: ImuCalibration,
    gravity_m_s2: float,
) -> State | None:
    """Return the state at the first of ``times_ns`` from frames seen in motion, or None while they do not tell enough.

    The gyro's bias makes epipolar planes meet [Kneip13]; then velocity, gravity and points follow linearly from the
    rays [Martinelli14]; then all is refined together with both biases on the reprojection errors. A result is taken
    only when its residuals, its covariance and its biases are plausible.
    """
    window = _window(tracks, times_ns, imu, rows, noise, gravity_m_s2)
    if window is None:
        return None
    bias_g = _gyro_bias(window)
    linear = _velocity_and_gravity(window, window.motions(bias_g, np.zeros(3)))
    if linear is None:
        return None
    refined = _Refinement(window, bias_g, *linear).solve()
    return None if refined is None else _state(refined, times_ns[0], gravity_m_s2)


def _window(
    tracks: Sequence[Track],
    times_ns: Sequence[int],
    imu: ImuBuffer,
    rows: CameraRows,
    noise: ImuCalibration,
    gravity_m_s2: float,
) -> _Window | None:
    spans = [imu.segments(times_ns[0], t_ns) for t_ns in times_ns[1:]]
    long = [t for t in tracks if sum(s in set(times_ns) for s in t.t_ns) >= MIN_TRACK]
    if len(long) < MIN_TRACKS or any(span is None for span in spans):
        return None
    t_s = (np.array(times_ns) - times_ns[0]) / 1e9
    kept = [span for span in spans if span is not None]
    return _Window(t_s, kept, Observations.of(long, times_ns, rows), rows, noise, gravity_m_s2)


def _gyro_bias(window: _Window) -> Float:
    """Return the gyro bias for which the epipolar planes of frame pairs share a direction of travel best."""
    n = len(window.t_s)
    stride = max(1, n // 4)
    pairs = [(k, min(k + stride, n - 1)) for k in range(0, n - stride, max(1, stride // 2))]
    rays = np.concatenate([window.observed.xyz[..., :2], np.ones((*window.observed.seen.shape, 1))], axis=-1)
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True) @ window.rows.R_IC.T
    both = [window.observed.seen[:, a] & window.observed.seen[:, b] for a, b in pairs]
    pre = window.motions(np.zeros(3), np.zeros(3))

    def turn(k: int, bias: Float) -> Float:
        return np.eye(3) if k == 0 else pre[k - 1].corrected(bias, np.zeros(3))[2]

    def cost(bias: Float) -> float:
        total = float(bias @ bias) * 1e-6
        for (a, b), seen in zip(pairs, both, strict=True):
            normals = np.cross(rays[seen, a] @ turn(a, bias).T, rays[seen, b] @ turn(b, bias).T)
            total += float(np.linalg.eigvalsh(normals.T @ normals)[0])
        return total

    return np.asarray(minimize(cost, np.zeros(3), method="BFGS", options={"gtol": 1e-9}).x)


def _velocity_and_gravity(window: _Window, pre: list[Preintegrated]) -> tuple[Float, Float] | None:
    """Return v and g at the first frame, in its IMU frame, from the linear equations of all rays, with |g| known.

    A ray d of frame j with turn R_j sees its point P: [R_j d]x (P - v t_j - g t_j^2 / 2 - alpha_j - R_j p_IC) = 0; a
    measured depth gives the third row. Points are eliminated; the norm of g enters by a Lagrange multiplier.
    """
    R_j = np.stack([np.eye(3), *(p.gamma for p in pre)])
    alpha = np.stack([np.zeros(3), *(p.alpha for p in pre)])
    rays = np.concatenate([window.observed.xyz[..., :2], np.ones((*window.observed.seen.shape, 1))], axis=-1)
    length = np.linalg.norm(rays, axis=-1, keepdims=True)
    d = np.einsum("nij,mnj->mni", R_j @ window.rows.R_IC, rays / length)
    origin = alpha + R_j @ window.rows.p_IC
    z = window.observed.xyz[..., 2]
    along = (window.rows.usable_depth(z) & window.observed.seen) * 0.3
    W = (np.eye(3) - d[..., :, None] * d[..., None, :]) * window.observed.seen[..., None, None]
    W = W + along[..., None, None] * d[..., :, None] * d[..., None, :]
    lifted = origin[None] + d * (z * length[..., 0] * (along > 0))[..., None]
    # P - B x = lifted, weighted by W, with x = (v, g).
    t = window.t_s
    B = np.concatenate([t[:, None, None] * np.eye(3), 0.5 * t[:, None, None] ** 2 * np.eye(3)], axis=-1)
    A_pp = W.sum(axis=1) + 1e-9 * np.eye(3)
    A_px = -np.einsum("mnij,njk->mik", W, B)
    A_xx = np.einsum("nki,mnkl,nlj->ij", B, W, B, optimize=True)
    b_p = np.einsum("mnij,mnj->mi", W, lifted)
    b_x = -np.einsum("nki,mnkl,mnl->i", B, W, lifted, optimize=True)
    reduce = np.swapaxes(A_px, 1, 2) @ np.linalg.inv(A_pp)
    A = A_xx - np.einsum("mik,mkj->ij", reduce, A_px)
    b = b_x - np.einsum("mik,mk->i", reduce, b_p)
    if np.linalg.cond(A[:3, :3]) > 1e12:
        return None
    to_g = A[3:, :3] @ np.linalg.inv(A[:3, :3])
    g = _on_sphere(A[3:, 3:] - to_g @ A[:3, 3:], b[3:] - to_g @ b[:3], window.gravity_m_s2)
    return np.linalg.solve(A[:3, :3], b[:3] - A[:3, 3:] @ g), g


def _on_sphere(A: Float, b: Float, radius: float) -> Float:
    """Return argmin x^T A x / 2 - b^T x with |x| = radius (A symmetric): (A + m I) x = b with the largest fitting m."""
    values, vectors = np.linalg.eigh(0.5 * (A + A.T))
    c = vectors.T @ b

    def excess(m: float) -> float:
        return float(np.linalg.norm(c / (values + m))) - radius

    low = -values[0] + max(1e-12, 1e-9 * abs(float(values[-1])))
    high = float(np.linalg.norm(b)) / radius + abs(float(values[0])) + float(abs(values[-1])) + 1.0
    if excess(low) <= 0.0:
        x = c / (values + low)
        x[0] += np.copysign(np.sqrt(max(radius**2 - float(x @ x) + x[0] ** 2, 0.0)) - abs(x[0]), x[0] or 1.0)
        return vectors @ x
    return vectors @ (c / (values + float(brentq(excess, low, high))))


@dataclass(frozen=True, slots=True)
class _Start:
    v: Float
    g: Float
    bias_g: Float
    bias_a: Float
    cov: Float
    """Of (v, tilt of g in I, bias_g, bias_a), (12, 12); the tilt is a rotation vector normal to g."""


class _Refinement:
    """Gauss-Newton on v, the direction of g, both biases and all points; poses follow from them by pre-integration."""

    SV, SG, SBG, SBA = (slice(3 * k, 3 * k + 3) for k in range(4))

    def __init__(self, window: _Window, bias_g: Float, v: Float, g: Float) -> None:
        self.w, self.v, self.g = window, v, g
        self.bias_g, self.bias_a = bias_g, np.zeros(3)
        self.points: Float | None = None

    def solve(self) -> _Start | None:
        """Return the refined start, or None when it is not plausible."""
        prior = np.zeros(12)
        prior[self.SBG], prior[self.SBA] = FREE_BIAS_G, SIGMA_BIAS_A**-2
        pre = self.w.motions(self.bias_g, self.bias_a)
        A, b, cost, rms = self._normal_equations(pre)
        for rounds in range(1, REFINE_ROUNDS):
            pull = np.concatenate([np.zeros(9), prior[self.SBA] * self.bias_a])
            scale = np.diag(np.diag(A)) * DAMPING
            step: Float = np.asarray(np.linalg.solve(self._with_prior(A, prior) + scale, b - pull), dtype=np.float64)
            if not np.all(np.isfinite(step)):
                return None
            self._apply(step)
            if rounds % SUM_AGAIN == 0:
                pre = self.w.motions(self.bias_g, self.bias_a)
            last = cost
            A, b, cost, rms = self._normal_equations(pre)
            if abs(last - cost) < SETTLED * max(cost, SETTLED) and rounds > SUM_AGAIN:
                break
        cov: Float = np.asarray(np.linalg.inv(self._with_prior(A, prior)), dtype=np.float64)
        return self._accepted(cov, rms)

    def _with_prior(self, A: Float, prior: Float) -> Float:
        """Return the information with the priors and a strong tie of the turn about g itself, which means nothing."""
        row = self._g_row()
        return A + np.diag(prior) + np.outer(row, row)

    def _g_row(self) -> Float:
        """Return the turn about g itself as a row, weighted strongly."""
        row = np.zeros(12)
        row[self.SG] = self.g / np.linalg.norm(self.g) * 1e4
        return row

    def _apply(self, step: Float) -> None:
        self.v = self.v + step[self.SV]
        self.g = so3.exp(step[self.SG]) @ self.g
        self.bias_g = self.bias_g + step[self.SBG]
        self.bias_a = self.bias_a + step[self.SBA]

    def _poses(self, pre: list[Preintegrated]) -> tuple[Float, Float, Float]:
        """Return R (n, 3, 3) and p (n, 3) in the first IMU frame, and d(theta, p)/d(v, tilt, biases), (n, 6, 12)."""
        n = len(pre) + 1
        R, p = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3))
        r = np.zeros((n, 6, 12))
        for k, m in enumerate(pre, start=1):
            alpha, _, R[k] = m.corrected(self.bias_g, self.bias_a)
            t = m.dt_s
            p[k] = self.v * t + 0.5 * self.g * t**2 + alpha
            r[k, :3, self.SBG] = m.J[GAMMA, :3]
            r[k, 3:, self.SV] = np.eye(3) * t
            r[k, 3:, self.SG] = -0.5 * t**2 * so3.hat(self.g)
            r[k, 3:, 6:] = m.J[ALPHA]
        return R, p, r

    def _normal_equations(self, pre: list[Preintegrated]) -> tuple[Float, Float, float, float]:
        R, p, r_pose_x = self._poses(pre)
        poses = Poses(R, p)
        self.points, good = triangulate(poses, self.w.observed, self.w.rows)
        observed, points = self.w.observed.pick(good), self.points[good]
        r = residuals(points, poses, observed, self.w.rows)
        scale = robust_scale(r)
        Hx, Hf = jacobians(points, poses, observed, self.w.rows)
        Hx = np.einsum("mnki,nij->mnkj", Hx, r_pose_x) * scale[..., None]
        Hf, r = Hf * scale[..., None], r * scale
        m = len(points)
        Hx, Hf, flat = Hx.reshape(m, -1, 12), Hf.reshape(m, -1, 3), r.reshape(m, -1)
        cross = np.swapaxes(Hx, 1, 2) @ Hf
        A_inv = np.linalg.inv(np.swapaxes(Hf, 1, 2) @ Hf + 1e-9 * np.eye(3))
        narrow = cross @ A_inv
        g_f = np.einsum("mki,mk->mi", Hf, flat)
        A = np.einsum("mki,mkj->ij", Hx, Hx) - np.einsum("mij,mkj->ik", narrow, cross)
        b = np.einsum("mki,mk->i", Hx, flat) - np.einsum("mij,mj->i", narrow, g_f)
        seen = max(1, int(observed.seen.sum()))
        self.count = m
        return A, b, float(np.sum(flat**2)), float(np.sqrt(np.sum(flat**2) / (2 * seen)))

    def _accepted(self, cov: Float, rms: float) -> _Start | None:
        sigma = np.sqrt(np.maximum(np.diag(cov), 0.0))
        plausible = (
            self.count >= MIN_TRACKS
            and rms < MAX_RESIDUAL
            and bool(np.all(sigma[self.SV] < MAX_SIGMA_V))
            and bool(np.all(sigma[self.SG] < MAX_SIGMA_TILT))
            and float(np.linalg.norm(self.bias_g)) < MAX_BIAS_G
            and float(np.linalg.norm(self.bias_a)) < MAX_BIAS_A
        )
        return _Start(self.v, self.g, self.bias_g, self.bias_a, cov) if plausible else None


def _state(start: _Start, t_ns: int, gravity_m_s2: float) -> State:
    """Return the filter's state of a start; its covariance is widened, as its frames are used once more."""
    R_WI = upright(-start.g)
    state = State(t_ns, R_WI, np.zeros(3), R_WI @ start.v, start.bias_g, start.bias_a, np.zeros((CORE, CORE)))
    # g_I true = Exp(d) g_I; R_WI true = R_WI Exp(theta) with theta = -d for the part normal to g. v_W = R_WI v_I.
    M = np.zeros((CORE, 12))
    normal = np.eye(3) - np.outer(start.g, start.g) / gravity_m_s2**2
    M[THETA, 3:6] = -normal
    M[V, :3] = R_WI
    M[V, 3:6] = R_WI @ so3.hat(start.v) @ normal
    M[X_BIAS_G, 6:9] = M[X_BIAS_A, 9:12] = np.eye(3)
    cov = M @ start.cov @ M.T * CAUTION**2
    cov[THETA, THETA] += np.eye(3) * 1e-8
    cov[P, P] += np.eye(3) * 1e-10
    state.cov = 0.5 * (cov + cov.T)
    return state
