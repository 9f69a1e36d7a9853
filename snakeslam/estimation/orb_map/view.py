"""What one image shows: ORB features with depth and noise; and the pairs of features and map points found in it."""

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

BLUR_TO_SIGMA = 0.3


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
    """Pairs of map points and features (M,), their pixels and ids; the pose they give; points it should show (V,)."""

    point: NDArray[np.int64]
    feature: NDArray[np.int64]
    px: NDArray[np.float32]
    ids: NDArray[np.int64]
    visible: NDArray[np.int64]
    fit: PoseFit

    @property
    def agreeing(self) -> int:
        """Pairs that agree with the pose."""
        return int(np.count_nonzero(self.fit.inliers))


def look(frame: CameraFrame, orb: OrbExtractor, camera: PinholeCamera, noise: NoiseSettings, rate_rad_s: float) -> View:
    """Return a frame's features with depth and noise; blur from a turn of ``rate_rad_s`` widens the noise."""
    features = orb.extract(frame.gray)
    features = features.pick(camera.usable_at(features.px))
    z = sample_depth(frame.depth_m, features.px)
    z = np.where((z >= noise.depth_min_m) & (z <= noise.depth_max_m), z, 0.0)
    blur_px = rate_rad_s * camera.focal_px * (frame.exposure_ns / 1e9 or UNKNOWN_EXPOSURE_S)
    sigma_px = np.hypot(noise.pixel_px * features.scale, BLUR_TO_SIGMA * blur_px)
    w_xy = camera.focal_px / sigma_px
    sigma_z = noise.depth_offset_m + noise.depth_square_per_m * z**2
    weights = np.stack([w_xy, w_xy, np.where(z > 0.0, 1.0 / sigma_z, 0.0)], axis=-1)
    return View(features, np.column_stack([camera.normalise(features.px), z]), weights)
