"""The camera model: pixels to normalised image coordinates (x/z, y/z) and back."""

import cv2
import numpy as np
from numpy.typing import NDArray

from snakeslam.calibration import CameraCalibration
from snakeslam.messages import Float


class PinholeCamera:
    """A pinhole camera with radtan, equidistant or no distortion; distortion is removed once, at the border."""

    def __init__(self, calibration: CameraCalibration) -> None:
        fx, fy, cx, cy = calibration.intrinsics
        self.K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        self.width_px, self.height_px = calibration.resolution
        self.focal_px = float(np.sqrt(fx * fy))
        self._model = calibration.distortion_model
        self._coefficients = np.array(calibration.distortion_coeffs or (0.0,) * 4, dtype=np.float64)

    def normalise(self, px: NDArray[np.floating]) -> Float:
        """Return undistorted (x/z, y/z) of pixels, (N, 2) -> (N, 2)."""
        if len(px) == 0:
            return np.empty((0, 2))
        points = np.ascontiguousarray(px, dtype=np.float64).reshape(-1, 1, 2)
        if self._model == "none":
            return (points[:, 0] - self.K[:2, 2]) / np.diag(self.K)[:2]
        undistort = cv2.fisheye.undistortPoints if self._model == "equidistant" else cv2.undistortPoints
        return np.asarray(undistort(points, self.K, self._coefficients), dtype=np.float64).reshape(-1, 2)

    def distort(self, xy: Float) -> Float:
        """Return the pixels of normalised coordinates, (N, 2) -> (N, 2)."""
        if len(xy) == 0:
            return np.empty((0, 2))
        if self._model == "none":
            return xy * np.diag(self.K)[:2] + self.K[:2, 2]
        if self._model == "equidistant":
            points = np.ascontiguousarray(xy, dtype=np.float64).reshape(-1, 1, 2)
            px = cv2.fisheye.distortPoints(points, self.K, self._coefficients)
            return np.asarray(px, dtype=np.float64).reshape(-1, 2)
        rays = np.hstack([xy, np.ones((len(xy), 1))]).reshape(-1, 1, 3)
        px, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), self.K, self._coefficients)
        return np.asarray(px, dtype=np.float64).reshape(-1, 2)

    def project(self, points_C: Float) -> Float:
        """Return the pixels of points in front of the camera, (N, 3) m -> (N, 2)."""
        return self.distort(points_C[:, :2] / points_C[:, 2:])
