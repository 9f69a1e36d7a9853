"""Gyro bias, velocity and gravity of a moving head in closed form, from a few frames and without any initial value."""

import numpy as np
from scipy.optimize import brentq, minimize

from snakeslam.estimation.filter.preintegration import Preintegrated
from snakeslam.estimation.start.window import StartWindow
from snakeslam.messages import Float

MAX_BIAS_ITERATIONS = 40
"""About ten are usual; a gyro that contradicts the image would keep the search going."""
BIAS_WEIGHT = 1e-6
"""Weight of |b_g|^2 beside the epipolar error, which fixes the bias where the images determine only a part of it."""
DEPTH_WEIGHT = 0.3
"""Weight of a measured depth against that of the direction of its ray."""
POINT_PRIOR = 1e-9
"""Added to the normal matrix of a point, which parallel rays leave singular."""
MAX_CONDITION = 1e12
"""With a larger condition number the frames leave the velocity undetermined."""


def gyro_bias(window: StartWindow) -> Float:
    """Return the gyro's bias (3,) rad/s for which the epipolar planes of frame pairs meet best [Kneip13].

    Rays d_a and d_b of a point in two frames span a plane with the normal n = (R_a d_a) x (R_b d_b). All normals of a
    pair are orthogonal to its translation, so the least eigenvalue of sum n n^T is zero for the right rotations:

        min_b sum_pairs lambda_min(sum n n^T) + 1e-6 |b|^2,   R_k = gamma_k Exp(J_gamma b).
    """
    n = len(window.t_s)
    stride = max(1, n // 4)
    pairs = [(k, min(k + stride, n - 1)) for k in range(0, n - stride, max(1, stride // 2))]
    rays = np.concatenate([window.observed.xyz[..., :2], np.ones((*window.observed.seen.shape, 1))], axis=-1)
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True) @ window.camera.R_IC.T
    in_both = [window.observed.seen[:, a] & window.observed.seen[:, b] for a, b in pairs]
    pre = window.motions(np.zeros(3), np.zeros(3))

    def rotation(k: int, bias: Float) -> Float:
        return np.eye(3) if k == 0 else pre[k - 1].corrected(bias, np.zeros(3))[2]

    def cost(bias: Float) -> float:
        total = float(bias @ bias) * BIAS_WEIGHT
        for (a, b), seen in zip(pairs, in_both, strict=True):
            normals = np.cross(rays[seen, a] @ rotation(a, bias).T, rays[seen, b] @ rotation(b, bias).T)
            total += float(np.linalg.eigvalsh(normals.T @ normals)[0])
        return total

    found = minimize(cost, np.zeros(3), method="BFGS", options={"gtol": 1e-9, "maxiter": MAX_BIAS_ITERATIONS})
    return np.asarray(found.x)


def velocity_and_gravity(window: StartWindow, pre: list[Preintegrated]) -> tuple[Float, Float] | None:
    """Return v (3,) m/s and g (3,) m/s^2 at the first frame, in its IMU frame; None if undetermined [Martinelli14].

    A ray d of frame j with rotation R_j observes its point P, with d in the first IMU frame:

        (I - d d^T) (P - v t_j - g t_j^2 / 2 - alpha_j - R_j p_IC) = 0,

    and a measured depth gives the row along d. That is linear in P, v and g. The points are eliminated (Schur
    complement), then v; the known norm of g enters by a Lagrange multiplier.
    """
    # 1. Rays d and camera positions without v and g, in the first IMU frame; W weighs what is across a ray, and along.
    R_j = np.stack([np.eye(3), *(p.gamma for p in pre)])
    alpha = np.stack([np.zeros(3), *(p.alpha for p in pre)])
    rays = np.concatenate([window.observed.xyz[..., :2], np.ones((*window.observed.seen.shape, 1))], axis=-1)
    length = np.linalg.norm(rays, axis=-1, keepdims=True)
    d = np.einsum("nij,mnj->mni", R_j @ window.camera.R_IC, rays / length)
    origin = alpha + R_j @ window.camera.p_IC
    z = window.observed.xyz[..., 2]
    along = (window.camera.usable_depth(z) & window.observed.seen) * DEPTH_WEIGHT
    W = (np.eye(3) - d[..., :, None] * d[..., None, :]) * window.observed.seen[..., None, None]
    W = W + along[..., None, None] * d[..., :, None] * d[..., None, :]
    lifted = origin[None] + d * (z * length[..., 0] * (along > 0))[..., None]

    # 2. Normal equations of P - B x = lifted, weighted by W, with x = (v, g) and B = (t I, t^2 / 2 I).
    t = window.t_s
    B = np.concatenate([t[:, None, None] * np.eye(3), 0.5 * t[:, None, None] ** 2 * np.eye(3)], axis=-1)
    A_pp = W.sum(axis=1) + POINT_PRIOR * np.eye(3)
    A_px = -np.einsum("mnij,njk->mik", W, B)
    A_xx = np.einsum("nki,mnkl,nlj->ij", B, W, B, optimize=True)
    b_p = np.einsum("mnij,mnj->mi", W, lifted)
    b_x = -np.einsum("nki,mnkl,mnl->i", B, W, lifted, optimize=True)

    # 3. Eliminate the points: A = A_xx - A_xp A_pp^-1 A_px, b = b_x - A_xp A_pp^-1 b_p.
    A_xp_A_pp_inv = np.swapaxes(A_px, 1, 2) @ np.linalg.inv(A_pp)
    A = A_xx - np.einsum("mik,mkj->ij", A_xp_A_pp_inv, A_px)
    b = b_x - np.einsum("mik,mk->i", A_xp_A_pp_inv, b_p)
    if np.linalg.cond(A[:3, :3]) > MAX_CONDITION:
        return None

    # 4. Eliminate v, solve for g with |g| known, then for v.
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
        # b has no component along the least eigenvector: the solution moves along it to the sphere.
        x = c / (values + low)
        x[0] += np.copysign(np.sqrt(max(radius**2 - float(x @ x) + x[0] ** 2, 0.0)) - abs(x[0]), x[0] or 1.0)
        return vectors @ x
    return vectors @ (c / (values + float(brentq(excess, low, high))))
