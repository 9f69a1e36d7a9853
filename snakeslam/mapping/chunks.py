"""One keyframe's depth picture as coloured points in its camera's frame."""

import cv2
import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.imaging.camera import PinholeCamera
from snakeslam.mapping.settings import MappingSettings
from snakeslam.messages import CameraFrame

PIXEL_STEP = 4


def depth_points(
    frame: CameraFrame, camera: PinholeCamera, settings: MappingSettings
) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Return points_K (N, 3) m and rgb (N, 3) of a frame's trusted depths, one for each PIXEL_STEP pixels."""
    if frame.depth_m is None:
        return np.empty((0, 3)), np.empty((0, 3), np.uint8)
    trusted = trusted_depth(frame.depth_m, settings) & (camera.usable > 0)
    v, u = np.nonzero(trusted[::PIXEL_STEP, ::PIXEL_STEP])
    v, u = v * PIXEL_STEP, u * PIXEL_STEP
    rays = camera.normalise(np.stack([u, v], axis=-1).astype(np.float64))
    z = frame.depth_m[v, u].astype(np.float64)[:, None]
    colours = frame.rgb if frame.rgb is not None else np.repeat(frame.gray[..., None], 3, axis=-1)
    return np.hstack([rays * z, z]), colours[v, u]


def trusted_depth(depth_m: NDArray[np.float32], settings: MappingSettings) -> NDArray[np.bool_]:
    """Return where depth is in range and no edge is near, (H, W) bool."""
    kernel = np.ones((3, 3), np.uint8)
    nearest, farthest = cv2.erode(depth_m, kernel), cv2.dilate(depth_m, kernel)
    flat = farthest - nearest <= settings.edge_ratio * depth_m
    return flat & (nearest >= settings.depth_min_m) & (farthest <= settings.depth_max_m)
