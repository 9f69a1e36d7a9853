"""Alignment of tracked features with their reference patches, which removes the drift of frame-to-frame KLT.

From frame to frame KLT errs by thousandths of a pixel towards the same side, inwards while the camera moves ahead, and
these errors accumulate. Here the patch W around a feature in its first image is aligned with the newest image I by
inverse-compositional Gauss-Newton [Baker04] over the position u alone; its shape follows from the camera's rotation R
since then and the depths z0, z1:

    min_u sum_d (I(u + A d) - W(d))^2,   A = z0/z1 [R_00 - x R_20, R_01 - x R_21; R_10 - y R_20, R_11 - y R_21]

with (x, y) normalised. Both patches are brought to mean 0 and standard deviation 1, so that exposure does not matter.
"""

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.frontend.tracks import among
from snakeslam.geometry.compiled import compiled
from snakeslam.messages import Float

Float32 = NDArray[np.float32]

RADIUS_PX = 6
SIDE = 2 * RADIUS_PX + 1
"""Side of a patch, 13 px: that of KLT's window."""
MAX_STEPS = 8
CONVERGED_PX = 0.005
"""Step at which Gauss-Newton ends: the size of the errors that are to be removed."""
MAX_SHIFT_PX = 2.0
"""A patch further than this from where KLT tracked it belongs to something else that is similar."""
MIN_CORRELATION = 0.9
"""Least correlation of the two patches."""
MIN_CONTRAST = 2.0
"""Least standard deviation of a patch in grey levels; a paler one has no unique position."""
MIN_SCALE, MAX_SCALE = 0.6, 1.6
"""Range of the patch's magnification sqrt(det A): beyond it the two images have too different a resolution."""
FIRST_CAPACITY = 256


class ReferencePatches:
    """The reference patches of N features with depth, each from the image in which the feature was found.

    The arrays have room for more patches than there are; ``_slots`` (N,) are the rows in use.
    """

    def __init__(self) -> None:
        self._ids = np.empty(0, np.int64)
        self._slots = np.empty(0, np.int64)
        self._R = np.empty((FIRST_CAPACITY, 3, 3))
        self._depth_m = np.empty(FIRST_CAPACITY)
        self._patches = np.empty((FIRST_CAPACITY, SIDE * SIDE, 3), np.float32)

    def align(
        self, gray: NDArray[np.uint8], px: Float32, ids: NDArray[np.int64], xy: Float, depth_m: Float, R_CF: Float
    ) -> Float32:
        """Return the positions (M, 2) of features that KLT tracked to ``px``, aligned with their patches.

        ``xy`` (M, 2) are their normalised coordinates, ``depth_m`` (M,) with 0 for unknown, ``R_CF`` (3, 3) the
        rotation from the first camera frame F to this one. Features without a patch stay where they are. Patches of
        features that are no longer tracked, or no longer similar to their patch, are dropped.
        """
        # 1. Patches of features that are no longer tracked go; ``at`` are the features of the others that have a depth.
        self._keep(among(self._ids, ids))
        order = np.argsort(ids, kind="stable")
        at = order[np.searchsorted(ids[order], self._ids)]
        seen = depth_m[at] > 0.0
        at, slots = at[seen], self._slots[seen]
        # 2. Shape A = z0/z1 (R_xy - (x, y)^T R_z) of each, with R from the patch's camera to this one.
        R = R_CF @ np.swapaxes(self._R[slots], 1, 2)
        A = R[:, :2, :2] - xy[at][:, :, None] * R[:, 2:, :2]
        A = np.asarray(A * (self._depth_m[slots] / depth_m[at])[:, None, None], dtype=np.float64)
        # 3. Align; a patch that correlates badly, or is too far from where KLT tracked it, is dropped.
        found, correlation = _align_all(gray, px[at], A, self._patches, slots)
        good = (correlation >= MIN_CORRELATION) & (np.abs(found - px[at]).max(axis=1, initial=0.0) < MAX_SHIFT_PX)
        px = px.copy()
        px[at[good]] = found[good]
        keep = np.ones(len(self._ids), bool)
        keep[np.flatnonzero(seen)[~good]] = False
        self._keep(keep)
        return px

    def add(self, gray: NDArray[np.uint8], px: Float32, ids: NDArray[np.int64], depth_m: Float, R_CF: Float) -> None:
        """Store the patches of those features with depth that have none yet."""
        new = np.flatnonzero((depth_m > 0.0) & ~among(ids, self._ids))
        slots = self._free(len(new))
        good = _extract(gray, px[new], self._patches, slots)
        new, slots = new[good], slots[good]
        self._R[slots], self._depth_m[slots] = R_CF, depth_m[new]
        self._ids, self._slots = np.concatenate([self._ids, ids[new]]), np.concatenate([self._slots, slots])

    def _keep(self, mask: NDArray[np.bool_]) -> None:
        self._ids, self._slots = self._ids[mask], self._slots[mask]

    def _free(self, count: int) -> NDArray[np.int64]:
        """Return unused slots, (count,); the arrays grow when there are too few."""
        missing = count - (len(self._patches) - len(self._slots))
        if missing > 0:
            capacity = len(self._patches) + max(missing, len(self._patches))
            self._R, self._depth_m = np.resize(self._R, (capacity, 3, 3)), np.resize(self._depth_m, capacity)
            self._patches = np.resize(self._patches, (capacity, SIDE * SIDE, 3))
        used = np.zeros(len(self._patches), bool)
        used[self._slots] = True
        return np.flatnonzero(~used)[:count]


