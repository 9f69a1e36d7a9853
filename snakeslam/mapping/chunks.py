"""The depth image of one keyframe as coloured points in its camera's frame."""

import cv2
import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.imaging.camera import PinholeCamera
from snakeslam.mapping.settings import MappingSettings
from snakeslam.messages import CameraFrame

PIXEL_STEP = 4
"""Every fourth pixel of every fourth row becomes a point: at 2 m they are 1.5 cm apart, about a voxel."""


def depth_points(
    frame: CameraFrame, camera: PinholeCamera, settings: MappingSettings
) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Return points_K = z (x, y, 1) (N, 3) m and rgb (N, 3) of a frame's trusted depths, on a grid of PIXEL_STEP."""
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
    """Return where depth is in range and its 3x3 neighbourhood holds no edge, (H, W) bool."""
    kernel = np.ones((3, 3), np.uint8)
    nearest, farthest = cv2.erode(depth_m, kernel), cv2.dilate(depth_m, kernel)
    flat = farthest - nearest <= settings.edge_ratio * depth_m
    return flat & (nearest >= settings.depth_min_m) & (farthest <= settings.depth_max_m)
