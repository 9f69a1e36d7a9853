"""The front-end: FAST corners on a grid, KLT with starts predicted by the gyro, a RANSAC that knows the turn."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.frontend.motion_ransac import agreeing_motions, rigid_motions
from snakeslam.estimation.frontend.patches import Anchors
from snakeslam.estimation.frontend.settings import FrontendSettings
from snakeslam.estimation.frontend.tracks import among
from snakeslam.estimation.imaging.camera import PinholeCamera
from snakeslam.estimation.imaging.depth_sampling import sample_depth
from snakeslam.geometry import so3
from snakeslam.messages import CameraFrame, Float

BORDER_PX = 8
KLT_EPSILON_PX = 0.02
KLT_STEPS = 20
MORE_LEVELS = 2
"""Of the pyramid, where the predicted motion is doubted: four times as far."""
ENOUGH_CORNERS = 4
FEW_MISSING = 0.05
MIN_EIGENVALUE = 3e-3
"""Least texture in the poorest direction of a window (OpenCV's scale): below it KLT creeps along."""
LEAST_ROLL = 0.015
"""Sine of the least turn about the optical axis between two pictures that is undone before KLT."""


@dataclass(frozen=True, slots=True)
class FrontendFrame:
    """Features of one frame: ``px`` (M, 2), ``ids`` (M,), ``xy`` (M, 2) normalised, ``depth_m`` (M,) with 0 = unknown.

    ``rejected_px`` (R, 2) with ``rejected_ids`` are those that RANSAC dropped; ``disparity_px`` is the median motion
    that the turn does not explain, None without a frame before; ``frozen`` tells that the picture is the one before,
    ``followed`` how many features (the first ones) were there before; ``smear`` is how far the camera turned in rad
    while the picture was exposed.
    """

    px: NDArray[np.float32]
    ids: NDArray[np.int64]
    xy: Float
    depth_m: Float
    rejected_px: NDArray[np.float32]
    rejected_ids: NDArray[np.int64]
    disparity_px: float | None
    frozen: bool
    followed: int
    smear: float = 0.0


class Frontend:
    """Follows features from frame to frame."""

    def __init__(
        self, settings: FrontendSettings, camera: PinholeCamera, seed: int, unknown_exposure_ns: int = 0
    ) -> None:
        self._settings = settings
        self._unknown_exposure_ns = unknown_exposure_ns
        self._camera = camera
        self._rng = np.random.default_rng([seed, 0])
        self._gray: NDArray[np.uint8] | None = None
        self._t_ns = 0
        self._smear = 0.0
        self._px = np.empty((0, 2), np.float32)
        self._ids = np.empty(0, np.int64)
        self._depth_m = np.empty(0)
        self._next_id = 0
        self._anchors = Anchors()
        self._R_CF = np.eye(3)

    def process(self, frame: CameraFrame, T_C1C0: Float, doubted: bool = False) -> FrontendFrame:
        """Follow the features of the frame before into ``frame``, given about how the camera has moved, and find more.

        ``T_C1C0`` (4, 4): its turn is taken as known, its translation only says where to look. Where the turn is
        ``doubted``, features are sought farther away, and those agree that move as one rigid scene, whatever the turn.
        """
        if self._gray is not None and np.array_equal(self._gray, frame.gray):
            return self._frame((self._px[:0], self._ids[:0]), 0.0, len(self._px), frozen=True)
        self._smear = self._smear_of(frame, T_C1C0)
        self._t_ns = frame.t_ns
        self._R_CF = T_C1C0[:3, :3] @ self._R_CF
        moved = np.ones(0, bool)
        disparity: float | None = None
        if self._gray is not None and len(self._px):
            px0, self._px, self._ids = self._follow(self._gray, frame.gray, T_C1C0, doubted)
            moved, disparity = self._agreeing(px0, None if doubted else T_C1C0[:3, :3])
        self._gray = frame.gray
        rejected = self._px[~moved], self._ids[~moved]
        self._px, self._ids = self._px[moved], self._ids[moved]
        followed = len(self._px)
        depth_m = sample_depth(frame.depth_m, self._px)
        xy = self._camera.normalise(self._px)
        self._px = self._anchors.settle(frame.gray, self._px, self._ids, xy, depth_m, self._R_CF)
        self._detect(frame.gray)
        self._depth_m = np.concatenate([depth_m, sample_depth(frame.depth_m, self._px[followed:])])
        self._anchors.add(frame.gray, self._px, self._ids, self._depth_m, self._R_CF)
        return self._frame(rejected, disparity, followed, frozen=False)

    def _frame(
        self,
        rejected: tuple[NDArray[np.float32], NDArray[np.int64]],
        disparity_px: float | None,
        followed: int,
        frozen: bool,
    ) -> FrontendFrame:
        xy = self._camera.normalise(self._px)
        return FrontendFrame(
            self._px, self._ids, xy, self._depth_m, *rejected, disparity_px, frozen, followed, self._smear
        )

    def _smear_of(self, frame: CameraFrame, T_C1C0: Float) -> float:
        """Return how far the camera turns while ``frame`` is exposed, at its mean rate since the frame before, rad."""
        since_ns = frame.t_ns - self._t_ns
        if self._gray is None or since_ns <= 0:
            return 0.0
        exposure_ns = frame.exposure_ns or self._unknown_exposure_ns
        return float(np.linalg.norm(so3.log(T_C1C0[:3, :3]))) * exposure_ns / since_ns

    def drop(self, ids: NDArray[np.int64]) -> None:
        """Stop following these features."""
        if len(ids):
            keep = ~among(self._ids, ids)
            self._px, self._ids, self._depth_m = self._px[keep], self._ids[keep], self._depth_m[keep]

    def _follow(
        self, before: NDArray[np.uint8], now: NDArray[np.uint8], T_C1C0: Float, doubted: bool
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
        """Return where features were, where they are, and their ids; those that KLT loses are left out.

        The picture before is first turned as the camera has turned: KLT takes a window for moved, not turned, and would
        creep over the surface.
        """
        start = self._predict(T_C1C0)
        turned, px0 = self._turned(before, T_C1C0[:3, :3])
        px1, status, _ = cv2.calcOpticalFlowPyrLK(
            turned,
            now,
            px0.reshape(-1, 1, 2),
            start.reshape(-1, 1, 2).copy(),
            winSize=(self._settings.klt_window_px, self._settings.klt_window_px),
            maxLevel=self._settings.klt_levels + (MORE_LEVELS if doubted else 0),
            criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, KLT_STEPS, KLT_EPSILON_PX),
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
            minEigThreshold=MIN_EIGENVALUE,
        )
        px1 = np.asarray(px1, dtype=np.float32).reshape(-1, 2)
        kept = np.asarray(status).ravel().astype(bool) & self._inside(px1)
        return self._px[kept], px1[kept], self._ids[kept]

    def _turned(self, before: NDArray[np.uint8], R_C1C0: Float) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Return the picture before as a pinhole turned by ``R_C1C0`` sees it, and where its features are there.

        A small roll is let be, for interpolation has errors of its own. Distortion is left as it is: what matters is
        that windows look alike.
        """
        if abs(float(R_C1C0[1, 0])) < LEAST_ROLL:
            return before, self._px
        H = self._camera.K @ R_C1C0 @ np.linalg.inv(self._camera.K)
        size = (self._camera.width_px, self._camera.height_px)
        picture = cv2.warpPerspective(before, H, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        moved = np.hstack([self._px, np.ones((len(self._px), 1))]) @ H.T
        return np.asarray(picture, np.uint8), (moved[:, :2] / moved[:, 2:]).astype(np.float32)

    def _predict(self, T_C1C0: Float) -> NDArray[np.float32]:
        """Return where the motion takes the features, far ones where their depth is unknown.

        Those that it takes behind the camera or out of the picture stay.
        """
        rays = np.column_stack([self._camera.normalise(self._px), np.ones(len(self._px))]) @ T_C1C0[:3, :3].T
        known = self._depth_m > 0.0
        rays[known] += T_C1C0[:3, 3] / self._depth_m[known, None]
        out = self._px.copy()
        ahead = rays[:, 2] > 0.1
        out[ahead] = self._camera.project(rays[ahead]).astype(np.float32)
        return np.where(self._inside(out)[:, None], out, self._px)

    def _agreeing(self, px0: NDArray[np.float32], R_C1C0: Float | None) -> tuple[NDArray[np.bool_], float | None]:
        """Return which features, before at ``px0``, move as one; and how far in px without the turn, if known."""
        limit, focal_px = self._settings.ransac_threshold_px, self._camera.focal_px
        before, now = self._camera.normalise(px0), self._camera.normalise(self._px)
        if R_C1C0 is None:
            return rigid_motions(before, now, limit / focal_px), None
        good, moved = agreeing_motions(before, now, R_C1C0, limit / focal_px, self._rng)
        return good, None if moved is None else moved * focal_px

    def _inside(self, px: NDArray[np.float32]) -> NDArray[np.bool_]:
        limit = np.array([self._camera.width_px - BORDER_PX, self._camera.height_px - BORDER_PX])
        inside = np.all((px >= BORDER_PX) & (px < limit), axis=-1)
        return np.asarray(inside & self._camera.usable_at(np.where(inside[:, None], px, 0.0)))

    def _detect(self, gray: NDArray[np.uint8]) -> None:
        """Fill up to ``max_tracks`` with each empty cell's strongest FAST corner, when more than a few are missing."""
        missing = self._settings.max_tracks - len(self._px)
        if missing <= FEW_MISSING * self._settings.max_tracks:
            return
        cell = self._cell_px()
        taken = np.zeros((gray.shape[0] // cell + 1, gray.shape[1] // cell + 1), bool)
        columns, rows = (self._px / cell).astype(np.int64).T
        taken[rows, columns] = True
        corners = self._corners(gray, _free(taken, cell, gray.shape) & self._camera.usable)
        order = np.argsort(-corners[:, 2], kind="stable")
        corners = corners[order]
        cells = (corners[:, :2] / cell).astype(np.int64)
        _, best = np.unique(cells[:, 1] * taken.shape[1] + cells[:, 0], return_index=True)
        chosen = corners[np.sort(best), :2]
        chosen = chosen[self._far_from_tracked(chosen)][:missing]
        self._px = np.vstack([self._px, chosen.astype(np.float32)])
        self._ids = np.concatenate([self._ids, np.arange(self._next_id, self._next_id + len(chosen))])
        self._next_id += len(chosen)

    def _cell_px(self) -> int:
        """Return the side of a cell so that ``max_tracks`` cells cover about three quarters of the picture."""
        area = self._camera.width_px * self._camera.height_px
        return max(int(self._settings.min_distance_px), int(np.sqrt(0.75 * area / self._settings.max_tracks)))

    def _corners(self, gray: NDArray[np.uint8], mask: NDArray[np.uint8]) -> Float:
        """Return FAST corners (x, y, response), with a lower threshold where the picture gives few."""
        usual = self._settings.fast_threshold
        enough = ENOUGH_CORNERS * (self._settings.max_tracks - len(self._px))
        found = cv2.FastFeatureDetector.create(threshold=usual).detect(gray, mask)
        if len(found) < enough:
            found = cv2.FastFeatureDetector.create(threshold=max(2, usual // 2)).detect(gray, mask)
        px = cv2.KeyPoint.convert(found)
        response = np.fromiter((k.response for k in found), np.float64, len(found))
        return np.column_stack([np.asarray(px, dtype=np.float64).reshape(-1, 2), response])

    def _far_from_tracked(self, px: Float) -> NDArray[np.bool_]:
        if not len(self._px) or not len(px):
            return np.ones(len(px), bool)
        tracked = self._px.astype(np.float64)
        dx, dy = px[:, None, 0] - tracked[:, 0], px[:, None, 1] - tracked[:, 1]
        return np.asarray((dx * dx + dy * dy).min(axis=1) >= (0.5 * self._settings.min_distance_px) ** 2)


def _free(taken: NDArray[np.bool_], cell: int, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return a mask of the picture, 255 in empty cells away from the border."""
    mask = np.zeros(shape, np.uint8)
    inner = np.s_[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX]
    free = np.where(taken, 0, 255).astype(np.uint8)
    mask[inner] = free.repeat(cell, axis=0).repeat(cell, axis=1)[: shape[0], : shape[1]][inner]
    return mask
