"""The front-end: FAST corners on a grid, KLT started where the motion predicts, RANSAC with the known rotation."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.frontend.motion_ransac import essential_inliers, two_point_inliers
from snakeslam.estimation.frontend.patches import ReferencePatches
from snakeslam.estimation.frontend.settings import FrontendSettings
from snakeslam.estimation.frontend.tracks import among
from snakeslam.estimation.imaging.camera import PinholeCamera
from snakeslam.estimation.imaging.depth_sampling import sample_depth
from snakeslam.geometry import so3
from snakeslam.messages import CameraFrame, Float

BORDER_PX = 8
"""Features closer to the image's border are dropped: the window of KLT would reach beyond it."""
KLT_EPSILON_PX = 0.02
KLT_STEPS = 20
"""KLT ends when a step is shorter than KLT_EPSILON_PX, or after so many."""
MORE_LEVELS = 2
"""Additional levels of the pyramid where the predicted motion is doubted: features are searched four times as far."""
CORNERS_PER_TRACK = 4
"""With fewer corners than this for each missing track the FAST threshold is halved: the grid takes one of a cell."""
FEW_MISSING = 0.05
"""Share of ``max_tracks`` that may be missing before new corners are detected."""
MIN_EIGENVALUE = 3e-3
"""Least eigenvalue of a window's gradient matrix (OpenCV's scale); with less texture KLT drifts along an edge."""
MIN_ROLL_SINE = 0.015
"""Sine of the least roll between two images (0.9 deg) that is undone before KLT; warping has errors of its own."""
MIN_RAY_Z = 0.1
"""Predicted rays with less depth, relative to the feature's own, are at the image's rim or behind the camera."""
GRID_SHARE = 0.75
"""Share of the image that ``max_tracks`` cells of the grid cover; in the rest there is no texture."""


@dataclass(frozen=True, slots=True)
class TrackedFeatures:
    """Features of one frame: ``px`` (M, 2), ``ids`` (M,), ``xy`` (M, 2) normalised, ``depth_m`` (M,) with 0 = unknown.

    ``rejected_px`` (R, 2) with ``rejected_ids`` are the outliers of RANSAC; ``disparity_px`` is the median motion that
    the rotation does not explain, None without a frame before; ``frozen`` means that the image repeats the one before;
    ``tracked`` is the number of features (the first ones) that were tracked, not new; ``motion_blur_rad`` is the
    rotation of the camera during the exposure in rad, which is the length of the motion blur in normalised
    coordinates.
    """

    px: NDArray[np.float32]
    ids: NDArray[np.int64]
    xy: Float
    depth_m: Float
    rejected_px: NDArray[np.float32]
    rejected_ids: NDArray[np.int64]
    disparity_px: float | None
    frozen: bool
    tracked: int
    motion_blur_rad: float = 0.0


