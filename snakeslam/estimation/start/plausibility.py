"""Whether calibration and IMU can be what they are said to be: units, signs and axes, each in one line.

A wrong unit does not look like noise: gravity is 9.81 m/s^2, a focal length is about the width of an image, and the
gyro turns as the image does. What contradicts that is said before anything is estimated from it.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from snakeslam.calibration import CameraCalibration
from snakeslam.errors import InputError
from snakeslam.geometry import so3
from snakeslam.messages import Float, ImuSample

FOCAL_LENGTHS = (0.1, 20.0)
"""Least and most, in units of the image's longer side: 157 and 3 deg of view."""
MAX_LEVER_M = 2.0
LEAST_SAMPLES = 20
LEAST_SPAN_NS = 300_000_000
GRAVITY_SHARE = (0.55, 1.5)
"""What a mean specific force may be in units of gravity while a robot or a hand moves."""
ONE_G = (0.7, 1.4)
LEAST_TURN_RAD = 0.06
"""Sum of the image's rotations, below which they tell nothing of the gyro."""
AGREES, EXPLAINS = 0.3, 0.15
"""Share of the squared rotations that is left unexplained: at most, as given, and at most, by a fault."""
LEAST_WRONG_DEG = 20.0
MAX_BIAS_RAD_S = 0.2
LEAST_FEATURES, EPIPOLAR = 20, 2e-3
"""Of features for a rotation by the image, and how far they may be from their epipolar lines, normalised."""
UNEXPLAINED = "the gyro and the image turn differently: check the gyro's unit, its axes and the extrinsics"
SECOND_AXIS = 0.15
"""Least ratio of the second to the first singular value: one axis of rotation does not tell the extrinsics."""


def check_camera(cam0: CameraCalibration) -> None:
    """Raise InputError for intrinsics or extrinsics that no camera of this resolution has."""
    width, height = cam0.resolution
    fx, fy, cx, cy = cam0.intrinsics
    least, most = (share * max(width, height) for share in FOCAL_LENGTHS)
    if not (least <= fx <= most and least <= fy <= most):
        problem = f"no camera of {width} x {height} px has a focal length of {fx:g} and {fy:g} px"
        raise InputError("cam0.intrinsics", problem, f"fx, fy, cx, cy in px, focal lengths of {least:g} to {most:g}")
    if not (0.0 < cx < width and 0.0 < cy < height):
        problem = f"the principal point ({cx:g}, {cy:g}) px lies outside of the image of {width} x {height} px"
        raise InputError("cam0.intrinsics", problem, "fx, fy, cx, cy in px")
    lever_m = float(np.linalg.norm(cam0.T_IC[:3, 3]))
    if lever_m > MAX_LEVER_M:
        problem = f"the camera would be {lever_m:.4g} m away from the IMU"
        raise InputError("cam0.T_cam_imu", problem, f"a translation in metres, at most {MAX_LEVER_M:g} m")


def accelerometer_fault(samples: Sequence[ImuSample], gravity_m_s2: float) -> str | None:
    """Return in words why the mean of ``samples`` is no specific force near gravity, None where it can be one."""
    if len(samples) < LEAST_SAMPLES or samples[-1].t_ns - samples[0].t_ns < LEAST_SPAN_NS:
        return None
    mean_m_s2 = float(np.linalg.norm(np.mean([s.accel_I for s in samples], axis=0)))
    least, most = (share * gravity_m_s2 for share in GRAVITY_SHARE)
    if least <= mean_m_s2 <= most:
        return None
    unit = ": is it in g?" if ONE_G[0] <= mean_m_s2 <= ONE_G[1] else ""
    return f"the accelerometer measures about {mean_m_s2:.1f} m/s^2 in the mean, gravity is {gravity_m_s2:.1f}{unit}"


def gyro_fault(image_C: Float, gyro_C: Float, R_CI: Float, span_s: float) -> str | None:
    """Return in words how the gyro contradicts the image, None where they agree or tell too little.

    ``image_C``, ``gyro_C`` (n, 3) are rotation vectors of the camera over the same n spans of about ``span_s``, by the
    image and by the gyro with the extrinsics ``R_CI`` (3, 3).
    """
    bias_rad = MAX_BIAS_RAD_S * span_s
    turned_rad = float(np.sum(np.linalg.norm(image_C, axis=1)))
    if turned_rad < LEAST_TURN_RAD or _unexplained(image_C, gyro_C, bias_rad) < AGREES:
        return None
    faults = (
        (gyro_C * np.pi / 180.0, "the gyro measures 57 times what the image turns by: is it in deg/s?"),
        (gyro_C * 180.0 / np.pi, "the gyro measures 1/57 of what the image turns by: is its unit rad/s?"),
        (-gyro_C, "the gyro measures the opposite of what the image turns by: is its sign reversed?"),
        (gyro_C @ R_CI @ R_CI, "the image turns about other axes than the gyro: are the extrinsics inverted?"),
    )
    for turned, words in faults:
        if _unexplained(image_C, turned, bias_rad) < EXPLAINS:
            return words
    U, s, Vt = np.linalg.svd(image_C.T @ gyro_C)
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    if s[1] > SECOND_AXIS * s[0] and _unexplained(image_C, gyro_C @ R.T, bias_rad) < EXPLAINS:
        wrong_deg = float(np.rad2deg(np.linalg.norm(so3.log(R))))
        if wrong_deg > LEAST_WRONG_DEG:
            return f"the image turns about other axes than the gyro: the extrinsics are {wrong_deg:.0f} deg wrong"
    return UNEXPLAINED


def _unexplained(image_C: Float, gyro_C: Float, bias_rad: float) -> float:
    """Return the share of the image's squared rotations that the gyro leaves, with a bias that fits best."""
    rest = image_C - gyro_C
    bias = rest.mean(axis=0)
    bias *= min(1.0, bias_rad / max(float(np.linalg.norm(bias)), 1e-12))
    return float(np.sum((rest - bias) ** 2) / np.sum(image_C**2))


def image_rotation(xy0: Float, xy1: Float) -> Float | None:
    """Return the rotation vector (3,) of the camera between two images of features (N, 2); None if they are too few.

    By the essential matrix: the scene's depth does not matter, and a translation is no rotation [Nister04].
    """
    if len(xy0) < LEAST_FEATURES:
        return None
    E, inliers = cv2.findEssentialMat(xy0, xy1, np.eye(3), method=cv2.RANSAC, prob=0.999, threshold=EPIPOLAR)
    # Without a result OpenCV returns None, whatever its types say; with several, they stand below each other.
    if np.shape(E) != (3, 3):
        return None
    _, R_C1C0, _, _ = cv2.recoverPose(E, xy0, xy1, np.eye(3), mask=inliers)
    return so3.log(np.asarray(R_C1C0, dtype=np.float64).T)
