"""Where followed features really are: aligned with their looks when they were found, so that KLT's creeping ends.

From picture to picture KLT is wrong by thousandths of a pixel to the same side, inwards while the camera goes ahead,
and keeps what it was wrong by. Here a window W of the first picture is sought in the newest by inverse-compositional
Gauss-Newton [Baker04] over its place u alone; its shape is known from the camera's turn R and the depths z0, z1:

    min_u sum_d (I(u + A d) - W(d))^2,   A = z0/z1 [R_00 - x R_20, R_01 - x R_21; R_10 - y R_20, R_11 - y R_21]

with (x, y) normalised, both windows brought to mean 0 and scatter 1, so that exposure does not matter.
"""

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.frontend.tracks import among
from snakeslam.geometry.compiled import compiled
from snakeslam.messages import Float

Float32 = NDArray[np.float32]

RADIUS_PX = 6
SIDE = 2 * RADIUS_PX + 1
STEPS = 8
SETTLED_PX = 0.005
MOST_CREPT_PX = 2.0
"""Further from where KLT followed it to, another thing may look alike."""
LEAST_ALIKE = 0.9
"""Least correlation of the two windows."""
LEAST_SCATTER = 2.0
"""Grey levels: a window that is paler tells no place."""
LEAST_SCALE, MOST_SCALE = 0.6, 1.6
FIRST_ROOM = 256


class Anchors:
    """The first looks of features that have a depth, (N,) of them in the order of ``ids``."""

    def __init__(self) -> None:
        self._ids = np.empty(0, np.int64)
        self._slots = np.empty(0, np.int64)
        self._R = np.empty((FIRST_ROOM, 3, 3))
        self._depth_m = np.empty(FIRST_ROOM)
        self._looks = np.empty((FIRST_ROOM, SIDE * SIDE, 3), np.float32)

    def settle(
        self, gray: NDArray[np.uint8], px: Float32, ids: NDArray[np.int64], xy: Float, depth_m: Float, R_CF: Float
    ) -> Float32:
        """Return where the features at ``px`` (M, 2) are; those without an anchor stay where KLT followed them to.

        ``xy`` (M, 2) are their normalised coordinates, ``depth_m`` (M,) with 0 for unknown, ``R_CF`` (3, 3) turns from
        the first camera to this one. Anchors of other features, and of those that look otherwise now, are forgotten.
        """
        self._keep(among(self._ids, ids))
        order = np.argsort(ids, kind="stable")
        at = order[np.searchsorted(ids[order], self._ids)]
        seen = depth_m[at] > 0.0
        at, slots = at[seen], self._slots[seen]
        A = _shapes(R_CF @ np.swapaxes(self._R[slots], 1, 2), xy[at], self._depth_m[slots] / depth_m[at])
        found, alike = _align(gray, px[at], A, self._looks, slots)
        good = (alike >= LEAST_ALIKE) & (np.abs(found - px[at]).max(axis=1, initial=0.0) < MOST_CREPT_PX)
        px = px.copy()
        px[at[good]] = found[good]
        keep = np.ones(len(self._ids), bool)
        keep[np.flatnonzero(seen)[~good]] = False
        self._keep(keep)
        return px

    def add(self, gray: NDArray[np.uint8], px: Float32, ids: NDArray[np.int64], depth_m: Float, R_CF: Float) -> None:
        """Take the looks of the features with a depth that have no anchor yet."""
        new = np.flatnonzero((depth_m > 0.0) & ~among(ids, self._ids))
        slots = self._free(len(new))
        good = _look(gray, px[new], self._looks, slots)
        new, slots = new[good], slots[good]
        self._R[slots], self._depth_m[slots] = R_CF, depth_m[new]
        self._ids, self._slots = np.concatenate([self._ids, ids[new]]), np.concatenate([self._slots, slots])

    def _keep(self, mask: NDArray[np.bool_]) -> None:
        self._ids, self._slots = self._ids[mask], self._slots[mask]

    def _free(self, count: int) -> NDArray[np.int64]:
        """Return slots that no anchor has, (count,)."""
        missing = count - (len(self._looks) - len(self._slots))
        if missing > 0:
            room = len(self._looks) + max(missing, len(self._looks))
            self._R, self._depth_m = np.resize(self._R, (room, 3, 3)), np.resize(self._depth_m, room)
            self._looks = np.resize(self._looks, (room, SIDE * SIDE, 3))
        used = np.zeros(len(self._looks), bool)
        used[self._slots] = True
        return np.flatnonzero(~used)[:count]


def _shapes(R: Float, xy: Float, ratio: Float) -> Float:
    """Return A (N, 2, 2)."""
    A = R[:, :2, :2] - xy[:, :, None] * R[:, 2:, :2]
    return np.asarray(A * ratio[:, None, None], dtype=np.float64)


