"""ORB features, spread evenly over the image, and their matching by Hamming distance."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.orb_map.settings import OrbMapSettings
from snakeslam.messages import Float

DETECTED_PER_KEPT = 3
"""Corners that are detected for each one that is kept, so that the choice can be spread over the image."""
MIN_CELL_PX, KEPT_PER_CELL = 8.0, 4.0
"""Least side of a cell of the grid, and how many corners are kept in each on average."""
WORDS = 4
"""A descriptor of 256 bits is held as so many words of 64 bits."""
NO_MATCH = 257
"""A distance above every possible one."""
DISTANCE_SHIFT, ROW_SHIFT = 20, 30
"""Bit positions of distance and row in a packed key: 20 bits of column, 10 of distance, 34 of row."""
Descriptors = NDArray[np.uint64]


@dataclass(frozen=True, slots=True)
class OrbFeatures:
    """Features of one image: ``px`` (N, 2) distorted, ``scale`` (N,) of their level, ``descriptors`` (N, 4) words."""

    px: NDArray[np.float32]
    scale: Float
    descriptors: Descriptors

    def __len__(self) -> int:
        return len(self.px)

    def pick(self, chosen: NDArray[np.bool_]) -> "OrbFeatures":
        """Return the ``chosen`` features (N,)."""
        return OrbFeatures(self.px[chosen], self.scale[chosen], self.descriptors[chosen])


class OrbExtractor:
    """Finds the strongest corners of each cell of a grid over all pyramid levels, and describes them [Rublee11]."""

    def __init__(self, settings: OrbMapSettings) -> None:
        self._count = settings.features
        self._scale = settings.pyramid_scale
        self._orb = cv2.ORB.create(
            nfeatures=DETECTED_PER_KEPT * settings.features,
            scaleFactor=settings.pyramid_scale,
            nlevels=settings.pyramid_levels,
            fastThreshold=settings.fast_threshold,
        )

    def extract(self, gray: NDArray[np.uint8]) -> OrbFeatures:
        """Return at most about ``features`` features of an image (H, W)."""
        found = self._orb.detect(gray)
        if not found:
            return OrbFeatures(np.empty((0, 2), np.float32), np.empty(0), np.empty((0, WORDS), np.uint64))
        px = np.array(cv2.KeyPoint.convert(found), dtype=np.float32).reshape(-1, 2)
        response = np.array([keypoint.response for keypoint in found])
        kept = spread(px, response, gray.shape, self._count)
        keypoints, described = self._orb.compute(gray, [found[k] for k in kept])
        if not len(keypoints):
            return OrbFeatures(np.empty((0, 2), np.float32), np.empty(0), np.empty((0, WORDS), np.uint64))
        return OrbFeatures(
            px=np.array(cv2.KeyPoint.convert(keypoints), dtype=np.float32).reshape(-1, 2),
            scale=self._scale ** np.array([float(keypoint.octave) for keypoint in keypoints]),
            descriptors=np.ascontiguousarray(described, dtype=np.uint8).view(np.uint64),
        )


def spread(px: NDArray[np.float32], response: Float, shape: tuple[int, ...], count: int) -> NDArray[np.int64]:
    """Return the indices of ``count`` corners: the best of each cell, then the second best of each, and so on."""
    # Rank of each corner within its cell, by response; then the corners by rank.
    cell_px = max(MIN_CELL_PX, float(np.sqrt(KEPT_PER_CELL * shape[0] * shape[1] / count)))
    columns = int(shape[1] / cell_px) + 1
    cell = (px[:, 1] / cell_px).astype(np.int64) * columns + (px[:, 0] / cell_px).astype(np.int64)
    order = np.lexsort((-response, cell))
    starts = np.flatnonzero(np.r_[True, np.diff(cell[order]) > 0])
    sizes = np.diff(np.r_[starts, len(order)])
    rank = np.arange(len(order)) - np.repeat(starts, sizes)
    by_rank = np.lexsort((-response[order], rank))
    return order[by_rank[:count]]


def hamming(a: Descriptors, b: Descriptors) -> NDArray[np.uint16]:
    """Return the number of differing bits of descriptors (..., 4) and (..., 4), broadcast."""
    words = np.bitwise_count(a ^ b).astype(np.uint16)
    # numpy's sum over a short axis is much slower.
    return np.asarray(words[..., 0] + words[..., 1] + words[..., 2] + words[..., 3])


@dataclass(frozen=True, slots=True)
class IndexPairs:
    """M pairs of indices: ``point`` (M,) of the map, ``feature`` (M,) of the image; each occurs once."""

    point: NDArray[np.int64]
    feature: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.point)


def best_pairs(
    rows: NDArray[np.int64], columns: NDArray[np.int64], distance: NDArray[np.uint16], max_distance: int, ratio: float
) -> IndexPairs:
    """Return the candidates that are mutually best, within ``max_distance`` and below ``ratio`` times the second best.

    Candidate k pairs ``rows[k]`` with ``columns[k]`` at the Hamming distance ``distance[k]``; all are (K,).
    """
    if not len(rows):
        return IndexPairs(np.empty(0, np.int64), np.empty(0, np.int64))
    # Sort by (row, distance, column); one sort of packed keys is several times faster than one by three keys.
    key = np.sort((rows << ROW_SHIFT) | (distance.astype(np.int64) << DISTANCE_SHIFT) | columns)
    rows, distances, columns = _unpack(key)
    first = np.flatnonzero(np.r_[True, rows[1:] > rows[:-1]])
    has_second = np.r_[first[1:], len(rows)] > first + 1
    second = np.where(has_second, distances[np.minimum(first + 1, len(rows) - 1)], NO_MATCH)
    best = distances[first]
    chosen = first[(best <= max_distance) & (best <= ratio * second)]
    if not len(chosen):
        return IndexPairs(np.empty(0, np.int64), np.empty(0, np.int64))
    # Of several rows with the same best column, keep the nearest.
    by_column = np.sort((columns[chosen] << ROW_SHIFT) | (distances[chosen] << DISTANCE_SHIFT) | np.arange(len(chosen)))
    column, _, k = _unpack(by_column)
    kept = chosen[np.sort(k[np.r_[True, column[1:] > column[:-1]]])]
    return IndexPairs(rows[kept], columns[kept])


def _unpack(key: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    distance = (key >> DISTANCE_SHIFT) & ((1 << (ROW_SHIFT - DISTANCE_SHIFT)) - 1)
    return key >> ROW_SHIFT, distance, key & ((1 << DISTANCE_SHIFT) - 1)
