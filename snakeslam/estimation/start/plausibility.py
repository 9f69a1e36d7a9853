"""Plausibility of calibration and IMU: wrong units, signs and axes, each reported in one line.

A wrong unit is not noise: gravity is 9.81 m/s^2, a focal length is about the width of an image, and the gyro measures
the rotation that the image shows. A contradiction is reported before anything is estimated from it.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from snakeslam.calibration import CameraCalibration
from snakeslam.errors import InputError
from snakeslam.geometry import so3
from snakeslam.messages import Float, ImuSample

FOCAL_LENGTHS = (0.1, 20.0)
"""Least and largest focal length in units of the image's longer side: fields of view of 157 and 3 deg."""
MAX_LEVER_M = 2.0
"""Largest distance from the camera to the IMU."""
MIN_SAMPLES = 20
MIN_SPAN_NS = 300_000_000
"""Fewer samples, or a shorter time, give no mean specific force."""
GRAVITY_SHARE = (0.55, 1.5)
"""Least and largest mean specific force in units of gravity, of a robot or a hand that moves."""
ONE_G = (0.7, 1.4)
"""A mean between these is gravity in units of g."""
MIN_ROTATION_RAD = 0.06
"""Sum of the image's rotations below which they say nothing about the gyro."""
AGREES, EXPLAINS = 0.3, 0.15
"""Largest share of the squared rotations that the gyro leaves unexplained: as it is, and corrected for a fault."""
MIN_ERROR_DEG = 20.0
"""Smaller errors of the extrinsics are not reported as a fault."""
MAX_BIAS_RAD_S = 0.2
"""Largest bias of the gyro that is removed before the comparison."""
MIN_FEATURES, EPIPOLAR_LIMIT = 20, 2e-3
"""Features that a rotation by the image needs, and their largest distance from their epipolar lines, normalised."""
UNEXPLAINED = "gyro and image rotate differently: check the gyro's unit, its axes and the extrinsics"
SECOND_AXIS = 0.15
"""Least ratio of the second to the first singular value: rotations about one axis do not determine the extrinsics."""


def check_camera(cam0: CameraCalibration) -> None:
    """Raise InputError for intrinsics or extrinsics that a camera of this resolution cannot have."""
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
    """Return in words that the mean of ``samples`` is not near gravity; None where it is plausible."""
    if len(samples) < MIN_SAMPLES or samples[-1].t_ns - samples[0].t_ns < MIN_SPAN_NS:
        return None
    mean_m_s2 = float(np.linalg.norm(np.mean([s.accel_I for s in samples], axis=0)))
    least, most = (share * gravity_m_s2 for share in GRAVITY_SHARE)
    if least <= mean_m_s2 <= most:
        return None
    unit = ": is it in g?" if ONE_G[0] <= mean_m_s2 <= ONE_G[1] else ""
    return f"the accelerometer measures about {mean_m_s2:.1f} m/s^2 in the mean, gravity is {gravity_m_s2:.1f}{unit}"


def gyro_fault(image_C: Float, gyro_C: Float, R_CI: Float, span_s: float) -> str | None:
    """Return in words how the gyro contradicts the image; None where they agree or rotate too little.

    ``image_C``, ``gyro_C`` (n, 3) are rotation vectors of the camera over the same n spans of about ``span_s``, from
    the image and from the gyro with the extrinsics ``R_CI`` (3, 3). Each fault is tried in turn, then the rotation
    between both that fits best, by singular values [Arun87].
    """
    bias_rad = MAX_BIAS_RAD_S * span_s
    rotated_rad = float(np.sum(np.linalg.norm(image_C, axis=1)))
    if rotated_rad < MIN_ROTATION_RAD or _unexplained(image_C, gyro_C, bias_rad) < AGREES:
        return None
    faults = (
        (gyro_C * np.pi / 180.0, "the gyro measures 57 times the rotation of the image: is it in deg/s?"),
        (gyro_C * 180.0 / np.pi, "the gyro measures 1/57 of the rotation of the image: is its unit rad/s?"),
        (-gyro_C, "the gyro measures the opposite of the rotation of the image: is its sign reversed?"),
        (gyro_C @ R_CI @ R_CI, "the image rotates about other axes than the gyro: are the extrinsics inverted?"),
    )
    for corrected_C, words in faults:
        if _unexplained(image_C, corrected_C, bias_rad) < EXPLAINS:
            return words
    U, s, Vt = np.linalg.svd(image_C.T @ gyro_C)
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    if s[1] > SECOND_AXIS * s[0] and _unexplained(image_C, gyro_C @ R.T, bias_rad) < EXPLAINS:
        error_deg = float(np.rad2deg(np.linalg.norm(so3.log(R))))
        if error_deg > MIN_ERROR_DEG:
            return f"the image rotates about other axes than the gyro: the extrinsics are {error_deg:.0f} deg wrong"
    return UNEXPLAINED


def _unexplained(image_C: Float, gyro_C: Float, bias_rad: float) -> float:
    """Return the share of the image's squared rotations that the gyro leaves unexplained, with the best bias."""
    residual = image_C - gyro_C
    bias = residual.mean(axis=0)
    bias *= min(1.0, bias_rad / max(float(np.linalg.norm(bias)), 1e-12))
    return float(np.sum((residual - bias) ** 2) / np.sum(image_C**2))


def image_rotation(xy0: Float, xy1: Float) -> Float | None:
    """Return the rotation vector (3,) of the camera between two images of features (N, 2); None for too few.

    The essential matrix separates rotation from translation whatever the depths are [Nister04].
    """
    if len(xy0) < MIN_FEATURES:
        return None
    E, inliers = cv2.findEssentialMat(xy0, xy1, np.eye(3), method=cv2.RANSAC, prob=0.999, threshold=EPIPOLAR_LIMIT)
    # Without a result OpenCV returns None, which its type stubs do not say; several are stacked in one array.
    if np.shape(E) != (3, 3):
        return None
    _, R_C1C0, _, _ = cv2.recoverPose(E, xy0, xy1, np.eye(3), mask=inliers)
    return so3.log(np.asarray(R_C1C0, dtype=np.float64).T)
