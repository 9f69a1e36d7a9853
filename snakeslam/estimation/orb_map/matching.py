"""Matching of an image with the map, and the camera's pose from it."""

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from snakeslam.estimation.imaging.camera import PinholeCamera
from snakeslam.estimation.orb_map.keyframe_map import OrbMap
from snakeslam.estimation.orb_map.orb import IndexPairs, best_pairs, hamming
from snakeslam.estimation.orb_map.pnp import MIN_Z_M, PointObservations, ransac_pose, refine_pose
from snakeslam.estimation.orb_map.settings import OrbMapSettings
from snakeslam.estimation.orb_map.view import Match, OrbView
from snakeslam.messages import Float

REFERENCE_FOCAL_PX = 500.0
"""Focal length to which the search radii of the settings refer."""
RANSAC_THRESHOLD_PX = 4.0
MARGIN = 0.1
"""Normalised margin around the image within which points count as visible, since the predicted pose is uncertain."""
RECENT_FRAMES = 3
MIN_RECENT = 100
"""The first search uses the points matched in the last RECENT_FRAMES if there are so many, else all."""
OLD_FRAMES = 10
"""Points not matched for so many frames are candidates for closing a loop."""
CONSENSUS_SHARE = 0.15
"""Least share of the pairs that must be inliers of the first pose."""
NO_PAIRS = IndexPairs(np.empty(0, np.int64), np.empty(0, np.int64))


def _extremes(px: Float) -> Float:
    """Return the outermost of the pixels (N, 2) along the axes and the diagonals, (8, 2)."""
    along = px @ np.array([[1.0, 0.0, 1.0, 1.0], [0.0, 1.0, 1.0, -1.0]])
    return px[np.concatenate([along.argmin(axis=0), along.argmax(axis=0)])]


