"""One image's ORB features with depth and noise, and their match with the map."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.imaging.camera import PinholeCamera
from snakeslam.estimation.imaging.depth_sampling import sample_depth
from snakeslam.estimation.measurements.settings import NoiseSettings
from snakeslam.estimation.orb_map.orb import OrbExtractor, OrbFeatures
from snakeslam.estimation.orb_map.pnp import PoseFit
from snakeslam.messages import CameraFrame, Float

UNKNOWN_EXPOSURE_S = 0.01
"""Exposure assumed of a frame that does not report its own."""
BLUR_TO_SIGMA = 0.3
"""Sigma of a feature over the length of its motion blur: that of a uniform distribution, 1 / sqrt(12) = 0.29."""


@dataclass(frozen=True, slots=True)
class OrbView:
    """ORB features of one frame, ``xyz`` (N, 3) normalised x, y and depth in m (0 = unknown), ``weights`` 1/sigma."""

    features: OrbFeatures
    xyz: Float
    weights: Float

    def __len__(self) -> int:
        return len(self.xyz)

    @property
    def has_depth(self) -> NDArray[np.bool_]:
        """Which features have a depth within the trusted range, (N,)."""
        return np.asarray(self.weights[:, 2] > 0.0)


@dataclass(frozen=True, slots=True)
class Match:
    """M pairs of map points and features with pixels and ids, the pose fitted to them, the V points it should show."""

    point: NDArray[np.int64]
    feature: NDArray[np.int64]
    px: NDArray[np.float32]
    ids: NDArray[np.int64]
    visible: NDArray[np.int64]
    fit: PoseFit

    @property
    def inlier_count(self) -> int:
        """Number of inliers of the pose."""
        return int(np.count_nonzero(self.fit.inliers))


def extract_view(
    frame: CameraFrame, orb: OrbExtractor, camera: PinholeCamera, noise: NoiseSettings, rate_rad_s: float
) -> OrbView:
    """Return a frame's features with depth and noise; a rotation at ``rate_rad_s`` adds motion blur.

    sigma_px^2 = (pixel_px scale)^2 + (0.3 f rate exposure)^2, sigma_z = a + b z^2.
    """
    features = orb.extract(frame.gray)
    features = features.pick(camera.usable_at(features.px))
    z = sample_depth(frame.depth_m, features.px)
    z = np.where((z >= noise.depth_min_m) & (z <= noise.depth_max_m), z, 0.0)
    blur_px = rate_rad_s * camera.focal_px * (frame.exposure_ns / 1e9 or UNKNOWN_EXPOSURE_S)
    sigma_px = np.hypot(noise.pixel_px * features.scale, BLUR_TO_SIGMA * blur_px)
    w_xy = camera.focal_px / sigma_px
    sigma_z = noise.depth_offset_m + noise.depth_square_per_m * z**2
    weights = np.stack([w_xy, w_xy, np.where(z > 0.0, 1.0 / sigma_z, 0.0)], axis=-1)
    return OrbView(features, np.column_stack([camera.normalise(features.px), z]), weights)
