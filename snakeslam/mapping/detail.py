"""The order in which a chunk's points are drawn: any prefix of it is the whole chunk at a coarser resolution."""

import numpy as np
from numpy.typing import NDArray

from snakeslam.messages import Float

CELLS_M = (0.64, 0.32, 0.16, 0.08, 0.04)
"""Side of a voxel at each level of detail, coarse to fine; all remaining points are the last level."""
PRIMES = np.array([73856093, 19349663, 83492791], dtype=np.int64)
"""Factors of a spatial hash [Teschner03]."""
HASH_FACTOR = 2654435761
"""Knuth's multiplicative hash, 2^32 over the golden ratio: it spreads neighbouring voxels."""


def coarse_to_fine(points: Float) -> NDArray[np.int64]:
    """Return a permutation (N,) of ``points`` (N, 3) m: first one point of each coarse voxel, then of each finer one.

    Within a level the order is that of a hash of the voxel, so that a part of a level is spread over the whole chunk.
    The same points give the same order.
    """
    level = np.full(len(points), len(CELLS_M), dtype=np.int64)
    for k in reversed(range(len(CELLS_M))):
        _, first = np.unique(np.floor(points / CELLS_M[k]).astype(np.int64), axis=0, return_index=True)
        level[first] = k
    voxels = np.floor(points / CELLS_M[-1]).astype(np.int64)
    scatter = np.bitwise_xor.reduce(voxels * PRIMES, axis=1) * HASH_FACTOR % 2**32
    return np.lexsort((scatter, level))
