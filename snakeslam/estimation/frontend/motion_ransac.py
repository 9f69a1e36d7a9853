"""Outlier rejection between two images: a RANSAC in which the gyro fixes the rotation, so that two features suffice.

Where the gyro cannot be trusted, the rotation is found too, by five features and an essential matrix.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from snakeslam.geometry import so3
from snakeslam.geometry.compiled import compiled
from snakeslam.geometry.median import median
from snakeslam.messages import Float

ITERATIONS = 64
"""Pairs drawn. With half of the features outliers, one of 64 pairs is free of them with 1 - 0.75^64 = 1 - 1e-8."""
FEWEST = 8
"""With fewer features nothing is rejected: they cannot outvote each other."""
MIN_NORM = 1e-9
"""A smaller cross product has no direction: both features are the same, or do not move."""


def two_point_inliers(
    xy0: Float, xy1: Float, R_C1C0: Float, limit: float, rng: np.random.Generator
) -> tuple[NDArray[np.bool_], float | None]:
    """Return which motions (N,) agree with one translation, and the median motion that the rotation does not explain.

    ``xy0``, ``xy1`` (N, 2) are normalised, as is ``limit``, the largest distance of x1 from its epipolar line. With the
    rotation R known, the epipolar constraint is t . n_i = 0, n_i = (R x0_i) x x1_i: two features fix the direction of
    the translation, t = n_i x n_j [Troiani14].
    """
    n = len(xy0)
    if n < FEWEST:
        return np.ones(n, bool), None
    # Motion without the rotation: x1 - R x0, and the normals n_i = (R x0_i) x (x1_i, y1_i, 1).
    rotated = np.hstack([xy0, np.ones((n, 1))]) @ R_C1C0.T
    parallax = rotated[:, :2] / rotated[:, 2:] - xy1
    moved = np.hypot(parallax[:, 0], parallax[:, 1])
    (ax, ay, az), (x, y) = rotated.T, xy1.T
    normals = np.column_stack([ay - az * y, az * x - ax, ax * y - ay * x])
    # Candidates for the direction of the translation from random pairs.
    first, second = rng.integers(0, n, ITERATIONS), rng.integers(0, n, ITERATIONS)
    t = so3.cross(normals[first], normals[second])
    length = np.linalg.norm(t, axis=-1)
    t = t[length > MIN_NORM] / length[length > MIN_NORM, None]
    if not len(t):
        return np.ones(n, bool), median(moved)
    # A feature that moved by less than the limit fits any direction.
    good = _largest_consensus(t, normals, rotated, limit, moved < limit)
    return good, median(moved[good]) if good.any() else None


def essential_inliers(xy0: Float, xy1: Float, limit: float) -> NDArray[np.bool_]:
    """Return which motions (N,) agree with one essential matrix, x1^T E x0 = 0, with unknown rotation [Nister04].

    ``xy0``, ``xy1`` (N, 2) are normalised, as is ``limit``, the largest distance of a feature from its epipolar line.
    """
    if len(xy0) < FEWEST:
        return np.ones(len(xy0), bool)
    _, inliers = cv2.findEssentialMat(xy0, xy1, np.eye(3), method=cv2.RANSAC, prob=0.999, threshold=limit)
    # Without a result OpenCV returns None, which its type stubs do not say.
    return np.asarray(inliers).ravel().astype(bool) if np.size(inliers) == len(xy0) else np.ones(len(xy0), bool)


@compiled
def _largest_consensus(
    t: Float, normals: Float, rotated: Float, limit: float, near: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return the inliers (N,) of that direction of ``t`` (K, 3) which has most of them.

    The epipolar line of x0 is l = t x (R x0); the distance of x1 from it is |t . n| / |l_xy|.
    """
    best, most = near.copy(), -1
    agree = near.copy()
    for k in range(len(t)):
        a, b, c = t[k, 0], t[k, 1], t[k, 2]
        count = 0
        for i in range(len(normals)):
            x, y, z = rotated[i, 0], rotated[i, 1], rotated[i, 2]
            line_norm = np.sqrt((b * z - c * y) ** 2 + (c * x - a * z) ** 2)
            residual = abs(a * normals[i, 0] + b * normals[i, 1] + c * normals[i, 2])
            agree[i] = near[i] or residual < limit * max(line_norm, 1e-9)
            count += agree[i]
        if count > most:
            most = count
            best[:] = agree
    return best
