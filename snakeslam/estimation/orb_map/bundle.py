"""Local bundle adjustment: poses of keyframes and points of the map that fit all their observations best.

Residuals and right perturbation are those of ``pnp``; dr/dp_W = -W dh/dq R_WC^T. Points are eliminated by the Schur
complement [Triggs00]: with V = J_p^T J_p and W = J_c^T J_p,

    S = U - W V^-1 W^T,   step_c = -S^-1 (b_c - W V^-1 b_p),   step_p = -V^-1 (b_p + W^T step_c).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.orb_map.pnp import MIN_Z_M, agreeing, huber
from snakeslam.geometry import se3, so3
from snakeslam.messages import Float

DAMPING = 1e-3
"""First damping of Levenberg-Marquardt, as a share of the diagonal."""
MIN_DAMPING = 1e-9
DAMPING_FACTOR = 10.0


@dataclass(frozen=True, slots=True)
class Bundle:
    """Poses ``Ts_WK`` (K, 4, 4), of which the first ``free`` are adjusted, points (P, 3), and N observations.

    Observation n is of point ``point[n]`` from keyframe ``keyframe[n]``, ``xyz`` (N, 3) with 1/sigma ``weights`` (N,
    3).
    """

    Ts_WK: Float
    free: int
    points_W: Float
    keyframe: NDArray[np.int64]
    point: NDArray[np.int64]
    xyz: Float
    weights: Float


@dataclass(frozen=True, slots=True)
class AdjustedBundle:
    """The adjusted poses and points, information of the points (P, 3, 3), and which observations are inliers (N,)."""

    Ts_WK: Float
    points_W: Float
    information: Float
    inliers: NDArray[np.bool_]


def adjust(bundle: Bundle, iterations: int) -> AdjustedBundle:
    """Return the bundle after ``iterations`` of Levenberg-Marquardt with Huber's weights; steps that raise the cost are
    undone."""
    Ts, points = bundle.Ts_WK.copy(), bundle.points_W.copy()
    damping = DAMPING
    r = _residuals(bundle, Ts, points)
    cost = _cost(r)
    information = np.zeros((len(points), 3, 3))
    for _ in range(iterations):
        step_c, step_p, information = _step(bundle, Ts, points, r, damping)
        Ts_new = Ts.copy()
        Ts_new[: bundle.free] = Ts[: bundle.free] @ se3.exp(step_c)
        points_new = points + step_p
        r_new = _residuals(bundle, Ts_new, points_new)
        cost_new = _cost(r_new)
        if not cost_new <= cost:
            damping *= DAMPING_FACTOR
            continue
        Ts, points, r, cost = Ts_new, points_new, r_new, cost_new
        damping = max(damping / DAMPING_FACTOR, MIN_DAMPING)
    return AdjustedBundle(Ts, points, information, agreeing(r))


def _in_camera(bundle: Bundle, Ts: Float, points: Float) -> Float:
    """Return q = R_WC^T (p_W - p_WC) of every observation, (N, 3)."""
    T = Ts[bundle.keyframe]
    moved = (points[bundle.point] - T[:, :3, 3])[:, None, :]
    return (moved @ T[:, :3, :3])[:, 0]


def _residuals(bundle: Bundle, Ts: Float, points: Float) -> Float:
    """Return the whitened residuals measured - h(q), (N, 3)."""
    q = _in_camera(bundle, Ts, points)
    z = np.maximum(q[:, 2:], MIN_Z_M)
    return (bundle.xyz - np.hstack([q[:, :2] / z, q[:, 2:]])) * bundle.weights


def _cost(r: Float) -> float:
    """Return Huber's cost, the sum of w (2 - w) r^2 with the weights w = min(1, h / |r|)."""
    w = huber(r)
    return float(np.sum(w * (2.0 - w) * r**2))


def _step(bundle: Bundle, Ts: Float, points: Float, r: Float, damping: float) -> tuple[Float, Float, Float]:
    """Return the steps of the free poses (F, 6) and of the points (P, 3), and the points' information (P, 3, 3)."""
    # 1. Points: V = J_p^T J_p and b_p = J_p^T r, summed over the observations of each; V^-1 with damping.
    n_free, n_points = bundle.free, len(points)
    J_c, J_p = _jacobians(bundle, Ts, points)
    w = huber(r)
    J_pT = np.swapaxes(J_p * w[..., None], -1, -2)
    V = _sum_by(bundle.point, (J_pT @ J_p).reshape(-1, 9), n_points).reshape(-1, 3, 3)
    b_p = _sum_by(bundle.point, (J_pT @ r[..., None])[..., 0], n_points)
    V_damped = V + (damping * np.trace(V, axis1=1, axis2=2)[:, None, None] + MIN_DAMPING) * np.eye(3)
    V_inv = np.linalg.inv(V_damped)

    # 2. Free poses: U = J_c^T J_c, b_c = J_c^T r, and W = J_c^T J_p.
    free = bundle.keyframe < n_free
    k, p = bundle.keyframe[free], bundle.point[free]
    J_cT = np.swapaxes(J_c[free] * w[free][..., None], -1, -2)
    U = _sum_by(k, (J_cT @ J_c[free]).reshape(-1, 36), n_free).reshape(-1, 6, 6)
    b_c = _sum_by(k, (J_cT @ r[free][..., None])[..., 0], n_free).ravel()
    W = np.zeros((n_points, 3, n_free, 6))
    W[p, :, k] = np.swapaxes(J_cT @ J_p[free], -1, -2)
    W = W.reshape(n_points, 3, n_free * 6)

    # 3. Eliminate the points, solve for the poses, substitute back.
    VW = V_inv @ W
    S = -np.tensordot(W, VW, axes=([0, 1], [0, 1]))
    for j in range(n_free):
        block = slice(6 * j, 6 * j + 6)
        S[block, block] += U[j] + damping * np.diag(np.diag(U[j])) + MIN_DAMPING * np.eye(6)
    step_c = -np.linalg.solve(S, b_c - np.einsum("pij,pi->j", VW, b_p))
    step_p = -(V_inv @ (b_p + W @ step_c)[..., None])[..., 0]
    return np.asarray(step_c.reshape(-1, 6), dtype=np.float64), step_p, V


def _jacobians(bundle: Bundle, Ts: Float, points: Float) -> tuple[Float, Float]:
    """Return dr/d(rho, theta) of the keyframe, (N, 3, 6), and dr/dp_W, (N, 3, 3)."""
    q = _in_camera(bundle, Ts, points)
    z = np.maximum(q[:, 2], MIN_Z_M)
    h_D_q = np.zeros((len(q), 3, 3))
    h_D_q[:, 0, 0] = h_D_q[:, 1, 1] = 1.0 / z
    h_D_q[:, 0, 2], h_D_q[:, 1, 2] = -q[:, 0] / z**2, -q[:, 1] / z**2
    h_D_q[:, 2, 2] = 1.0
    r_D_q = -bundle.weights[..., None] * h_D_q
    r_D_pose = np.concatenate([-r_D_q, r_D_q @ so3.hat(q)], axis=-1)
    return r_D_pose, r_D_q @ np.swapaxes(Ts[bundle.keyframe][:, :3, :3], -1, -2)


def _sum_by(index: NDArray[np.int64], values: Float, count: int) -> Float:
    """Return the sums of those rows of ``values`` (N, m) that have the same index, (count, m)."""
    sums = [np.bincount(index, column, minlength=count) for column in values.T]
    return np.stack(sums, axis=-1).astype(np.float64)
