"""Points of the world with descriptors, made by keyframes and averaged over what is seen of them later."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.orb import OrbFeatures
from snakeslam.estimation.settings import NoiseSettings
from snakeslam.geometry import se3
from snakeslam.messages import Float


@dataclass(frozen=True, slots=True)
class Keyframe:
    """A frame that made points: its pose, its features, and the map point of each (-1 = none)."""

    T_WC: Float
    features: OrbFeatures
    points: NDArray[np.int64]


class LocalMap:
    """Growing arrays of points: ``p_W`` (N, 3), ``words`` (N, 4), the weight each position carries."""

    def __init__(self, noise: NoiseSettings, sigma_xy: float) -> None:
        self._noise, self._sigma_xy = noise, sigma_xy
        self.p_W = np.empty((0, 3))
        self.words = np.empty((0, 4), np.uint64)
        self.weight = np.empty(0)
        self.seen = np.empty(0, np.int64)
        self.missed = np.empty(0, np.int64)
        self.keyframes: list[Keyframe] = []

    def __len__(self) -> int:
        return len(self.p_W)

    def _lift(self, T_WC: Float, features: OrbFeatures, rows: NDArray[np.int64]) -> tuple[Float, Float]:
        """Return points in W and their weights (1/variance of the depth, 1/m^2)."""
        z = features.depth_m[rows]
        p_C = np.column_stack([features.xy[rows] * z[:, None], z])
        sigma_m = self._noise.depth_offset_m + self._noise.depth_square_per_m * z**2 + self._sigma_xy * z
        return se3.act(T_WC, p_C), 1.0 / sigma_m**2

    def usable(self, depth_m: Float) -> NDArray[np.bool_]:
        """Return which depths may make points."""
        return np.asarray((depth_m >= self._noise.depth_min_m) & (depth_m <= self._noise.depth_max_m))

    def add_keyframe(self, T_WC: Float, features: OrbFeatures, points: NDArray[np.int64]) -> None:
        """Add a keyframe whose features match ``points`` (M,) of the map, -1 = none: those with a depth become new ones."""
        new = np.flatnonzero((points < 0) & self.usable(features.depth_m))
        p_W, weight = self._lift(T_WC, features, new)
        points = points.copy()
        points[new] = np.arange(len(self), len(self) + len(new))
        self.p_W = np.vstack([self.p_W, p_W])
        self.words = np.vstack([self.words, features.words[new]])
        self.weight = np.concatenate([self.weight, weight])
        self.seen = np.concatenate([self.seen, np.ones(len(new), np.int64)])
        self.missed = np.concatenate([self.missed, np.zeros(len(new), np.int64)])
        self.keyframes.append(Keyframe(T_WC, features, points))

    def fuse(self, T_WC: Float, features: OrbFeatures, rows: NDArray[np.int64], points: NDArray[np.int64]) -> None:
        """Average points with what a frame measures of them."""
        deep = self.usable(features.depth_m[rows])
        rows, points = rows[deep], points[deep]
        p_W, weight = self._lift(T_WC, features, rows)
        total = self.weight[points] + weight
        self.p_W[points] += (p_W - self.p_W[points]) * (weight / total)[:, None]
        self.weight[points] = total

    def count(self, expected: NDArray[np.int64], found: NDArray[np.int64]) -> None:
        """Keep count of how often points were seen where they should be."""
        self.missed[expected] += 1
        self.missed[found] -= 1
        self.seen[found] += 1

    def in_view(self, T_WC: Float, half_angle_tan: Float) -> NDArray[np.int64]:
        """Return the points that a camera at ``T_WC`` should see, of those that are found often enough."""
        p_C = se3.act(se3.inv(T_WC), self.p_W)
        z = np.maximum(p_C[:, 2], 1e-6)
        inside = (p_C[:, 2] > 0.1) & np.all(np.abs(p_C[:, :2]) < half_angle_tan * z[:, None], axis=-1)
        return np.flatnonzero(inside & (self.seen * 4 >= self.missed))