class Frontend:
    """Tracks features from frame to frame."""

    def __init__(
        self, settings: FrontendSettings, camera: PinholeCamera, seed: int, unknown_exposure_ns: int = 0
    ) -> None:
        self._settings = settings
        self._unknown_exposure_ns = unknown_exposure_ns
        self._camera = camera
        self._rng = np.random.default_rng([seed, 0])
        self._gray: NDArray[np.uint8] | None = None
        self._t_ns = 0
        self._motion_blur = 0.0
        self._px = np.empty((0, 2), np.float32)
        self._ids = np.empty(0, np.int64)
        self._depth_m = np.empty(0)
        self._next_id = 0
        self._patches = ReferencePatches()
        self._R_CF = np.eye(3)
        """Rotation from the first camera frame F to the newest one."""

    def process(self, frame: CameraFrame, T_C1C0: Float, doubted: bool = False) -> TrackedFeatures:
        """Track the features of the last frame into ``frame``, and detect new ones where there are few.

        ``T_C1C0`` (4, 4) is the predicted motion of the camera: its rotation is taken as known, its translation only
        starts KLT. Where it is ``doubted``, features are searched farther away, and the rotation is estimated from
        them.
        """
        gray = frame.gray
        if self._gray is not None and np.array_equal(self._gray, gray):
            return self._features((self._px[:0], self._ids[:0]), 0.0, len(self._px), frozen=True)

        # 1. Motion blur: the angle of the camera's rotation during the exposure, at the mean rate since the last frame.
        since_ns, exposure_ns = frame.t_ns - self._t_ns, frame.exposure_ns or self._unknown_exposure_ns
        rotation_rad = float(np.linalg.norm(so3.log(T_C1C0[:3, :3])))
        is_next = self._gray is not None and since_ns > 0
        self._motion_blur = rotation_rad * exposure_ns / since_ns if is_next else 0.0
        self._t_ns, self._R_CF = frame.t_ns, T_C1C0[:3, :3] @ self._R_CF

        # 2. KLT from the predicted positions, then RANSAC on the motions.
        inliers, disparity_px = np.ones(0, bool), None
        if self._gray is not None and len(self._px):
            px0, self._px, self._ids = self._klt(self._gray, gray, T_C1C0, doubted)
            inliers, disparity_px = self._ransac(px0, None if doubted else T_C1C0[:3, :3])
        self._gray = gray
        rejected = self._px[~inliers], self._ids[~inliers]
        self._px, self._ids = self._px[inliers], self._ids[inliers]
        tracked = len(self._px)

        # 3. Align features that have a depth with their reference patches: KLT drifts, a patch does not.
        depth_m = sample_depth(frame.depth_m, self._px)
        xy = self._camera.normalise(self._px)
        self._px = self._patches.align(gray, self._px, self._ids, xy, depth_m, self._R_CF)

        # 4. New corners in empty cells; their patches are the references from now on.
        self._detect(gray)
        self._depth_m = np.concatenate([depth_m, sample_depth(frame.depth_m, self._px[tracked:])])
        self._patches.add(gray, self._px, self._ids, self._depth_m, self._R_CF)
        return self._features(rejected, disparity_px, tracked, frozen=False)

    def drop(self, ids: NDArray[np.int64]) -> None:
        """Stop tracking these features."""
        if len(ids):
            keep = ~among(self._ids, ids)
            self._px, self._ids, self._depth_m = self._px[keep], self._ids[keep], self._depth_m[keep]

    def _features(
        self,
        rejected: tuple[NDArray[np.float32], NDArray[np.int64]],
        disparity_px: float | None,
        tracked: int,
        frozen: bool,
    ) -> TrackedFeatures:
        xy = self._camera.normalise(self._px)
        return TrackedFeatures(
            self._px, self._ids, xy, self._depth_m, *rejected, disparity_px, frozen, tracked, self._motion_blur
        )

    def _klt(
        self, before: NDArray[np.uint8], now: NDArray[np.uint8], T_C1C0: Float, doubted: bool
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
        """Return the pixels before, the pixels now and the ids of the features that KLT finds again."""
        # 1. Predicted ray R x0 + t / z0, without the translation where the depth is unknown. A feature that the
        #    prediction takes behind the camera or out of the image is searched where it was.
        rays = np.column_stack([self._camera.normalise(self._px), np.ones(len(self._px))]) @ T_C1C0[:3, :3].T
        known = self._depth_m > 0.0
        rays[known] += T_C1C0[:3, 3] / self._depth_m[known, None]
        start = self._px.copy()
        ahead = rays[:, 2] > MIN_RAY_Z
        start[ahead] = self._camera.project(rays[ahead]).astype(np.float32)
        start = np.where(self._inside(start)[:, None], start, self._px)

        # 2. KLT assumes that a window is shifted, not rotated, and drifts where it is. So the last image is rotated
        #    first, by the homography H = K R K^-1. Distortion is neglected: only the likeness of windows matters.
        R_C1C0, px0 = T_C1C0[:3, :3], self._px
        if abs(float(R_C1C0[1, 0])) >= MIN_ROLL_SINE:
            H = self._camera.K @ R_C1C0 @ np.linalg.inv(self._camera.K)
            size = (self._camera.width_px, self._camera.height_px)
            warped = cv2.warpPerspective(before, H, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            moved = np.hstack([self._px, np.ones((len(self._px), 1))]) @ H.T
            before, px0 = np.asarray(warped, np.uint8), (moved[:, :2] / moved[:, 2:]).astype(np.float32)

        # 3. Pyramidal KLT from the predicted positions.
        px1, status, _ = cv2.calcOpticalFlowPyrLK(
            before,
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

    def _ransac(self, px0: NDArray[np.float32], R_C1C0: Float | None) -> tuple[NDArray[np.bool_], float | None]:
        """Return the inliers of the features, before at ``px0``, and their median parallax in px where R is known."""
        limit, focal_px = self._settings.ransac_threshold_px, self._camera.focal_px
        before, now = self._camera.normalise(px0), self._camera.normalise(self._px)
        if R_C1C0 is None:
            return essential_inliers(before, now, limit / focal_px), None
        good, moved = two_point_inliers(before, now, R_C1C0, limit / focal_px, self._rng)
        return good, None if moved is None else moved * focal_px

    def _inside(self, px: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Return which pixels (N, 2) are away from the border and have a ray, (N,)."""
        limit = np.array([self._camera.width_px - BORDER_PX, self._camera.height_px - BORDER_PX])
        inside = np.all((px >= BORDER_PX) & (px < limit), axis=-1)
        return np.asarray(inside & self._camera.usable_at(np.where(inside[:, None], px, 0.0)))

    def _detect(self, gray: NDArray[np.uint8]) -> None:
        """Fill up to ``max_tracks`` with the strongest FAST corner of each empty cell, if more than few are missing."""
        settings = self._settings
        missing = settings.max_tracks - len(self._px)
        if missing <= FEW_MISSING * settings.max_tracks:
            return

        # 1. Cells without a feature: max_tracks of them cover about three quarters of the image.
        area_px2 = self._camera.width_px * self._camera.height_px
        cell = max(int(settings.min_distance_px), int(np.sqrt(GRID_SHARE * area_px2 / settings.max_tracks)))
        taken = np.zeros((gray.shape[0] // cell + 1, gray.shape[1] // cell + 1), bool)
        columns, rows = (self._px / cell).astype(np.int64).T
        taken[rows, columns] = True
        mask = _empty_cells(taken, cell, gray.shape) & self._camera.usable

        # 2. FAST corners there, with half of the threshold where they are few.
        found = cv2.FastFeatureDetector.create(threshold=settings.fast_threshold).detect(gray, mask)
        if len(found) < CORNERS_PER_TRACK * missing:
            found = cv2.FastFeatureDetector.create(threshold=max(2, settings.fast_threshold // 2)).detect(gray, mask)
        px = np.asarray(cv2.KeyPoint.convert(found), dtype=np.float64).reshape(-1, 2)
        response = np.fromiter((k.response for k in found), np.float64, len(found))

        # 3. The strongest of each cell, the strongest cells first.
        px = px[np.argsort(-response, kind="stable")]
        cells = (px / cell).astype(np.int64)
        _, best = np.unique(cells[:, 1] * taken.shape[1] + cells[:, 0], return_index=True)
        chosen = px[np.sort(best)]
        chosen = chosen[self._far_from_tracked(chosen)][:missing]
        self._px = np.vstack([self._px, chosen.astype(np.float32)])
        self._ids = np.concatenate([self._ids, np.arange(self._next_id, self._next_id + len(chosen))])
        self._next_id += len(chosen)

    def _far_from_tracked(self, px: Float) -> NDArray[np.bool_]:
        """Return which pixels (N, 2) are half of the minimum distance or more from every tracked feature, (N,)."""

        if not len(self._px) or not len(px):
            return np.ones(len(px), bool)
        tracked = self._px.astype(np.float64)
        dx, dy = px[:, None, 0] - tracked[:, 0], px[:, None, 1] - tracked[:, 1]
        return np.asarray((dx * dx + dy * dy).min(axis=1) >= (0.5 * self._settings.min_distance_px) ** 2)


def _empty_cells(taken: NDArray[np.bool_], cell: int, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Return a mask of the image, 255 in cells that are not ``taken`` and away from the border."""
    mask = np.zeros(shape, np.uint8)
    inner = np.s_[BORDER_PX:-BORDER_PX, BORDER_PX:-BORDER_PX]
    free = np.where(taken, 0, 255).astype(np.uint8)
    mask[inner] = free.repeat(cell, axis=0).repeat(cell, axis=1)[: shape[0], : shape[1]][inner]
    return mask
