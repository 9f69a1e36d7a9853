"""The depth of a feature: the median of the pixels around it, if they belong to one surface."""

import numpy as np
from numpy.typing import NDArray

from snakeslam.geometry.compiled import compiled
from snakeslam.messages import Float

SPREAD, SPREAD_PER_M = 0.02, 0.02
"""Largest difference of nine neighbouring depths on one surface, (0.02 + 0.02 z / m) z: it grows as z^2, as the noise
of a depth camera does."""


def sample_depth(depth_m: NDArray[np.float32] | None, px: NDArray[np.float32]) -> Float:
    """Return the depth at pixels (N, 2) in m, (N,); 0 where it is unknown or the 3x3 neighbourhood holds an edge."""
    if depth_m is None or not len(px):
        return np.zeros(len(px))
    return _median_depth(depth_m, np.rint(px).astype(np.int64))


@compiled
def _median_depth(depth_m: NDArray[np.float32], px: NDArray[np.int64]) -> Float:
    """Return the median of the 3x3 depths around each pixel, 0 where one is unknown or they differ too much."""
    height, width = depth_m.shape
    out = np.zeros(len(px))
    around = np.empty(9)
    for k in range(len(px)):
        n = 0
        for i in range(px[k, 1] - 1, px[k, 1] + 2):
            for j in range(px[k, 0] - 1, px[k, 0] + 2):
                # At the border the outermost pixel stands for its missing neighbour.
                around[n] = depth_m[min(max(i, 0), height - 1), min(max(j, 0), width - 1)]
                n += 1
        if not np.all(np.isfinite(around)) or around.min() <= 0.0:
            continue
        middle = np.median(around)
        if around.max() - around.min() <= SPREAD * middle + SPREAD_PER_M * middle**2:
            out[k] = middle
    return out
