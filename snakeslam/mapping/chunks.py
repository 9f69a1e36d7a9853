"""One keyframe's depth picture as coloured points in its camera's frame."""

import cv2
import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.camera import PinholeCamera
from snakeslam.mapping.settings import MappingSettings
from snakeslam.messages import CameraFrame

PIXEL_STEP = 4


def chunk_points(
    frame: CameraFrame, camera: PinholeCamera, settings: MappingSettings
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Return points_K (N, 3) m and rgb (N, 3) of a frame: trusted depths, one point a voxel, at most ``max_points``."""
    if frame.depth_m is None:
        return np.empty((0, 3), np.float32), np.empty((0, 3), np.uint8)
    v, u = np.nonzero(trusted_depth(frame.depth_m, settings)[::PIXEL_STEP, ::PIXEL_STEP])
    v, u = v * PIXEL_STEP, u * PIXEL_STEP
    rays = camera.normalise(np.stack([u, v], axis=-1).astype(np.float64))
    z = frame.depth_m[v, u].astype(np.float64)[:, None]
    points = np.hstack([rays * z, z])
    chosen = _thin(points, settings)
    colours = frame.rgb if frame.rgb is not None else np.repeat(frame.gray[..., None], 3, axis=-1)
    return points[chosen].astype(np.float32), colours[v[chosen], u[chosen]]


def trusted_depth(depth_m: NDArray[np.float32], settings: MappingSettings) -> NDArray[np.bool_]:
    """Return where depth is in range and no edge is near, (H, W) bool."""
    kernel = np.ones((3, 3), np.uint8)
    nearest, farthest = cv2.erode(depth_m, kernel), cv2.dilate(depth_m, kernel)
    flat = farthest - nearest <= settings.edge_ratio * depth_m
    return flat & (nearest >= settings.depth_min_m) & (farthest <= settings.depth_max_m)


def _thin(points: NDArray[np.float64], settings: MappingSettings) -> NDArray[np.int64]:
    """Return the indices of one point a voxel, evenly cut down to ``max_points``."""
    if not len(points):
        return np.empty(0, np.int64)
    cell = np.floor(points / settings.voxel_m).astype(np.int64) + 2**20
    key = (cell[:, 0] << 42) | (cell[:, 1] << 21) | cell[:, 2]
    first = np.sort(np.unique(key, return_index=True)[1])
    if len(first) <= settings.max_points:
        return first
    return first[np.linspace(0, len(first) - 1, settings.max_points).astype(np.int64)]
