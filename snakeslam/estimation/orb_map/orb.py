"""ORB features spread evenly over the picture, and their matching by Hamming distance."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.orb_map.settings import OrbMapSettings
from snakeslam.messages import Float

DETECTED_PER_KEPT = 3
WORDS = 4
NO_MATCH = 257
DISTANCE_SHIFT, ROW_SHIFT = 20, 30
Descriptors = NDArray[np.uint64]


@dataclass(frozen=True, slots=True)
class OrbFeatures:
    """One picture's features: ``px`` (N, 2) as seen, ``scale`` (N,) of their level, ``descriptors`` (N, 4) words."""

    px: NDArray[np.float32]
    scale: Float
    descriptors: Descriptors

    def __len__(self) -> int:
        return len(self.px)

    def pick(self, chosen: NDArray[np.bool_]) -> "OrbFeatures":
        """Return some of them, ``chosen`` (N,)."""
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
        """Return at most about ``features`` features of a picture (H, W)."""
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
    """Return the indices of about ``count`` corners, cell by cell: first each one's best, then its second, ..."""
    cell_px = max(8.0, float(np.sqrt(4.0 * shape[0] * shape[1] / count)))
    columns = int(shape[1] / cell_px) + 1
    cell = (px[:, 1] / cell_px).astype(np.int64) * columns + (px[:, 0] / cell_px).astype(np.int64)
    order = np.lexsort((-response, cell))
    starts = np.flatnonzero(np.r_[True, np.diff(cell[order]) > 0])
    sizes = np.diff(np.r_[starts, len(order)])
    rank = np.arange(len(order)) - np.repeat(starts, sizes)
    by_rank = np.lexsort((-response[order], rank))
    return order[by_rank[:count]]


def hamming(a: Descriptors, b: Descriptors) -> NDArray[np.uint16]:
    """Return the differing bits of descriptors (..., 4) and (..., 4), broadcast."""
    words = np.bitwise_count(a ^ b).astype(np.uint16)
    # Much faster than a sum over a short axis.
    return np.asarray(words[..., 0] + words[..., 1] + words[..., 2] + words[..., 3])


@dataclass(frozen=True, slots=True)
class Matches:
    """Pairs: ``point`` (M,) indexes the first set, ``feature`` (M,) the second; each occurs once."""

    point: NDArray[np.int64]
    feature: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.point)


def best_pairs(
    rows: NDArray[np.int64], columns: NDArray[np.int64], distance: NDArray[np.uint16], max_distance: int, ratio: float
) -> Matches:
    """Return the candidate pairs that are each other's best, near enough and clearly better than the row's second."""
    if not len(rows):
        return Matches(np.empty(0, np.int64), np.empty(0, np.int64))
    # One sort of packed keys is several times faster than sorting by several keys.
    key = np.sort((rows << ROW_SHIFT) | (distance.astype(np.int64) << DISTANCE_SHIFT) | columns)
    rows, distances, columns = _unpack(key)
    first = np.flatnonzero(np.r_[True, rows[1:] > rows[:-1]])
    has_second = np.r_[first[1:], len(rows)] > first + 1
    runner_up = np.where(has_second, distances[np.minimum(first + 1, len(rows) - 1)], NO_MATCH)
    best = distances[first]
    chosen = first[(best <= max_distance) & (best <= ratio * runner_up)]
    if not len(chosen):
        return Matches(np.empty(0, np.int64), np.empty(0, np.int64))
    by_column = np.sort((columns[chosen] << ROW_SHIFT) | (distances[chosen] << DISTANCE_SHIFT) | np.arange(len(chosen)))
    column, _, k = _unpack(by_column)
    kept = chosen[np.sort(k[np.r_[True, column[1:] > column[:-1]]])]
    return Matches(rows[kept], columns[kept])


def _unpack(key: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    distance = (key >> DISTANCE_SHIFT) & ((1 << (ROW_SHIFT - DISTANCE_SHIFT)) - 1)
    return key >> ROW_SHIFT, distance, key & ((1 << DISTANCE_SHIFT) - 1)
