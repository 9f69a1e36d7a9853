"""Refinement of a start in motion: Gauss-Newton on the reprojection errors of all frames, as in bundle adjustment.

The unknowns are x = (v, tilt of g, b_g, b_a) at the first frame, 12 of them, and all points. The poses of the later
frames follow from x by pre-integration, Eq. (25), in the IMU frame of the first:

    R_k = gamma_k,   p_k = v t_k + g t_k^2 / 2 + alpha_k
"""

from dataclasses import dataclass

import numpy as np

from snakeslam.estimation.filter.preintegration import ALPHA, GAMMA, Preintegrated
from snakeslam.estimation.measurements.camera import Poses, jacobians, residuals, robust_scale
from snakeslam.estimation.measurements.triangulation import triangulate
from snakeslam.estimation.start.stationary import SIGMA_BIAS_A
from snakeslam.estimation.start.window import StartWindow
from snakeslam.geometry import so3
from snakeslam.messages import Float

MIN_TRACKS = 20
"""Fewer points with parallax than this do not determine the twelve unknowns."""
MAX_ITERATIONS = 10
RELINEARISE = 3
"""After so many iterations the IMU is integrated again with the new biases; between them to first order."""
CONVERGED = 1e-4
"""Relative change of the cost at which the iteration ends."""
DAMPING = 1e-4
"""Levenberg-Marquardt damping, as a share of the diagonal."""
GYRO_BIAS_INFORMATION = 4.0
"""Prior information on the gyro's bias, (rad/s)^-2: a sigma of 0.5 rad/s, next to none."""
YAW_WEIGHT = 1e4
"""Root of the prior information on a rotation of g about itself, which has no effect and is held at zero."""
POINT_PRIOR = 1e-9
V, TILT, BIAS_G, BIAS_A = (slice(3 * k, 3 * k + 3) for k in range(4))
SIZE = 12


@dataclass(frozen=True, slots=True)
class Refined:
    """The refined unknowns; the normal matrix ``A`` (12, 12) of the images, ``prior`` (12,); number and RMS of points.

    The tilt is a rotation vector d orthogonal to g: g_true = Exp(d) g. ``rms`` is that of the whitened residuals.
    """

    v: Float
    g: Float
    bias_g: Float
    bias_a: Float
    A: Float
    prior: Float
    count: int
    rms: float

    def cov(self, inflation: float = 1.0) -> Float:
        """Return the covariance (12, 12) of x with the information of the images divided by ``inflation``."""
        return np.asarray(np.linalg.inv(_with_prior(self.A / inflation, self.prior, self.g)), dtype=np.float64)


def refine(window: StartWindow, bias_g: Float, v: Float, g: Float) -> Refined | None:
    """Return the refined start from initial values in the first IMU frame; None where too few points have parallax."""
    prior, bias_a = np.zeros(SIZE), np.zeros(3)
    prior[BIAS_G], prior[BIAS_A] = GYRO_BIAS_INFORMATION, SIGMA_BIAS_A**-2
    pre = window.motions(bias_g, bias_a)
    normal = _normal_equations(window, pre, v, g, bias_g, bias_a)
    for iteration in range(1, MAX_ITERATIONS):
        if normal.count < MIN_TRACKS:
            return None

        # 1. Step of Gauss-Newton: (A + prior + damping) dx = b - prior x. Only b_a is drawn to its prior mean, 0.
        pull = np.concatenate([np.zeros(9), prior[BIAS_A] * bias_a])
        damping = np.diag(np.diag(normal.A)) * DAMPING
        H = _with_prior(normal.A, prior, g) + damping
        step: Float = np.asarray(np.linalg.solve(H, normal.b - pull), dtype=np.float64)
        if not np.all(np.isfinite(step)):
            return None

        # 2. x <- x [+] dx; g keeps its norm.
        v, g = v + step[V], so3.exp(step[TILT]) @ g
        bias_g, bias_a = bias_g + step[BIAS_G], bias_a + step[BIAS_A]

        # 3. Linearise anew, until the cost no longer changes.
        if iteration % RELINEARISE == 0:
            pre = window.motions(bias_g, bias_a)
        cost_before = normal.cost
        normal = _normal_equations(window, pre, v, g, bias_g, bias_a)
        change = abs(cost_before - normal.cost)
        if change < CONVERGED * max(normal.cost, CONVERGED) and iteration > RELINEARISE:
            break
    if normal.count < MIN_TRACKS:
        return None
    return Refined(v, g, bias_g, bias_a, normal.A, prior, normal.count, normal.rms)


