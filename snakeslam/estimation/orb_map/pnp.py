"""The camera's pose from observed map points (PnP): robust Gauss-Newton on SE(3), started by RANSAC.

With q = T_WC^-1 p_W and the right perturbation T_WC Exp((rho, theta)): q' = q - rho + [q]x theta. The measurement is
h = (x/z, y/z, z) of q, its last row only where depth is measured.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from snakeslam.geometry import se3, so3
from snakeslam.messages import Float

MIN_Z_M = 0.05
"""Points nearer to the camera, or behind it, are outliers."""
HUBER = 2.0
"""Residuals beyond this many sigmas are weighed down as 1/|r|."""
GATE_XY = 9.21
"""99 % quantile of chi-square with two degrees of freedom."""
GATE_Z = 9.0
"""Square of three sigmas of a depth."""
ROUNDS = 4
"""Rounds of Gauss-Newton, each on the inliers of the one before."""
STEPS_PER_ROUND = 3
CONVERGED = 1e-6
"""Largest component of a step, m or rad, at which Gauss-Newton ends."""
DAMPING = 1e-6
MIN_POINTS = 4
INDEPENDENT = 30
"""Errors of observations in one image are correlated (lens, shutter, depth): more than so many add no information."""
BEHIND = 1e3
"""Residual, in sigmas, of a point behind the camera: far beyond every gate."""
RANSAC_ITERATIONS = 200
RANSAC_CONFIDENCE = 0.999


@dataclass(frozen=True, slots=True)
class PointObservations:
    """Map points ``points_W`` (N, 3) m observed at ``xyz`` (N, 3) = (x/z, y/z, z in m); ``weights`` 1/sigma or 0."""

    points_W: Float
    xyz: Float
    weights: Float

    def pick(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> "PointObservations":
        """Return the ``chosen`` observations."""
        return PointObservations(self.points_W[chosen], self.xyz[chosen], self.weights[chosen])


@dataclass(frozen=True, slots=True)
class PoseFit:
    """``T_WC`` (4, 4), ``cov`` (6, 6) of its right perturbation (rho, theta), and the inliers (N,)."""

    T_WC: Float
    cov: Float
    inliers: NDArray[np.bool_]


def residuals(T_WC: Float, seen: PointObservations) -> Float:
    """Return the whitened residuals measured - h(q), (N, 3); those of points behind the camera are BEHIND."""
    q = se3.act(se3.inv(T_WC), seen.points_W)
    z = np.maximum(q[:, 2], MIN_Z_M)
    predicted = np.stack([q[:, 0] / z, q[:, 1] / z, q[:, 2]], axis=-1)
    r = (seen.xyz - predicted) * seen.weights
    r[q[:, 2] < MIN_Z_M] = BEHIND
    return r


def jacobian(T_WC: Float, seen: PointObservations) -> Float:
    """Return dr/d(rho, theta), (N, 3, 6): -W dh/dq (-I, [q]x), dh/dq = [1/z 0 -x/z^2; 0 1/z -y/z^2; 0 0 1]."""
    q = se3.act(se3.inv(T_WC), seen.points_W)
    z = np.maximum(q[:, 2], MIN_Z_M)
    h_D_q = np.zeros((len(q), 3, 3))
    h_D_q[:, 0, 0] = h_D_q[:, 1, 1] = 1.0 / z
    h_D_q[:, 0, 2], h_D_q[:, 1, 2] = -q[:, 0] / z**2, -q[:, 1] / z**2
    h_D_q[:, 2, 2] = 1.0
    q_D_pose = np.concatenate([np.broadcast_to(-np.eye(3), (len(q), 3, 3)), so3.hat(q)], axis=-1)
    return -seen.weights[..., None] * (h_D_q @ q_D_pose)


def refine_pose(T_WC: Float, seen: PointObservations) -> PoseFit | None:
    """Return the robust least-squares pose near ``T_WC``; None with fewer than MIN_POINTS inliers.

    Each round is Gauss-Newton with Huber's weights, on the inliers of the round before.
    """
    inliers = np.ones(len(seen.xyz), bool)
    information = np.eye(6)
    for _ in range(ROUNDS):
        if inliers.sum() < MIN_POINTS:
            return None
        chosen = seen.pick(inliers)
        information = np.eye(6)
        for _ in range(STEPS_PER_ROUND):
            # J^T W J step = -J^T W r,  T_WC <- T_WC Exp(step).
            r, J = residuals(T_WC, chosen), jacobian(T_WC, chosen)
            Jw = J * huber(r)[..., None]
            information = np.einsum("nij,nik->jk", Jw, J)
            step = -np.linalg.solve(information + DAMPING * np.eye(6), np.einsum("nij,ni->j", Jw, r))
            T_WC = T_WC @ se3.exp(step)
            if np.max(np.abs(step)) < CONVERGED:
                break
        before, inliers = inliers, agreeing(residuals(T_WC, seen))
        if np.array_equal(inliers, before):
            break
    if inliers.sum() < MIN_POINTS or not np.all(np.isfinite(T_WC)):
        return None
    # Inverse of the information, as if of at most INDEPENDENT observations.
    cov = np.linalg.inv(information + DAMPING * np.eye(6)) * max(1.0, inliers.sum() / INDEPENDENT)
    return PoseFit(T_WC, np.asarray(cov, dtype=np.float64), inliers)


def agreeing(r: Float) -> NDArray[np.bool_]:
    """Return which whitened residuals (N, 3) pass the chi-square gates of image position and depth, (N,)."""
    return np.asarray((np.sum(r[:, :2] ** 2, axis=-1) < GATE_XY) & (r[:, 2] ** 2 < GATE_Z))


def huber(r: Float) -> Float:
    """Return Huber's weights min(1, h / |r|) of residuals (N, 3): one for the image position, one for the depth."""
    xy = np.linalg.norm(r[:, :2], axis=-1)
    z = np.abs(r[:, 2])
    w_xy = HUBER / np.maximum(xy, HUBER)
    w_z = HUBER / np.maximum(z, HUBER)
    return np.stack([w_xy, w_xy, w_z], axis=-1)


def ransac_pose(seen: PointObservations, focal_px: float, threshold_px: float, seed: int) -> Float | None:
    """Return T_WC by RANSAC over samples of three points, or None; the same seed gives the same pose."""
    if len(seen.xyz) < MIN_POINTS:
        return None
    parameters = cv2.UsacParams()
    parameters.randomGeneratorState = seed
    parameters.confidence = RANSAC_CONFIDENCE
    parameters.maxIterations = RANSAC_ITERATIONS
    parameters.threshold = threshold_px
    parameters.score = cv2.SCORE_METHOD_MSAC
    parameters.sampler = cv2.SAMPLING_UNIFORM
    parameters.loMethod = cv2.LOCAL_OPTIM_INNER_LO
    parameters.final_polisher = cv2.NONE_POLISHER
    K = np.diag([focal_px, focal_px, 1.0])
    try:
        found, _, rvec, tvec, _ = cv2.solvePnPRansac(
            np.ascontiguousarray(seen.points_W),
            np.ascontiguousarray(seen.xyz[:, :2] * focal_px),
            K,
            None,
            params=parameters,
        )
    except cv2.error:
        return None
    if not found:
        return None
    w, t = (np.ravel(np.asarray(vector, dtype=np.float64)) for vector in (rvec, tvec))
    if not np.all(np.isfinite(w)) or not np.all(np.isfinite(t)):
        return None
    T_CW = se3.from_rt(so3.exp(w), t)
    return se3.inv(T_CW)
