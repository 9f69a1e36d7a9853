"""The depth of a feature: from the pixels about it, where they show one surface."""

import numpy as np
from numpy.typing import NDArray

from snakeslam.geometry.compiled import compiled
from snakeslam.messages import Float

EDGE_PER_M, EDGE_PER_M2 = 0.02, 0.02


def sample_depth(depth_m: NDArray[np.float32] | None, px: NDArray[np.float32]) -> Float:
    """Return the depth at pixels (N,), 0 where it is unknown or its 3x3 surroundings hold an edge."""
    if depth_m is None or not len(px):
        return np.zeros(len(px))
    return _smooth_depth(depth_m, np.rint(px).astype(np.int64))


@compiled
def _smooth_depth(depth_m: NDArray[np.float32], px: NDArray[np.int64]) -> Float:
    """Return the median of 3x3 depths about each pixel, 0 where one is unknown or they differ too much."""
    height, width = depth_m.shape
    out = np.zeros(len(px))
    around = np.empty(9)
    for k in range(len(px)):
        n = 0
        for i in range(px[k, 1] - 1, px[k, 1] + 2):
            for j in range(px[k, 0] - 1, px[k, 0] + 2):
                around[n] = depth_m[min(max(i, 0), height - 1), min(max(j, 0), width - 1)]
                n += 1
        if not np.all(np.isfinite(around)) or around.min() <= 0.0:
            continue
        middle = np.median(around)
        # The allowance grows like the noise of a depth camera does.
        if around.max() - around.min() <= EDGE_PER_M * middle + EDGE_PER_M2 * middle**2:
            out[k] = middle
    return out