@compiled
def _grey(gray: NDArray[np.uint8], u: float, v: float) -> float:
    """Return the grey level at (u, v), bilinear between four pixels."""
    i, j = int(v), int(u)
    a, b = u - j, v - i
    above = (1.0 - a) * gray[i, j] + a * gray[i, j + 1]
    below = (1.0 - a) * gray[i + 1, j] + a * gray[i + 1, j + 1]
    return (1.0 - b) * above + b * below


@compiled
def _contains(gray: NDArray[np.uint8], u: float, v: float, A: Float, radius: int) -> bool:
    """Return whether the patch around (u, v) with shape ``A`` is inside the image."""
    wide = radius * (abs(A[0, 0]) + abs(A[0, 1]))
    high = radius * (abs(A[1, 0]) + abs(A[1, 1]))
    return bool(wide <= u < gray.shape[1] - 1.0 - wide and high <= v < gray.shape[0] - 1.0 - high)


@compiled
def _extract(gray: NDArray[np.uint8], px: Float32, patches: Float32, slots: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Write (patch, gradient by x, gradient by y) to the slots; return which features have enough contrast.

    All three have mean 0 and are divided by the patch's standard deviation.
    """
    good = np.zeros(len(px), np.bool_)
    wide = np.empty((SIDE + 2, SIDE + 2))
    plain = np.eye(2)
    for k in range(len(px)):
        u, v = float(px[k, 0]), float(px[k, 1])
        if not _contains(gray, u, v, plain, RADIUS_PX + 1):
            continue
        for i in range(SIDE + 2):
            for j in range(SIDE + 2):
                wide[i, j] = _grey(gray, u + j - RADIUS_PX - 1, v + i - RADIUS_PX - 1)
        patch, by_x, by_y = wide[1:-1, 1:-1], wide[1:-1, 2:] - wide[1:-1, :-2], wide[2:, 1:-1] - wide[:-2, 1:-1]
        std = patch.std()
        if std < MIN_CONTRAST:
            continue
        good[k] = True
        out = patches[slots[k]]
        out[:, 0] = ((patch - patch.mean()) / std).ravel()
        out[:, 1] = ((by_x - by_x.mean()) / (2.0 * std)).ravel()
        out[:, 2] = ((by_y - by_y.mean()) / (2.0 * std)).ravel()
    return good


@compiled
def _align_all(
    gray: NDArray[np.uint8], px: Float32, A: Float, patches: Float32, slots: NDArray[np.int64]
) -> tuple[Float32, Float]:
    """Return the aligned positions (N, 2) and the correlation there (N,), 0 where a patch leaves the image."""
    n = len(px)
    found, correlation = px.copy(), np.zeros(n)
    for k in range(n):
        patch = patches[slots[k]]
        if MIN_SCALE**2 < A[k, 0, 0] * A[k, 1, 1] - A[k, 0, 1] * A[k, 1, 0] < MAX_SCALE**2:
            found[k, 0], found[k, 1], correlation[k] = _align(gray, float(px[k, 0]), float(px[k, 1]), A[k], patch)
    return found, correlation


@compiled
def _align(gray: NDArray[np.uint8], u: float, v: float, A: Float, patch: Float32) -> tuple[float, float, float]:
    """Return the position of the patch, starting from (u, v), and the correlation there; 0 if it leaves the image.

    Inverse-compositional: the gradients G = (W_x, W_y) are those of the patch, so that G^T G is summed only once. With
    J = (I(u + A d) - mean) / std each step is d = (G^T G)^-1 G^T (W - J), u <- u + A d.
    """
    # G^T G = [xx xy; xy yy] and G^T W = (wx, wy), with the patch W in column 0 and its gradients in 1 and 2.
    xx = xy = yy = wx = wy = 0.0
    for m in range(SIDE * SIDE):
        xx += patch[m, 1] * patch[m, 1]
        xy += patch[m, 1] * patch[m, 2]
        yy += patch[m, 2] * patch[m, 2]
        wx += patch[m, 1] * patch[m, 0]
        wy += patch[m, 2] * patch[m, 0]
    det = xx * yy - xy * xy
    correlation = 0.0
    for _ in range(MAX_STEPS):
        if not _contains(gray, u, v, A, RADIUS_PX) or det <= 0.0:
            return u, v, 0.0
        # Sums over the patch at the present position: I, I^2, W I, G^T I.
        total = squares = product = gx = gy = 0.0
        m = 0
        for i in range(-RADIUS_PX, RADIUS_PX + 1):
            for j in range(-RADIUS_PX, RADIUS_PX + 1):
                grey = _grey(gray, u + A[0, 0] * j + A[0, 1] * i, v + A[1, 0] * j + A[1, 1] * i)
                total += grey
                squares += grey * grey
                product += patch[m, 0] * grey
                gx += patch[m, 1] * grey
                gy += patch[m, 2] * grey
                m += 1
        # Correlation with the window, which is normalised as the patch is.
        mean = total / m
        std = np.sqrt(max(squares / m - mean * mean, 0.0))
        if std < MIN_CONTRAST:
            return u, v, 0.0
        correlation = product / (m * std)
        # Step d = (G^T G)^-1 (G^T W - G^T I / std) in the patch's coordinates, A d in the image's.
        bx, by = wx - gx / std, wy - gy / std
        dx, dy = (yy * bx - xy * by) / det, (xx * by - xy * bx) / det
        u += A[0, 0] * dx + A[0, 1] * dy
        v += A[1, 0] * dx + A[1, 1] * dy
        if dx * dx + dy * dy < CONVERGED_PX * CONVERGED_PX:
            break
    return u, v, correlation
