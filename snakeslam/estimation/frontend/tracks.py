"""The table of tracks: where each feature was observed from the window's clones, and at what depth."""

import numpy as np
from numpy.typing import NDArray

from snakeslam.geometry.compiled import compiled
from snakeslam.messages import Float


def among(ids: NDArray[np.int64], others: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which of ``ids`` (N,) are in ``others`` (M,), in any order; np.isin, but fast for a few hundred."""
    return _among(np.ascontiguousarray(ids), np.sort(others))


@compiled
def _among(ids: NDArray[np.int64], ordered: NDArray[np.int64]) -> NDArray[np.bool_]:
    found = np.zeros(len(ids), np.bool_)
    at = np.searchsorted(ordered, ids)
    for n in range(len(ids)):
        found[n] = at[n] < len(ordered) and ordered[at[n]] == ids[n]
    return found


class TrackTable:
    """Observations of M tracks from the n clones of the window, as arrays whose columns are the clones.

    ``ids`` (M,), ``xyz`` (M, n, 3) normalised (x, y) and depth in m (0 = unknown), ``seen`` (M, n);
    ``motion_blur_rad`` (n,) is the length of the motion blur in each clone's image, normalised. ``flow`` (M, n, 2) is
    the motion of (x, y) per second of a rolling shutter's readout.
    """

    ids: NDArray[np.int64]
    xyz: Float
    seen: NDArray[np.bool_]
    motion_blur_rad: Float
    flow: Float

    def __init__(self) -> None:
        self.clear()

    @property
    def lengths(self) -> NDArray[np.int64]:
        """Number of observations of each track, (M,)."""
        return np.asarray(self.seen.sum(axis=1))

    @property
    def has_depth(self) -> NDArray[np.bool_]:
        """Whether any observation of a track has a depth, (M,)."""
        return np.asarray(np.any(self.xyz[..., 2] > 0.0, axis=1))

    def add_frame(
        self, ids: NDArray[np.int64], xy: Float, depth_m: Float, motion_blur_rad: float = 0.0, flow: Float | float = 0.0
    ) -> None:
        """Add the observations from the newest clone as a column; ids (k,) that are new become rows."""
        known = among(ids, self.ids)
        new = ids[~known]
        m, n = self.seen.shape
        xyz, seen = np.zeros((m + len(new), n + 1, 3)), np.zeros((m + len(new), n + 1), bool)
        flows = np.zeros((m + len(new), n + 1, 2))
        xyz[:m, :n], seen[:m, :n], flows[:m, :n] = self.xyz, self.seen, self.flow
        self.ids = np.concatenate([self.ids, new])
        order = np.argsort(self.ids, kind="stable")
        rows = order[np.searchsorted(self.ids[order], ids)]
        xyz[rows, n, :2], xyz[rows, n, 2], seen[rows, n] = xy, depth_m, True
        flows[rows, n] = flow
        self.xyz, self.seen, self.flow = xyz, seen, flows
        self.motion_blur_rad = np.append(self.motion_blur_rad, motion_blur_rad)

    def drop_clone(self, k: int) -> None:
        """Drop the observations of clone ``k``, and the tracks that have no others."""
        self.xyz, self.seen = np.delete(self.xyz, k, axis=1), np.delete(self.seen, k, axis=1)
        self.motion_blur_rad, self.flow = np.delete(self.motion_blur_rad, k), np.delete(self.flow, k, axis=1)
        self.keep(np.asarray(self.seen.any(axis=1)))

    def keep(self, kept: NDArray[np.bool_]) -> None:
        """Remove the tracks that are not ``kept`` (M,)."""
        self.ids, self.xyz, self.seen, self.flow = self.ids[kept], self.xyz[kept], self.seen[kept], self.flow[kept]

    def clear(self) -> None:
        """Remove all tracks and columns."""
        self.ids = np.empty(0, np.int64)
        self.xyz = np.empty((0, 0, 3))
        self.seen = np.empty((0, 0), bool)
        self.motion_blur_rad = np.empty(0)
        self.flow = np.empty((0, 0, 2))
