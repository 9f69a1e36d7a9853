"""Which map points a picture shows, and the pose that they give."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from snakeslam.estimation.camera import PinholeCamera
from snakeslam.estimation.frontend import sample_depth
from snakeslam.estimation.orb import Matches, OrbExtractor, OrbFeatures, best_pairs, hamming
from snakeslam.estimation.pnp import MIN_Z_M, PoseFit, Sightings, ransac_pose, refine_pose
from snakeslam.estimation.settings import NoiseSettings
from snakeslam.estimation.visual_map import VisualMap
from snakeslam.estimation.visual_settings import VisualSettings
from snakeslam.messages import CameraFrame, Float

REFERENCE_FOCAL_PX = 500.0
RANSAC_THRESHOLD_PX = 4.0
MARGIN = 0.1
UNKNOWN_EXPOSURE_S = 0.01
BLUR_TO_SIGMA = 0.3
BLOCK = 256


@dataclass(frozen=True, slots=True)
class View:
    """What one frame shows: features, ``xyz`` (N, 3) normalised x, y and depth in m (0 = unknown), 1/sigma (N, 3)."""

    features: OrbFeatures
    xyz: Float
    weights: Float

    def __len__(self) -> int:
        return len(self.xyz)

    @property
    def has_depth(self) -> NDArray[np.bool_]:
        """Which features have a depth that is trusted (N,)."""
        return np.asarray(self.weights[:, 2] > 0.0)


@dataclass(frozen=True, slots=True)
class Match:
    """Pairs of map points (M,) and features (M,) with their pixels and ids, and the pose fitted to them."""

    point: NDArray[np.int64]
    feature: NDArray[np.int64]
    px: NDArray[np.float32]
    ids: NDArray[np.int64]
    fit: PoseFit

    @property
    def agreeing(self) -> int:
        """Pairs that agree with the pose."""
        return int(np.count_nonzero(self.fit.inliers))


def look(
    frame: CameraFrame, orb: OrbExtractor, camera: PinholeCamera, noise: NoiseSettings, rate_rad_s: float
) -> View:
    """Return a frame's features with depth and noise; blur from a turn of ``rate_rad_s`` widens the noise."""
    features = orb.extract(frame.gray)
    z = sample_depth(frame.depth_m, features.px)
    z = np.where((z >= noise.depth_min_m) & (z <= noise.depth_max_m), z, 0.0)
    blur_px = rate_rad_s * camera.focal_px * (frame.exposure_ns / 1e9 or UNKNOWN_EXPOSURE_S)
    sigma_px = np.hypot(noise.pixel_px * features.scale, BLUR_TO_SIGMA * blur_px)
    w_xy = camera.focal_px / sigma_px
    sigma_z = noise.depth_offset_m + noise.depth_square_per_m * z**2
    weights = np.stack([w_xy, w_xy, np.where(z > 0.0, 1.0 / sigma_z, 0.0)], axis=-1)
    return View(features, np.column_stack([camera.normalise(features.px), z]), weights)


class Matcher:
    """Matches features with the map, near a predicted pose or anywhere."""

    def __init__(self, settings: VisualSettings, camera: PinholeCamera, seed: int) -> None:
        self._settings = settings
        self._camera = camera
        self._seed = seed
        corners = np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * [camera.width_px - 1.0, camera.height_px - 1.0]
        limits = camera.normalise(corners)
        self._low, self._high = limits.min(axis=0) - MARGIN, limits.max(axis=0) + MARGIN

    def near(self, view: View, known: VisualMap, T_WC: Float) -> Match | None:
        """Return the match around a predicted pose: a wide search, RANSAC, then a close search."""
        wide = self._search(view, known, T_WC, self._settings.search_px)
        start = self._consensus(view, known, wide)
        return None if start is None else self._closely(view, known, start)

    def anywhere(self, view: View, known: VisualMap, T_WC: Float) -> Match | None:
        """Return the match of a picture whose pose is not known, by its descriptors alone."""
        del T_WC
        start = self._consensus(view, known, self._all_pairs(view, known))
        return None if start is None else self._closely(view, known, start)

    def _closely(self, view: View, known: VisualMap, T_WC: Float) -> Match | None:
        pairs = self._search(view, known, T_WC, self._settings.refine_px)
        fit = refine_pose(T_WC, _sightings(view, known, pairs))
        if fit is None:
            return None
        px, ids = view.features.px[pairs.feature], known.points.ids[pairs.point]
        return Match(pairs.point, pairs.feature, px, ids, fit)

    def _consensus(self, view: View, known: VisualMap, pairs: Matches) -> Float | None:
        seen = _sightings(view, known, pairs)
        T_WC = ransac_pose(seen, self._camera.focal_px, RANSAC_THRESHOLD_PX, self._seed)
        if T_WC is None:
            return None
        fit = refine_pose(T_WC, seen)
        return None if fit is None else fit.T_WC

    def _search(self, view: View, known: VisualMap, T_WC: Float, radius_px: float) -> Matches:
        """Match each visible map point with the features around the place where the pose puts it."""
        q = (known.points.points_W - T_WC[:3, 3]) @ T_WC[:3, :3]
        z = np.maximum(q[:, 2], MIN_Z_M)
        xy = q[:, :2] / z[:, None]
        visible = np.flatnonzero((q[:, 2] > MIN_Z_M) & np.all((xy > self._low) & (xy < self._high), axis=-1))
        radius = radius_px / REFERENCE_FOCAL_PX
        if not len(visible) or not len(view):
            return Matches(np.empty(0, np.int64), np.empty(0, np.int64))
        near = cKDTree(xy[visible]).sparse_distance_matrix(
            cKDTree(view.xyz[:, :2]), radius, output_type="coo_matrix"
        )
        order = np.lexsort((near.col, near.row))
        rows, columns = visible[near.row[order]], near.col[order].astype(np.int64)
        bits = hamming(known.points.descriptors[rows], view.features.descriptors[columns, None]).min(axis=-1)
        return best_pairs(rows, columns, bits, self._settings.max_hamming, self._settings.match_ratio)

    def _all_pairs(self, view: View, known: VisualMap) -> Matches:
        """Match every feature with every map point, in blocks that fit the cache."""
        best = np.empty(len(view), np.int64)
        point = np.empty(len(view), np.int64)
        runner_up = np.empty(len(view), np.int64)
        first_looks = known.points.descriptors[:, 0]
        for k, descriptor in enumerate(view.features.descriptors):
            bits = hamming(first_looks, descriptor)
            point[k] = np.argmin(bits)
            best[k] = bits[point[k]]
            bits[point[k]] = 257
            runner_up[k] = bits.min()
        clear = np.flatnonzero((best <= self._settings.max_hamming) & (best <= self._settings.match_ratio * runner_up))
        return Matches(point[clear], clear)


def _sightings(view: View, known: VisualMap, pairs: Matches) -> Sightings:
    return Sightings(known.points.points_W[pairs.point], view.xyz[pairs.feature], view.weights[pairs.feature])
