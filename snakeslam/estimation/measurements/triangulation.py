"""Triangulation: points from their observations, with the poses of the window taken as exact."""

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.measurements.camera import (
    Observations,
    Poses,
    ReprojectionModel,
    point_jacobians,
    points_in_camera,
    residuals_in_camera,
    robust_scale,
)
from snakeslam.geometry.median import median
from snakeslam.messages import Float

ITERATIONS = 4
TINY = 1e-9
"""Keeps divisions and factorisations of empty sums finite."""
CONVERGED = 1e-2
"""Relative change of every point's cost at which the iteration ends."""
MAX_RELATIVE_SIGMA = 0.1
"""Largest sigma of a point, as a share of its distance, with which it may be used."""
MIN_Z_M = 0.1
"""A point nearer than this to a camera that observes it is an error."""
NEAR_M = 0.3
"""Nearer points may have the sigma of one at this distance."""
RAY_PRIOR = 1e-6
"""Added to the normal matrix of parallel rays, whose intersection is at infinity."""


def triangulate(poses: Poses, observed: Observations, camera: ReprojectionModel) -> tuple[Float, NDArray[np.bool_]]:
    """Return points (M, 3) in W and which of them are well determined.

    It starts from the mean of the measured depths or, without any, from the point nearest to all rays; then
    Levenberg-Marquardt on the whitened residuals, (A + mu diag A) step = g, all points at once.
    """
    points = _start(poses, observed, camera)
    damping = np.full(len(points), 1e-3)
    A, g, cost = _normal_equations(points, poses, observed, camera)
    diagonal = np.arange(3)
    for _ in range(ITERATIONS):
        damped = A.copy()
        damped[:, diagonal, diagonal] += damping[:, None] * (A[:, diagonal, diagonal] + TINY)
        # Step (A + mu diag A)^-1 g of every point.
        trial: Float = np.asarray(points + np.linalg.solve(damped, g[..., None])[..., 0], dtype=np.float64)
        A_trial, g_trial, trial_cost = _normal_equations(trial, poses, observed, camera)
        # Accept it for the points whose cost falls; mu <- mu / 10 for these, 10 mu for the others.
        better = trial_cost <= cost
        settled = bool(np.all(np.abs(cost - trial_cost) <= CONVERGED * (cost + CONVERGED)))
        points = np.where(better[:, None], trial, points)
        A, g = np.where(better[:, None, None], A_trial, A), np.where(better[:, None], g_trial, g)
        cost = np.where(better, trial_cost, cost)
        damping = np.where(better, damping * 0.1, damping * 10.0)
        if settled:
            break
    return points, _well_determined(points, A, poses, observed, camera)


def _start(poses: Poses, observed: Observations, camera: ReprojectionModel) -> Float:
    """Return the weighted mean of p_WC + z R_WC (x, y, 1) over the measured depths, else the point nearest the rays."""

    R_WC = poses.R_WI @ camera.R_IC
    p_WC = poses.p_WI + poses.R_WI @ camera.p_IC
    rays = np.concatenate([observed.xyz[..., :2], np.ones((*observed.seen.shape, 1))], axis=-1)
    rays_W = np.einsum("nij,mnj->mni", R_WC, rays)
    # Mean over the depths with weights 1 / sigma_z^2; points without a depth start nearest to their rays.
    weight = observed.weight[..., 2] ** 2
    total = weight.sum(axis=1)
    lifted = p_WC[None] + rays_W * observed.xyz[..., 2:]
    from_depth = np.einsum("mn,mni->mi", weight, lifted) / np.maximum(total, TINY)[:, None]
    without = np.flatnonzero(total == 0.0)
    from_depth[without] = _nearest_to_rays(rays_W[without], p_WC, observed.seen[without])
    return from_depth


def _nearest_to_rays(rays_W: Float, p_WC: Float, seen: NDArray[np.bool_]) -> Float:
    """Return the points nearest to their rays, in the least-squares sense: sum (I - d d^T)(P - c) = 0."""
    if not len(rays_W):
        return np.empty((0, 3))
    d = rays_W / np.linalg.norm(rays_W, axis=-1, keepdims=True)
    off_ray = (np.eye(3) - d[..., :, None] * d[..., None, :]) * seen[..., None, None]
    A = off_ray.sum(axis=1) + RAY_PRIOR * np.eye(3)
    b = np.einsum("mnij,nj->mi", off_ray, p_WC)
    return np.asarray(np.linalg.solve(A, b[..., None])[..., 0], dtype=np.float64)


def _normal_equations(
    points: Float, poses: Poses, observed: Observations, camera: ReprojectionModel
) -> tuple[Float, Float, Float]:
    """Return A = Hf^T Hf (M, 3, 3), g = Hf^T r (M, 3) and the costs (M,), all with robust weights."""
    p_C = points_in_camera(points, poses, camera)
    r = residuals_in_camera(p_C, observed)
    scale = robust_scale(r)
    Hf = (point_jacobians(p_C, poses, observed, camera) * scale[..., None]).reshape(len(points), -1, 3)
    flat = (r * scale).reshape(len(points), -1)
    Hf_T = np.swapaxes(Hf, 1, 2)
    return Hf_T @ Hf, (Hf_T @ flat[..., None])[..., 0], np.sum(flat * flat, axis=1)


def _well_determined(
    points: Float, A: Float, poses: Poses, observed: Observations, camera: ReprojectionModel
) -> NDArray[np.bool_]:
    """Return which points are in front of all their cameras and precise enough for their distance.

    Noise makes some far points appear near, and a near point has a small sigma. Selected by that sigma, such points
    would make the filter overconfident. So the sigma of a point nearer than the median is evaluated at the median
    distance, sigma ~ distance^2.
    """
    p_C = points_in_camera(points, poses, camera)
    # sigma = 1 / sqrt(lambda_min(A)) is that along the worst direction, mostly that of the ray.
    in_front = np.all((p_C[..., 2] > MIN_Z_M) | ~observed.seen, axis=1) & np.all(np.isfinite(points), axis=1)
    weakest = np.maximum(np.linalg.eigvalsh(A)[:, 0], TINY)
    distance = np.linalg.norm(points - poses.p_WI[-1], axis=1)
    usual = median(distance[in_front]) if in_front.any() else 0.0
    sigma = np.maximum(1.0, usual / np.maximum(distance, TINY)) / np.sqrt(weakest)
    return np.asarray(in_front & (sigma < MAX_RELATIVE_SIGMA * np.maximum(distance, NEAR_M)))
