"""The front-end on images whose motion is known."""

import cv2
import numpy as np
import pytest

from snakeslam.estimation.frontend.settings import FrontendSettings
from snakeslam.estimation.frontend.tracking import Frontend, TrackedFeatures
from snakeslam.estimation.imaging.camera import PinholeCamera
from snakeslam.geometry import so3
from snakeslam.messages import CameraFrame
from tests.estimation.wall import HEIGHT_PX, RIG, WIDTH_PX, K

CAMERA = PinholeCamera(RIG.cam0)
ROLL_RAD = np.deg2rad(3.5)


def texture(seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0, 1, (HEIGHT_PX, WIDTH_PX)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.5)
    return np.clip(128 + 60 * smooth / smooth.std(), 0, 255).astype(np.uint8)


def rolled(image: np.ndarray, R_CC0: np.ndarray) -> np.ndarray:
    return cv2.warpPerspective(image, K @ R_CC0 @ np.linalg.inv(K), (WIDTH_PX, HEIGHT_PX), flags=cv2.INTER_CUBIC)


def test_features_of_a_rolling_camera_do_not_drift() -> None:
    """After 20 frames of 3.5 deg each, features are where the rotation predicts them."""
    image, frontend = texture(), Frontend(FrontendSettings(), CAMERA, 0)
    step = np.eye(4)
    step[:3, :3] = so3.exp(np.array([0.0, 0.0, ROLL_RAD]))
    frames: list[TrackedFeatures] = []
    for k in range(21):
        gray = rolled(image, so3.exp(np.array([0.0, 0.0, k * ROLL_RAD])))
        frames.append(frontend.process(CameraFrame(k, k, gray), step if k else np.eye(4)))
    kept, first, last = np.intersect1d(frames[0].ids, frames[-1].ids, return_indices=True)
    assert len(kept) > 10
    rays = np.hstack([frames[0].xy[first], np.ones((len(kept), 1))]) @ so3.exp(np.array([0.0, 0.0, 20 * ROLL_RAD])).T
    error_px = np.linalg.norm(rays[:, :2] / rays[:, 2:] - frames[-1].xy[last], axis=1) * CAMERA.focal_px
    assert np.median(error_px) < 0.5


def test_faint_texture_is_not_tracked() -> None:
    """The left half is faint, just enough for corners: KLT would drift there, so none of them is kept."""
    half = WIDTH_PX // 2
    image = texture().astype(float)
    image[:, :half] = 128 + 0.12 * (cv2.GaussianBlur(image[:, :half], (0, 0), 2.0) - 128)
    frontend = Frontend(FrontendSettings(fast_threshold=4), CAMERA, 0)
    noise = np.random.default_rng(1)
    for k in range(4):
        gray = np.clip(image + noise.normal(0, 1.0, image.shape), 0, 255).astype(np.uint8)
        frame = frontend.process(CameraFrame(k, k, gray), np.eye(4))
    tracked, new = frame.px[: frame.tracked, 0], frame.px[frame.tracked :, 0]
    assert np.sum(tracked > half + 8) > 40
    assert np.sum(new < half - 8) > 5, "there must be corners to be left alone"
    assert np.sum(tracked < half - 16) == 0


def test_the_same_image_is_frozen_and_a_noisy_one_is_not() -> None:
    frontend, image = Frontend(FrontendSettings(), CAMERA, 0), texture()
    first = frontend.process(CameraFrame(0, 0, image), np.eye(4))
    again = frontend.process(CameraFrame(1, 1, image.copy()), np.eye(4))
    noisy = frontend.process(CameraFrame(2, 2, image ^ 1), np.eye(4))
    assert (first.frozen, again.frozen, noisy.frozen) == (False, True, False)
    assert np.array_equal(again.ids, first.ids)
    assert noisy.tracked > 0.9 * len(first.ids)


def test_a_rotation_during_the_exposure_is_motion_blur() -> None:
    """2 deg in 50 ms are .4 deg in 10 ms of exposure, and 0.16 deg in the 4 ms that a frame reports."""
    frontend = Frontend(FrontendSettings(), CAMERA, 0, 10_000_000)
    step = np.eye(4)
    step[:3, :3] = so3.exp(np.array([0.0, np.deg2rad(2.0), 0.0]))
    frames = [CameraFrame(k * 50_000_000, k, texture(k), exposure_ns=4_000_000 * (k > 1)) for k in range(3)]
    blurs_rad = [frontend.process(frame, step).motion_blur_rad for frame in frames]
    assert np.rad2deg(blurs_rad) == pytest.approx([0.0, 0.4, 0.16])
