"""The points of the ORB map: positions in W with their descriptors."""

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.orb_map.orb import Descriptors
from snakeslam.messages import Float

SLOTS = 3
"""Descriptors of a point: that of its first observation, and those of the last two keyframes that observed it."""
FIRST_CAPACITY = 4096
JUDGED_AFTER = 8
"""A point is removed for being matched seldom only after so many frames that should show it."""
MIN_FOUND = 0.2
"""Least share of these frames in which it must be matched."""
PROVEN = 6
"""A point matched so often stays: blurred images match few points, which says nothing against them."""
ARRAYS = ("_points_W", "_information", "_descriptors", "_filled", "_ids", "_expected", "_found", "_last", "_keyframe")


class PointMap:
    """Arrays of points, all indexed alike, newest last; their capacity grows as needed."""

    def __init__(self) -> None:
        self.count = 0
        self._points_W = np.empty((FIRST_CAPACITY, 3))
        self._information = np.empty((FIRST_CAPACITY, 3, 3))
        self._descriptors = np.empty((FIRST_CAPACITY, SLOTS, 4), np.uint64)
        self._filled = np.empty(FIRST_CAPACITY, np.int64)
        self._ids = np.empty(FIRST_CAPACITY, np.int64)
        self._expected = np.empty(FIRST_CAPACITY, np.int64)
        self._found = np.empty(FIRST_CAPACITY, np.int64)
        self._last = np.empty(FIRST_CAPACITY, np.int64)
        self._keyframe = np.empty(FIRST_CAPACITY, np.int64)
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
        """Identifiers (M,), never used twice."""
        return self._ids[: self.count]

    @property
    def keyframe(self) -> NDArray[np.int64]:
        """Index of the keyframe that created each point, (M,)."""
        return self._keyframe[: self.count]

    @property
    def age(self) -> NDArray[np.int64]:
        """Number of frames since each point was last matched, (M,)."""
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

    def set_positions(self, index: NDArray[np.int64], points_W: Float, information: Float) -> None:
        """Set the positions (n, 3) and information (n, 3, 3) of points."""
        self._points_W[index] = points_W
        self._information[index] = information

    def add_descriptors(self, index: NDArray[np.int64], descriptors: Descriptors) -> None:
        """Store new descriptors (n, 4), each in its next slot; that of the first observation is never overwritten."""
        slot = 1 + (self._filled[index] - 1) % (SLOTS - 1)
        self._descriptors[index, slot] = descriptors
        self._filled[index] += 1

    def count_frame(self, expected: NDArray[np.int64], found: NDArray[np.int64]) -> None:
        """Count one frame for the points that it should show and for those that it matched."""
        self._frame += 1
        self._expected[expected] += 1
        self._found[found] += 1
        self._last[found] = self._frame

    def shrink(self, max_points: int) -> None:
        """Remove points that are matched too seldom, then those matched least often (of these the oldest)."""
        found, expected = self._found[: self.count], self._expected[: self.count]
        kept = np.flatnonzero((expected < JUDGED_AFTER) | (found >= PROVEN) | (found >= MIN_FOUND * expected))
        if len(kept) > max_points:
            kept = np.sort(kept[np.lexsort((-kept, -found[kept]))[:max_points]])
        self.keep(kept)

    def keep(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> None:
        """Remove all other points; the indices change, the ids do not."""
        kept = np.arange(self.count)[chosen]
        for name in ARRAYS:
            array = getattr(self, name)
            array[: len(kept)] = array[kept]
        self.count = len(kept)

    def _grow(self) -> None:
        for name in ARRAYS:
            array = getattr(self, name)
            setattr(self, name, np.concatenate([array, np.empty_like(array)]))
