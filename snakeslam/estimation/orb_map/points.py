"""The map of the visual mode: points in W with the descriptors they were seen with."""

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.orb_map.orb import Descriptors
from snakeslam.messages import Float

SLOTS = 3
"""Descriptors kept of a point: from its first sighting, and from later ones that looked otherwise."""
FIRST_ROOM = 4096
JUDGED_AFTER = 8
"""Frames that should show a point before it is judged by how many did."""
MIN_FOUND = 0.2
PROVEN = 6
"""A point found this often stays: a blurred stretch shows few points, and says nothing against them."""
ARRAYS = ("_points_W", "_information", "_descriptors", "_filled", "_ids", "_expected", "_found", "_last", "_keyframe")


class PointMap:
    """Points that grow in number and in precision; all arrays are indexed alike, newest last."""

    def __init__(self) -> None:
        self.count = 0
        self._points_W = np.empty((FIRST_ROOM, 3))
        self._information = np.empty((FIRST_ROOM, 3, 3))
        self._descriptors = np.empty((FIRST_ROOM, SLOTS, 4), np.uint64)
        self._filled = np.empty(FIRST_ROOM, np.int64)
        self._ids = np.empty(FIRST_ROOM, np.int64)
        self._expected = np.empty(FIRST_ROOM, np.int64)
        self._found = np.empty(FIRST_ROOM, np.int64)
        self._last = np.empty(FIRST_ROOM, np.int64)
        self._keyframe = np.empty(FIRST_ROOM, np.int64)
        self._next_id = 0
        self._frame = 0

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

    @property
    def age(self) -> NDArray[np.int64]:
        """Frames since each point was last found (M,)."""
        return self._frame - self._last[: self.count]

    def add(self, points_W: Float, information: Float, descriptors: Descriptors, keyframe: int) -> NDArray[np.int64]:
        """Add points (n, 3) with information (n, 3, 3) and descriptors (n, 4); return their indices."""
        n = len(points_W)
        while self.count + n > len(self._points_W):
            self._grow()
        new = np.arange(self.count, self.count + n)
        self._points_W[new], self._information[new] = points_W, information
        self._descriptors[new] = descriptors[:, None]
        self._filled[new], self._keyframe[new], self._last[new] = 1, keyframe, self._frame
        self._expected[new] = self._found[new] = 1
        self._ids[new] = np.arange(self._next_id, self._next_id + n)
        self._next_id += n
        self.count += n
        return new

    def place(self, index: NDArray[np.int64], points_W: Float, information: Float) -> None:
        """Put points to new positions (n, 3) with their information (n, 3, 3)."""
        self._points_W[index] = points_W
        self._information[index] = information

    def remember(self, index: NDArray[np.int64], descriptors: Descriptors) -> None:
        """Keep how points look now, each in its next slot; the first sighting is never overwritten."""
        slot = 1 + (self._filled[index] - 1) % (SLOTS - 1)
        self._descriptors[index, slot] = descriptors
        self._filled[index] += 1

    def count_frame(self, expected: NDArray[np.int64], found: NDArray[np.int64]) -> None:
        """Note which points one frame should have shown and which it did."""
        self._frame += 1
        self._expected[expected] += 1
        self._found[found] += 1
        self._last[found] = self._frame

    def shrink(self, max_points: int) -> None:
        """Forget the points that are seldom found where they should be, then those found least, oldest first."""
        found, expected = self._found[: self.count], self._expected[: self.count]
        kept = np.flatnonzero((expected < JUDGED_AFTER) | (found >= PROVEN) | (found >= MIN_FOUND * expected))
        if len(kept) > max_points:
            kept = np.sort(kept[np.lexsort((-kept, -found[kept]))[:max_points]])
        self.keep(kept)

    def keep(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> None:
        """Forget all other points; indices (not ids) change."""
        kept = np.arange(self.count)[chosen]
        for name in ARRAYS:
            array = getattr(self, name)
            array[: len(kept)] = array[kept]
        self.count = len(kept)

    def _grow(self) -> None:
        for name in ARRAYS:
            array = getattr(self, name)
            setattr(self, name, np.concatenate([array, np.empty_like(array)]))
