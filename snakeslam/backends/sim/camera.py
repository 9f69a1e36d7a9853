"""The RGB-D camera's sensor: from one exact pinhole render, motion blur, noise and the gaps of a depth sensor."""

import cv2
import numpy as np

from snakeslam.backends.sim.renderer import HEIGHT_PX, WIDTH_PX, Depth, Image, Render
from snakeslam.backends.sim.settings import CameraSettings
from snakeslam.calibration import CameraCalibration
from snakeslam.geometry import so3
from snakeslam.messages import CameraFrame, Float
from snakeslam.robot.model import SnakeModel

EDGE_FRACTION = 0.06
"""A step in depth larger than this fraction of the depth leaves a hole."""
SMALLEST_BLUR_PX = 0.5
DEPTH_SCALE, DEPTH_UNITS = 5000.0, 65535
"""Units of the depth image per metre, as in the TUM benchmark, and the most of them: 13.1 m."""
NOISE_MARGIN_PX = 128


def camera_calibration(settings: CameraSettings, model: SnakeModel) -> CameraCalibration:
    """Return the exact intrinsics (pixel centres at whole numbers) and T_CI of the simulated camera."""
    f_px = WIDTH_PX / 2.0 / float(np.tan(np.deg2rad(settings.horizontal_fov_deg) / 2.0))
    rows = tuple(tuple(float(v) for v in row) for row in model.T_CI)
    return CameraCalibration.model_validate(
        {
            "T_cam_imu": rows,
            "intrinsics": (f_px, f_px, (WIDTH_PX - 1) / 2.0, (HEIGHT_PX - 1) / 2.0),
            "resolution": (WIDTH_PX, HEIGHT_PX),
            "depth_scale": DEPTH_SCALE,
            "rate_hz": float(settings.rate_hz),
            "timeshift_sigma_s": 0.0,
            "shutter": "global",
        }
    )


class Camera:
    """Turns a render into the frame of a real sensor, with noise drawn from ``rng``."""

    def __init__(
        self, settings: CameraSettings, intrinsics: tuple[float, float, float, float], rng: np.random.Generator
    ):
        self.settings = settings
        fx, fy, cx, cy = intrinsics
        self._K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        self._rng = rng
        shape = (HEIGHT_PX + NOISE_MARGIN_PX, WIDTH_PX + NOISE_MARGIN_PX)
        levels = settings.noise_grey_levels * rng.standard_normal((*shape, 3), dtype=np.float32)
        self._image_noise = np.rint(levels).astype(np.int16)
        self._depth_noise = rng.standard_normal(shape, dtype=np.float32)

    def expose(self, t_ns: int, seq: int, render: Render, w_C: Float) -> CameraFrame:
        """Return the frame of ``render``, exposed while the camera rotates at w_C (3,) rad/s."""
        rgb = cv2.cvtColor(self._blurred(render.rgba, w_C), cv2.COLOR_RGBA2RGB)
        row, column = self._rng.integers(0, NOISE_MARGIN_PX, 2)
        window = np.s_[row : row + HEIGHT_PX, column : column + WIDTH_PX]
        rgb = cv2.add(rgb, self._image_noise[window], dtype=cv2.CV_8U)
        gray = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
        depth_m = self._sensed_depth(render.inverse_depth, self._depth_noise[window])
        exposure_ns = round(self.settings.exposure_ms * 1e6)
        return CameraFrame(t_ns, seq, np.asarray(gray, np.uint8), np.asarray(rgb, np.uint8), depth_m, exposure_ns)

    def _blurred(self, rgba: Image, w_C: Float) -> Image:
        """Average 3 or 5 rotated copies over the exposure (four channels warp faster); short blur is left out."""
        rotation_C = w_C * self.settings.exposure_ms * 1e-3
        corner_px = float(np.hypot(WIDTH_PX, HEIGHT_PX)) / 2.0
        blur_px = self._K[0, 0] * float(np.hypot(rotation_C[0], rotation_C[1])) + corner_px * abs(float(rotation_C[2]))
        if blur_px < SMALLEST_BLUR_PX:
            return rgba
        count = 3 if blur_px < 3.0 else 5
        K_inv, mean = np.linalg.inv(self._K), rgba
        others = [k for k in range(count) if k != count // 2]
        for taken, k in enumerate(others, start=1):
            # A ray r_C seen at mid exposure is at Exp(-fraction rotation) r_C after that fraction of the rotation.
            H = self._K @ so3.exp(-((k + 0.5) / count - 0.5) * rotation_C) @ K_inv
            turned = cv2.warpPerspective(
                rgba, H, (WIDTH_PX, HEIGHT_PX), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            mean = cv2.addWeighted(mean, taken / (taken + 1.0), turned, 1.0 / (taken + 1.0), 0.0)
        return np.asarray(mean, np.uint8)

    def _sensed_depth(self, inverse_depth: Depth, noise: Depth) -> Depth:
        """Return noisy depth (H, W) m, 0 out of range and at edges, where the inverse depth is not locally flat.

        As a real sensor's it comes in whole units of 16 bits, so that a recording of it loses nothing.
        """
        settings = self.settings
        depth_m = np.reciprocal(inverse_depth)
        bend = np.abs(cv2.Laplacian(inverse_depth, cv2.CV_32F, ksize=1)) * depth_m
        sigma_m = np.float32(settings.depth_noise_m) + np.float32(settings.depth_noise_per_m) * depth_m * depth_m
        sensed = depth_m + sigma_m * noise
        unknown = (depth_m < settings.depth_min_m) | (depth_m > settings.depth_max_m) | (bend > EDGE_FRACTION)
        sensed[unknown] = 0.0
        units = np.rint(sensed * np.float32(DEPTH_SCALE))
        units[(units < 0.0) | (units > DEPTH_UNITS)] = 0.0
        return np.asarray(units * np.float32(1.0 / DEPTH_SCALE), np.float32)
