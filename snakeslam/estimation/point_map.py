"""The map of the visual mode: points in W with the descriptors they were seen with."""

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.orb import Descriptors
from snakeslam.messages import Float

SLOTS = 3
"""Descriptors kept of a point: from its first sighting, and from later ones that looked otherwise."""
FIRST_ROOM = 4096


class PointMap:
    """Points that grow in number and in precision; all arrays are indexed alike, newest last."""

    def __init__(self) -> None:
        self.count = 0
        self._points_W = np.empty((FIRST_ROOM, 3))
        self._information = np.empty((FIRST_ROOM, 3, 3))
        self._descriptors = np.empty((FIRST_ROOM, SLOTS, 4), np.uint64)
        self._filled = np.empty(FIRST_ROOM, np.int64)
        self._ids = np.empty(FIRST_ROOM, np.int64)
        self._seen = np.empty(FIRST_ROOM, np.int64)
        self._keyframe = np.empty(FIRST_ROOM, np.int64)
        self._next_id = 0

    @property
    def points_W(self) -> Float:
        """Positions (M, 3) m."""
        return self._points_W[: self.count]

    @property
    def information(self) -> Float:
        """Inverse covariances (M, 3, 3) of the positions in W."""
        return self._information[: self.count]

    @property
    def descriptors(self) -> Descriptors:
        """Descriptors (M, SLOTS, 4)."""
        return self._descriptors[: self.count]

    @property
    def ids(self) -> NDArray[np.int64]:
        """Identities (M,), never used twice."""
        return self._ids[: self.count]

    @property
    def keyframe(self) -> NDArray[np.int64]:
        """Keyframe that made each point (M,)."""
        return self._keyframe[: self.count]

    def add(self, points_W: Float, information: Float, descriptors: Descriptors, keyframe: int) -> NDArray[np.int64]:
        """Add points (n, 3) with information (n, 3, 3) and descriptors (n, 4); return their indices."""
        n = len(points_W)
        while self.count + n > len(self._points_W):
            self._grow()
        new = np.arange(self.count, self.count + n)
        self._points_W[new], self._information[new] = points_W, information
        self._descriptors[new] = descriptors[:, None]
        self._filled[new], self._seen[new], self._keyframe[new] = 1, 1, keyframe
        self._ids[new] = np.arange(self._next_id, self._next_id + n)
        self._next_id += n
        self.count += n
        return new

    def fuse(self, index: NDArray[np.int64], points_W: Float, information: Float) -> None:
        """Average sightings (n, 3) of points into them, weighted by information (n, 3, 3)."""
        total = self._information[index] + information
        rhs = (information @ (points_W - self._points_W[index])[..., None])[..., 0]
        self._points_W[index] += np.linalg.solve(total, rhs[..., None])[..., 0]
        self._information[index] = total
        self._seen[index] += 1

    def remember(self, index: NDArray[np.int64], descriptors: Descriptors) -> None:
        """Keep how points look now, each in its next slot; the first sighting is never overwritten."""
        slot = 1 + (self._filled[index] - 1) % (SLOTS - 1)
        self._descriptors[index, slot] = descriptors
        self._filled[index] += 1

    def shrink(self, max_points: int) -> None:
        """Forget the points seen least, oldest first, until ``max_points`` are left."""
        if self.count <= max_points:
            return
        order = np.lexsort((-np.arange(self.count), -self._seen[: self.count]))
        kept = np.sort(order[:max_points])
        for name in ("_points_W", "_information", "_descriptors", "_filled", "_ids", "_seen", "_keyframe"):
            array = getattr(self, name)
            array[:max_points] = array[kept]
        self.count = max_points

    def _grow(self) -> None:
        for name in ("_points_W", "_information", "_descriptors", "_filled", "_ids", "_seen", "_keyframe"):
            array = getattr(self, name)
            setattr(self, name, np.concatenate([array, np.empty_like(array)]))