@compiled
def _grey(gray: NDArray[np.uint8], u: float, v: float) -> float:
    """Return the grey level between four pixels."""
    i, j = int(v), int(u)
    a, b = u - j, v - i
    above = (1.0 - a) * gray[i, j] + a * gray[i, j + 1]
    below = (1.0 - a) * gray[i + 1, j] + a * gray[i + 1, j + 1]
    return (1.0 - b) * above + b * below


@compiled
def _holds(gray: NDArray[np.uint8], u: float, v: float, A: Float, radius: int) -> bool:
    """Return whether the window about (u, v) with shape ``A`` is inside the picture."""
    wide = radius * (abs(A[0, 0]) + abs(A[0, 1]))
    high = radius * (abs(A[1, 0]) + abs(A[1, 1]))
    return bool(wide <= u < gray.shape[1] - 1.0 - wide and high <= v < gray.shape[0] - 1.0 - high)


@compiled
def _look(gray: NDArray[np.uint8], px: Float32, looks: Float32, slots: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Write (window, slope by x, slope by y) of mean 0, in scatters of the window, to the slots; which are of use."""
    good = np.zeros(len(px), np.bool_)
    wide = np.empty((SIDE + 2, SIDE + 2))
    plain = np.eye(2)
    for k in range(len(px)):
        u, v = float(px[k, 0]), float(px[k, 1])
        if not _holds(gray, u, v, plain, RADIUS_PX + 1):
            continue
        for i in range(SIDE + 2):
            for j in range(SIDE + 2):
                wide[i, j] = _grey(gray, u + j - RADIUS_PX - 1, v + i - RADIUS_PX - 1)
        window, by_x, by_y = wide[1:-1, 1:-1], wide[1:-1, 2:] - wide[1:-1, :-2], wide[2:, 1:-1] - wide[:-2, 1:-1]
        scatter = window.std()
        if scatter < LEAST_SCATTER:
            continue
        good[k] = True
        look = looks[slots[k]]
        look[:, 0] = ((window - window.mean()) / scatter).ravel()
        look[:, 1] = ((by_x - by_x.mean()) / (2.0 * scatter)).ravel()
        look[:, 2] = ((by_y - by_y.mean()) / (2.0 * scatter)).ravel()
    return good


@compiled
def _align(
    gray: NDArray[np.uint8], px: Float32, A: Float, looks: Float32, slots: NDArray[np.int64]
) -> tuple[Float32, Float]:
    """Return where the looks are found, (N, 2), and their correlation there, 0 where they leave the picture."""
    n = len(px)
    found, alike = px.copy(), np.zeros(n)
    for k in range(n):
        look = looks[slots[k]]
        if LEAST_SCALE**2 < A[k, 0, 0] * A[k, 1, 1] - A[k, 0, 1] * A[k, 1, 0] < MOST_SCALE**2:
            found[k, 0], found[k, 1], alike[k] = _aligned(gray, float(px[k, 0]), float(px[k, 1]), A[k], look)
    return found, alike


@compiled
def _aligned(gray: NDArray[np.uint8], u: float, v: float, A: Float, look: Float32) -> tuple[float, float, float]:
    """Return where the look is found from (u, v) on, and its correlation there."""
    xx = xy = yy = wx = wy = 0.0
    for m in range(SIDE * SIDE):
        xx += look[m, 1] * look[m, 1]
        xy += look[m, 1] * look[m, 2]
        yy += look[m, 2] * look[m, 2]
        wx += look[m, 1] * look[m, 0]
        wy += look[m, 2] * look[m, 0]
    det = xx * yy - xy * xy
    alike = 0.0
    for _ in range(STEPS):
        if not _holds(gray, u, v, A, RADIUS_PX) or det <= 0.0:
            return u, v, 0.0
        total = squares = product = gx = gy = 0.0
        m = 0
        for i in range(-RADIUS_PX, RADIUS_PX + 1):
            for j in range(-RADIUS_PX, RADIUS_PX + 1):
                grey = _grey(gray, u + A[0, 0] * j + A[0, 1] * i, v + A[1, 0] * j + A[1, 1] * i)
                total += grey
                squares += grey * grey
                product += look[m, 0] * grey
                gx += look[m, 1] * grey
                gy += look[m, 2] * grey
                m += 1
        mean = total / m
        scatter = np.sqrt(max(squares / m - mean * mean, 0.0))
        if scatter < LEAST_SCATTER:
            return u, v, 0.0
        alike = product / (m * scatter)
        bx, by = wx - gx / scatter, wy - gy / scatter
        dx, dy = (yy * bx - xy * by) / det, (xx * by - xy * bx) / det
        u += A[0, 0] * dx + A[0, 1] * dy
        v += A[1, 0] * dx + A[1, 1] * dy
        if dx * dx + dy * dy < SETTLED_PX * SETTLED_PX:
            break
    return u, v, alike
