"""The occupied voxels of a map: it grows with the space that was observed, not with the time spent there."""

import numpy as np
from numpy.typing import NDArray

HALF_SPAN = 2**20
"""Half the number of voxels along each axis: a key has 21 bits for each, with the origin in the middle."""


class Voxels:
    """The occupied voxels of side ``size_m`` as sorted keys of 8 bytes, an eighth of the memory of a Python set."""

    def __init__(self, size_m: float) -> None:
        self._size_m = size_m
        self._occupied = np.empty(0, np.int64)

    def fill(self, points_W: NDArray[np.float64], most: int) -> NDArray[np.int64]:
        """Return the indices (M,) of at most ``most`` of the points (N, 3) m, one for each voxel that was empty.

        Only the voxels of the returned points become occupied. If there are too many, they are thinned out evenly.
        """
        keys, first = np.unique(self._keys(points_W), return_index=True)
        chosen = np.sort(first[~self._has(keys)])
        if len(chosen) > most:
            chosen = chosen[np.linspace(0, len(chosen) - 1, most).astype(np.int64)]
        new = np.sort(self._keys(points_W[chosen]))
        self._occupied = np.insert(self._occupied, np.searchsorted(self._occupied, new), new)
        return chosen

    def _has(self, keys: NDArray[np.int64]) -> NDArray[np.bool_]:
        if not len(self._occupied):
            return np.zeros(len(keys), np.bool_)
        at = np.searchsorted(self._occupied, keys)
        return self._occupied[np.minimum(at, len(self._occupied) - 1)] == keys

    def _keys(self, points_W: NDArray[np.float64]) -> NDArray[np.int64]:
        cell = np.floor(points_W / self._size_m).astype(np.int64) + HALF_SPAN
        return (cell[:, 0] << 42) | (cell[:, 1] << 21) | cell[:, 2]
