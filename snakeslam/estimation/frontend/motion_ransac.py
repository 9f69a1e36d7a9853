"""Which features move as one: a RANSAC that knows the camera's turn, so that two fix the direction of travel.

Where the gyro cannot be trusted, one that finds the turn as well.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from snakeslam.geometry import so3
from snakeslam.geometry.compiled import compiled
from snakeslam.geometry.median import median
from snakeslam.messages import Float

ROUNDS = 64
FEWEST = 8
NO_LENGTH = 1e-9


def agreeing_motions(
    xy0: Float, xy1: Float, R_C1C0: Float, limit: float, rng: np.random.Generator
) -> tuple[NDArray[np.bool_], float | None]:
    """Return which motions (N,) agree with the turn and one direction of travel, and the median of what is not turn.

    ``xy0``, ``xy1`` (N, 2) are normalised, as ``limit`` is: how far x1 may be from its epipolar line. With the turn
    known, two features fix the direction t: t is normal to n_i = (R x0_i) x x1_i [Troiani14].
    """
    n = len(xy0)
    if n < FEWEST:
        return np.ones(n, bool), None
    turned = np.hstack([xy0, np.ones((n, 1))]) @ R_C1C0.T
    rest = turned[:, :2] / turned[:, 2:] - xy1
    moved = np.hypot(rest[:, 0], rest[:, 1])
    normals = _cross_with_picture(turned, xy1)
    first, second = rng.integers(0, n, ROUNDS), rng.integers(0, n, ROUNDS)
    t = so3.cross(normals[first], normals[second])
    length = np.linalg.norm(t, axis=-1)
    t = t[length > NO_LENGTH] / length[length > NO_LENGTH, None]
    if not len(t):
        return np.ones(n, bool), median(moved)
    # A feature that moved less than the limit fits any direction.
    good = _most_agreeing(t, normals, turned, limit, moved < limit)
    return good, median(moved[good]) if good.any() else None


def rigid_motions(xy0: Float, xy1: Float, limit: float) -> NDArray[np.bool_]:
    """Return which motions (N,) agree with one essential matrix: a rigid scene, the camera's turn not known [Nister04].

    ``xy0``, ``xy1`` (N, 2) are normalised, as ``limit`` is: how far a feature may be from its epipolar line.
    """
    if len(xy0) < FEWEST:
        return np.ones(len(xy0), bool)
    _, inliers = cv2.findEssentialMat(xy0, xy1, np.eye(3), method=cv2.RANSAC, prob=0.999, threshold=limit)
    # Without a result OpenCV returns None, whatever its types say.
    return np.asarray(inliers).ravel().astype(bool) if np.size(inliers) == len(xy0) else np.ones(len(xy0), bool)


def _cross_with_picture(a: Float, xy: Float) -> Float:
    """Return a x (x, y, 1) of rows (N, 3) and (N, 2)."""
    ax, ay, az = a.T
    x, y = xy.T
    return np.column_stack([ay - az * y, az * x - ax, ax * y - ay * x])


@compiled
def _most_agreeing(t: Float, normals: Float, turned: Float, limit: float, near: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the features (N,) that agree with that direction of travel of ``t`` (K, 3) with which most do.

    The line of x0 is t x (R x0): x1 lies on it where t . n is zero.
    """
    best, most = near.copy(), -1
    agree = near.copy()
    for k in range(len(t)):
        a, b, c = t[k, 0], t[k, 1], t[k, 2]
        count = 0
        for i in range(len(normals)):
            x, y, z = turned[i, 0], turned[i, 1], turned[i, 2]
            steepness = np.sqrt((b * z - c * y) ** 2 + (c * x - a * z) ** 2)
            off = abs(a * normals[i, 0] + b * normals[i, 1] + c * normals[i, 2])
            agree[i] = near[i] or off < limit * max(steepness, 1e-9)
            count += agree[i]
        if count > most:
            most = count
            best[:] = agree
    return best
