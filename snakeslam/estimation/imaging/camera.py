"""The camera model: pixels to normalised image coordinates (x/z, y/z) and back."""

import cv2
import numpy as np
from numpy.typing import NDArray

from snakeslam.calibration import CameraCalibration
from snakeslam.messages import Float

UNDISTORT_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 400, 1e-6)
"""Most iterations on the inverse of the distortion, and the error in px at which they end. OpenCV's default of 5
iterations leaves 0.29 px at the rim of EuRoC's radtan camera."""
MAX_ROUND_TRIP_PX = 0.05
"""Largest distance between a pixel and its ray distorted again: beyond it the inverse has not converged."""
MAX_ANGLE_RAD = np.deg2rad(80.0)
"""Largest angle of a ray from the optical axis: at 90 deg (x/z, y/z) is infinite, and so is, near it, the noise."""
GRID_PX = 4
"""Spacing of the grid on which the validity of rays is evaluated; a distortion varies slowly over 4 px."""
RADIAL_STEP = 1.001
"""Factor on (x, y) of the second ray, with which the distortion is tested for being monotonic in the radius."""


class PinholeCamera:
    """A pinhole camera with radtan, equidistant or no distortion.

    Pixels are undistorted once, as they enter; everything behind works on (x, y) = (X/Z, Y/Z).
    """

    def __init__(self, calibration: CameraCalibration) -> None:
        fx, fy, cx, cy = calibration.intrinsics
        self.K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        self.width_px, self.height_px = calibration.resolution
        self.focal_px = float(np.sqrt(fx * fy))
        self._model = calibration.distortion_model
        self._coefficients = np.array(calibration.distortion_coeffs or (0.0,) * 4, dtype=np.float64)
        self.usable = self._usable()
        """Mask of the pixels that have a ray, (H, W) uint8, 255 or 0; see ``has_ray``."""

    def normalise(self, px: NDArray[np.floating]) -> Float:
        """Return undistorted (x/z, y/z) of pixels, (N, 2) -> (N, 2)."""
        if len(px) == 0:
            return np.empty((0, 2))
        points = np.ascontiguousarray(px, dtype=np.float64).reshape(-1, 1, 2)
        if self._model == "none":
            return (points[:, 0] - self.K[:2, 2]) / np.diag(self.K)[:2]
        undistort = cv2.fisheye.undistortPoints if self._model == "equidistant" else cv2.undistortPoints
        xy = undistort(points, self.K, self._coefficients, criteria=UNDISTORT_CRITERIA)
        return np.asarray(xy, dtype=np.float64).reshape(-1, 2)

    def has_ray(self, px: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Return which pixels (N, 2) have exactly one ray, (N,).

        The inverse of the distortion is verified: distorting the ray gives the pixel again, a ray farther out is
        projected farther out (beyond the maximum of a distortion curve two rays share a pixel), and the ray is at most
        80 deg from the optical axis.
        """
        xy = self.normalise(px)
        good = np.all(np.isfinite(xy), axis=1) & (np.hypot(xy[:, 0], xy[:, 1]) < np.tan(MAX_ANGLE_RAD))
        xy = np.where(good[:, None], xy, 0.0)
        back, farther = self.distort(xy), self.distort(RADIAL_STEP * xy)
        good &= np.linalg.norm(back - px, axis=1) < MAX_ROUND_TRIP_PX
        centre_px = self.K[:2, 2]
        return good & (np.linalg.norm(farther - centre_px, axis=1) >= np.linalg.norm(back - centre_px, axis=1))

    def _usable(self) -> NDArray[np.uint8]:
        """Return the mask of pixels with a ray, evaluated on a grid; a cell is usable if all its four corners are."""
        columns, rows = self.width_px // GRID_PX + 2, self.height_px // GRID_PX + 2
        u, v = np.meshgrid(np.arange(columns) * float(GRID_PX), np.arange(rows) * float(GRID_PX))
        # The last row and column of the grid would lie beyond the image, where a ray need not exist.
        limit = np.array([self.width_px - 1.0, self.height_px - 1.0])
        corners = self.has_ray(np.minimum(np.stack([u.ravel(), v.ravel()], axis=-1), limit)).reshape(rows, columns)
        cells = corners[:-1, :-1] & corners[1:, :-1] & corners[:-1, 1:] & corners[1:, 1:]
        mask = np.repeat(np.repeat(cells, GRID_PX, axis=0), GRID_PX, axis=1)[: self.height_px, : self.width_px]
        return np.where(mask, 255, 0).astype(np.uint8)

    def usable_at(self, px: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Return which pixels (N, 2) lie in the image and have a ray, (N,)."""
        column, row = np.floor(px).astype(np.int64).T if len(px) else (np.empty(0, np.int64), np.empty(0, np.int64))
        inside = (column >= 0) & (column < self.width_px) & (row >= 0) & (row < self.height_px)
        return inside & (self.usable[np.where(inside, row, 0), np.where(inside, column, 0)] > 0)

    def distort(self, xy: Float) -> Float:
        """Return the pixels of undistorted normalised coordinates (x/z, y/z), (N, 2) -> (N, 2)."""

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
