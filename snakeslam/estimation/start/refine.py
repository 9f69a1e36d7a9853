"""The refinement of a start in motion: all unknowns together on the reprojection errors."""

from dataclasses import dataclass

import numpy as np

from snakeslam.calibration import ImuCalibration
from snakeslam.estimation.filter.preintegration import (
    ALPHA,
    GAMMA,
    ImuSegments,
    Preintegrated,
    preintegrate,
)
from snakeslam.estimation.filter.state import BIAS_A, BIAS_G, CORE, THETA, P, State, V
from snakeslam.estimation.measurements.camera import (
    CameraRows,
    Observations,
    Poses,
    jacobians,
    residuals,
    robust_scale,
)
from snakeslam.estimation.measurements.triangulation import triangulate
from snakeslam.estimation.start.still import SIGMA_BIAS_A, upright
from snakeslam.geometry import so3
from snakeslam.messages import Float

MIN_TRACKS = 20
MAX_RESIDUAL = 3.0
MAX_SIGMA_V = 0.25
MAX_SIGMA_TILT = np.deg2rad(3.0)
MAX_BIAS_G = 0.5
MAX_BIAS_A = 1.0
CAUTION = 10.0
REFINE_ROUNDS = 10
SUM_AGAIN = 3
SETTLED = 1e-4
DAMPING = 1e-4
FREE_BIAS_G = 4.0
"""Information on the gyro's bias, (rad/s)^-2: next to none."""


@dataclass(frozen=True, slots=True)
class StartWindow:
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


@dataclass(frozen=True, slots=True)
class _Start:
    v: Float
    g: Float
    bias_g: Float
    bias_a: Float
    cov: Float
    """Of (v, tilt of g in I, bias_g, bias_a), (12, 12); the tilt is a rotation vector normal to g."""


class Refinement:
    """Gauss-Newton on v, the direction of g, both biases and all points; poses follow from them by pre-integration."""

    SV, SG, SBG, SBA = (slice(3 * k, 3 * k + 3) for k in range(4))

    def __init__(self, window: StartWindow, bias_g: Float, v: Float, g: Float) -> None:
        self.w, self.v, self.g = window, v, g
        self.bias_g, self.bias_a = bias_g, np.zeros(3)
        self.points: Float | None = None
        self.count = 0

    def solve(self) -> _Start | None:
        """Return the refined start, or None when it is not plausible."""
        prior = np.zeros(12)
        prior[self.SBG], prior[self.SBA] = FREE_BIAS_G, SIGMA_BIAS_A**-2
        pre = self.w.motions(self.bias_g, self.bias_a)
        A, b, cost, rms = self._normal_equations(pre)
        for rounds in range(1, REFINE_ROUNDS):
            if self.count < MIN_TRACKS:
                return None
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
        if self.count < MIN_TRACKS:
            return None
        cov: Float = np.asarray(np.linalg.inv(self._with_prior(A, prior)), dtype=np.float64)
        wide: Float = np.asarray(np.linalg.inv(self._with_prior(A / CAUTION**2, prior)), dtype=np.float64)
        return self._accepted(cov, wide, rms)

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
        self.count = int(good.sum())
        if self.count < MIN_TRACKS:
            # Hardly any point has parallax: a camera that hardly moves.
            return np.zeros((12, 12)), np.zeros(12), np.inf, np.inf
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
        return A, b, float(np.sum(flat**2)), float(np.sqrt(np.sum(flat**2) / (2 * seen)))

    def _accepted(self, cov: Float, wide: Float, rms: float) -> _Start | None:
        sigma = np.sqrt(np.maximum(np.diag(cov), 0.0))
        plausible = (
            self.count >= MIN_TRACKS
            and rms < MAX_RESIDUAL
            and bool(np.all(sigma[self.SV] < MAX_SIGMA_V))
            and bool(np.all(sigma[self.SG] < MAX_SIGMA_TILT))
            and float(np.linalg.norm(self.bias_g)) < MAX_BIAS_G
            and float(np.linalg.norm(self.bias_a)) < MAX_BIAS_A
        )
        return _Start(self.v, self.g, self.bias_g, self.bias_a, wide) if plausible else None


def started(start: _Start, t_ns: int, gravity_m_s2: float) -> State:
    """Return the filter's state of a start; its covariance is widened, as its frames are used once more."""
    R_WI = upright(-start.g)
    state = State(t_ns, R_WI, np.zeros(3), R_WI @ start.v, start.bias_g, start.bias_a, np.zeros((CORE, CORE)))
    # g_I true = Exp(d) g_I; R_WI true = R_WI Exp(theta) with theta = -d for the part normal to g. v_W = R_WI v_I.
    M = np.zeros((CORE, 12))
    normal = np.eye(3) - np.outer(start.g, start.g) / gravity_m_s2**2
    M[THETA, 3:6] = -normal
    M[V, :3] = R_WI
    M[V, 3:6] = R_WI @ so3.hat(start.v) @ normal
    M[BIAS_G, 6:9] = M[BIAS_A, 9:12] = np.eye(3)
    cov = M @ start.cov @ M.T
    cov[THETA, THETA] += np.eye(3) * 1e-8
    cov[P, P] += np.eye(3) * 1e-10
    state.cov = 0.5 * (cov + cov.T)
    return state