def _with_prior(A: Float, prior: Float, g: Float) -> Float:
    """Return the information with the priors, and with a rotation of g about itself held at zero."""
    about_g = np.zeros(SIZE)
    about_g[TILT] = g / np.linalg.norm(g) * YAW_WEIGHT
    return A + np.diag(prior) + np.outer(about_g, about_g)


@dataclass(frozen=True, slots=True)
class _NormalEquations:
    """A dx = b (12, 12), the cost r^T r, and number and RMS of the points."""

    A: Float
    b: Float
    cost: float
    rms: float
    count: int


def _normal_equations(
    window: StartWindow, pre: list[Preintegrated], v: Float, g: Float, bias_g: Float, bias_a: Float
) -> _NormalEquations:
    """Return the normal equations at x, with all points triangulated there and eliminated."""
    # 1. Poses in the first IMU frame, and their Jacobian d(theta, p)/dx.
    n = len(pre) + 1
    R, p = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3))
    r_pose_x = np.zeros((n, 6, SIZE))
    for k, motion in enumerate(pre, start=1):
        alpha, _, R[k] = motion.corrected(bias_g, bias_a)
        t = motion.dt_s
        p[k] = v * t + 0.5 * g * t**2 + alpha
        r_pose_x[k, :3, BIAS_G] = motion.J[GAMMA, :3]
        r_pose_x[k, 3:, V] = np.eye(3) * t
        r_pose_x[k, 3:, TILT] = -0.5 * t**2 * so3.hat(g)
        r_pose_x[k, 3:, 6:] = motion.J[ALPHA]

    # 2. Points. A camera that hardly moves gives hardly any of them parallax.
    poses = Poses(R, p)
    points, good = triangulate(poses, window.observed, window.camera)
    count = int(good.sum())
    if count < MIN_TRACKS:
        return _NormalEquations(np.zeros((SIZE, SIZE)), np.zeros(SIZE), np.inf, np.inf, count)
    observed, points = window.observed.pick(good), points[good]

    # 3. Whitened residuals and Jacobians with Huber's weights; by x through the poses, Hx = dh/dpose dpose/dx.
    r = residuals(points, poses, observed, window.camera)
    scale = robust_scale(r)
    Hx, Hf = jacobians(points, poses, observed, window.camera)
    Hx = np.einsum("mnki,nij->mnkj", Hx, r_pose_x) * scale[..., None]
    Hf, r = Hf * scale[..., None], r * scale
    Hx, Hf, flat = Hx.reshape(count, -1, SIZE), Hf.reshape(count, -1, 3), r.reshape(count, -1)

    # 4. Eliminate the points: A = Hx^T Hx - Hx^T Hf (Hf^T Hf)^-1 Hf^T Hx, b alike.
    cross = np.swapaxes(Hx, 1, 2) @ Hf
    cross_A_inv = cross @ np.linalg.inv(np.swapaxes(Hf, 1, 2) @ Hf + POINT_PRIOR * np.eye(3))
    g_f = np.einsum("mki,mk->mi", Hf, flat)
    A = np.einsum("mki,mkj->ij", Hx, Hx) - np.einsum("mij,mkj->ik", cross_A_inv, cross)
    b = np.einsum("mki,mk->i", Hx, flat) - np.einsum("mij,mj->i", cross_A_inv, g_f)
    cost, seen = float(np.sum(flat**2)), max(1, int(observed.seen.sum()))
    return _NormalEquations(A, b, cost, float(np.sqrt(np.sum(flat**2) / (2 * seen))), count)
