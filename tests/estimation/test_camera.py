"""The camera model: the inverse of a distortion is verified before it is used."""

import numpy as np
import pytest

from snakeslam.calibration import CameraCalibration
from snakeslam.estimation.imaging.camera import PinholeCamera
from tests.estimation.wall import RIG


def camera(model: str, coefficients: tuple[float, ...], focal_px: float = 458.0) -> PinholeCamera:
    return PinholeCamera(
        CameraCalibration(
            T_cam_imu=RIG.cam0.T_cam_imu,
            intrinsics=(focal_px, focal_px, 367.2, 248.4),
            distortion_model=model,
            distortion_coeffs=coefficients,
            resolution=(752, 480),
        )
    )


def pixels() -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(752.0)[::3], np.arange(480.0)[::3]), axis=-1).reshape(-1, 2)


CAMERAS = [
    ("radtan", (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05), 458.0, True),
    ("radtan", (-0.45, 0.1, 0.0, 0.0), 458.0, True),
    ("radtan", (0.2624, -0.9531, -0.0054, 0.0026, 1.1633), 458.0, True),
    ("radtan", (-0.6, 0.0, 0.0, 0.0), 458.0, False),
    ("equidistant", (0.0034, 0.0007, -0.002, 0.0002), 458.0, True),
    ("equidistant", (0.0034, 0.0007, -0.002, 0.0002), 190.0, False),
    ("none", (), 458.0, True),
]


@pytest.mark.parametrize(("model", "coefficients", "focal_px", "everywhere"), CAMERAS)
def test_every_usable_pixel_has_its_ray(
    model: str, coefficients: tuple[float, ...], focal_px: float, everywhere: bool
) -> None:
    """OpenCV stops after 5 iterations: 0.29 px at the rim of EuRoC's camera, 50 px with stronger distortion."""
    cam, px = camera(model, coefficients, focal_px), pixels()
    usable = cam.usable_at(px)
    assert usable.all() == everywhere
    assert usable.mean() > 0.3
    xy = cam.normalise(px[usable])
    assert np.abs(cam.distort(xy) - px[usable]).max() < 0.06
    assert np.abs(xy).max() < np.tan(np.deg2rad(81.0))


def test_the_rim_of_a_fisheye_beyond_ninety_degrees_is_not_used() -> None:
    """Beyond 90 deg (x/z, y/z) has no value; OpenCV returns some other ray."""
    cam, px = camera("equidistant", (0.0, 0.0, 0.0, 0.0), 190.0), pixels()
    angle_rad = np.linalg.norm(px - [367.2, 248.4], axis=1) / 190.0
    assert not cam.usable_at(px)[angle_rad > np.deg2rad(81.0)].any()
    assert cam.usable_at(px)[angle_rad < np.deg2rad(78.0)].all()


def test_pixels_outside_of_the_image_are_not_usable() -> None:
    cam = camera("none", ())
    assert not cam.usable_at(np.array([[-1.0, 3.0], [752.0, 3.0], [5.0, 480.0], [5.0, -0.5]])).any()