class Matcher:
    """IndexPairs features with the map, near a predicted pose or anywhere."""

    def __init__(self, settings: OrbMapSettings, camera: PinholeCamera, seed: int) -> None:
        self._settings = settings
        self._camera = camera
        self._seed = seed
        row, column = np.nonzero(camera.usable)
        limits = camera.normalise(_extremes(np.column_stack([column, row]).astype(np.float64)))
        self._low, self._high = limits.min(axis=0) - MARGIN, limits.max(axis=0) + MARGIN

    def near(self, view: OrbView, known: OrbMap, T_WC: Float) -> Match | None:
        """Return the match near a predicted pose: a wide search for recent points, then a narrow one for all."""
        # 1. Wide search for the points matched in the last frames, around their predicted projections.
        recent = np.flatnonzero(known.points.age <= RECENT_FRAMES)
        among = self._visible(known, T_WC, recent if len(recent) >= MIN_RECENT else None)
        wide = self._search(view, known, T_WC, among, self._settings.search_px)
        # 2. A first pose from these pairs; then a narrow search for all points from there.
        start = self._consensus(view, known, wide, T_WC)
        return None if start is None else self._match_narrow(view, known, start)

    def anywhere(self, view: OrbView, known: OrbMap) -> Match | None:
        """Return the match of an image with unknown pose, by its descriptors alone."""
        start = self._consensus(view, known, self._all_pairs(view, known), None)
        return None if start is None else self._match_narrow(view, known, start)

    def seen_before(self, view: OrbView, known: OrbMap, T_WC: Float) -> IndexPairs:
        """Return the inlier pairs with points not matched for some time, from which the map may have drifted."""
        old = self._visible(known, T_WC, np.flatnonzero(known.points.age > OLD_FRAMES))
        pairs = self._search(view, known, T_WC, old, self._settings.search_px)
        start = self._consensus(view, known, pairs, T_WC)
        match = None if start is None else self._match_narrow(view, known, start, old)
        if match is None or match.inlier_count < self._settings.relocalise_inliers:
            return NO_PAIRS
        return IndexPairs(match.point[match.fit.inliers], match.feature[match.fit.inliers])

    def _match_narrow(
        self, view: OrbView, known: OrbMap, T_WC: Float, among: NDArray[np.int64] | None = None
    ) -> Match | None:
        """Return the match by a narrow search around a pose that is about right; None without a pose from it."""
        visible = self._visible(known, T_WC, among)
        pairs = self._search(view, known, T_WC, visible, self._settings.refine_px)
        fit = refine_pose(T_WC, _observations(view, known, pairs))
        if fit is None:
            return None
        px, ids = view.features.px[pairs.feature], known.points.ids[pairs.point]
        return Match(pairs.point, pairs.feature, px, ids, visible, fit)

    def _consensus(self, view: OrbView, known: OrbMap, pairs: IndexPairs, T_WC: Float | None) -> Float | None:
        """Return the pose with the most inliers: refined from the prediction if that has enough, else by RANSAC."""
        seen = _observations(view, known, pairs)
        if T_WC is not None:
            fit = refine_pose(T_WC, seen)
            if fit is not None and np.count_nonzero(fit.inliers) >= max(MIN_RECENT, len(pairs) // 2):
                return fit.T_WC
        start = ransac_pose(seen, self._camera.focal_px, RANSAC_THRESHOLD_PX, self._seed)
        fit = None if start is None else refine_pose(start, seen)
        # A narrow search around any pose finds pairs that agree with it, so the pose needs enough inliers before that.
        least = max(self._settings.min_inliers, CONSENSUS_SHARE * len(pairs))
        return None if fit is None or np.count_nonzero(fit.inliers) < least else fit.T_WC

    def _visible(self, known: OrbMap, T_WC: Float, among: NDArray[np.int64] | None) -> NDArray[np.int64]:
        """Return which points, of those in ``among`` or of all, project into the image."""
        points_W = known.points.points_W if among is None else known.points.points_W[among]
        q = (points_W - T_WC[:3, 3]) @ T_WC[:3, :3]
        xy = q[:, :2] / np.maximum(q[:, 2:], MIN_Z_M)
        inside = np.flatnonzero((q[:, 2] > MIN_Z_M) & np.all((xy > self._low) & (xy < self._high), axis=-1))
        return inside if among is None else among[inside]

    def _search(
        self, view: OrbView, known: OrbMap, T_WC: Float, points: NDArray[np.int64], radius_px: float
    ) -> IndexPairs:
        """Match each point with the features within ``radius_px`` of its projection."""
        if not len(points) or not len(view):
            return NO_PAIRS
        # Candidates: features within the radius of the projection (x/z, y/z) of q = R_WC^T (p_W - p_WC).
        q = (known.points.points_W[points] - T_WC[:3, 3]) @ T_WC[:3, :3]
        xy = q[:, :2] / np.maximum(q[:, 2:], MIN_Z_M)
        near = cKDTree(xy).sparse_distance_matrix(
            cKDTree(view.xyz[:, :2]), radius_px / REFERENCE_FOCAL_PX, output_type="ndarray"
        )
        rows, columns = points[near["i"]], near["j"]
        # The distance of a point is the least over its descriptors.
        of_points, of_features = known.points.descriptors[rows], view.features.descriptors[columns]
        bits = hamming(of_points, of_features[:, None]).min(axis=-1)
        return best_pairs(rows, columns, bits, self._settings.max_hamming, self._settings.match_ratio)

    def _all_pairs(self, view: OrbView, known: OrbMap) -> IndexPairs:
        """Match every feature with every map point by the descriptor of its first observation."""
        if not len(view) or known.points.count < 2:
            return NO_PAIRS
        of_points = np.ascontiguousarray(known.points.descriptors[:, 0]).view(np.uint8)
        pairs = cv2.BFMatcher(cv2.NORM_HAMMING).knnMatch(view.features.descriptors.view(np.uint8), of_points, k=2)
        limit, ratio = self._settings.max_hamming, self._settings.match_ratio
        clear = [a for a, b in pairs if a.distance <= limit and a.distance <= ratio * b.distance]
        point, feature = np.array([[m.trainIdx, m.queryIdx] for m in clear], dtype=np.int64).reshape(-1, 2).T
        return IndexPairs(point, feature)


def _observations(view: OrbView, known: OrbMap, pairs: IndexPairs) -> PointObservations:
    return PointObservations(known.points.points_W[pairs.point], view.xyz[pairs.feature], view.weights[pairs.feature])
