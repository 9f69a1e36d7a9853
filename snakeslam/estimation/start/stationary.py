"""The stationary start: tilt from the mean specific force, the gyro's bias from its mean rate.

W is z up, with its origin at the IMU and zero yaw at the start.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from snakeslam.calibration import ImuCalibration
from snakeslam.estimation.filter.state import BIAS_A, BIAS_G, CORE, THETA, P, State, V
from snakeslam.estimation.measurements.zero_velocity import DISTANCE_M, TREMOR_ACCEL_STD, TREMOR_GYRO_STD, TREMOR_V_S
from snakeslam.geometry import so3
from snakeslam.messages import Float, ImuSample

SIGMA_BIAS_A = 0.08
"""Prior sigma of the accelerometer's bias, m/s^2."""
GYRO_STD_RAD_S, ACCEL_STD_M_S2 = 0.02, 0.25
"""Largest standard deviation of the samples, beyond twice the white noise, of an IMU that is stationary for a few
frames."""
TREMOR_S = 0.35
"""An image that has been stationary for so long allows the larger deviations of a tremor or of vibrating motors."""
MAX_BIAS_G_RAD_S = 0.5
"""The largest mean rate that is taken for a gyro's bias."""
MAX_GRAVITY_ERROR_M_S2 = 0.6
"""Largest difference of the mean specific force from gravity."""
MIN_SAMPLES = 10
SIGMA_BIAS_G = 1e-3
"""Least sigma of the gyro's bias, rad/s."""
SIGMA_V_M_S = 0.01
TREMOR_MEAN_S = 0.18
"""Mean acceleration of a tremor over a time T, times T, over its standard deviation in that time: sqrt(12) / (2 pi f)
at f = 3 Hz, in s."""
MAX_MEAN_M_S2 = 0.1
"""Before TREMOR_S there is no start with a larger sigma of the mean acceleration: a longer mean will have a smaller."""
EXACT = 1e-10
"""Variance of the pose, which defines W, m^2 and rad^2; it keeps the covariance positive."""


@dataclass(frozen=True, slots=True)
class StationaryImage:
    """A stationary image: for ``age_s`` its features have moved by no more than ``moved_rad`` (median)."""

    age_s: float
    moved_rad: float


def upright(gravity_I: Float) -> Float:
    """Return R_WI (3, 3) with zero yaw for the specific force ``gravity_I`` (3,) of a stationary IMU (upwards)."""
    up = gravity_I / np.linalg.norm(gravity_I)
    # The rows of R_WI are the axes of W in I: ahead is the IMU's x axis (or its y axis, if x points up), made level.
    ahead = np.array([1.0, 0.0, 0.0]) - up[0] * up
    if np.linalg.norm(ahead) < 0.1:
        ahead = np.array([0.0, 1.0, 0.0]) - up[1] * up
    ahead /= np.linalg.norm(ahead)
    return np.asarray(np.stack([ahead, np.cross(up, ahead), up]), dtype=np.float64)


def start_stationary(
    samples: Sequence[ImuSample], t_ns: int, gravity_m_s2: float, noise: ImuCalibration, image: StationaryImage
) -> State | None:
    """Return the state of a stationary IMU at ``t_ns``; None when ``samples`` show that it moves.

    ``samples`` are those of the time in which the ``image`` was stationary.
    """
    # 1. Means and standard deviations of the samples.
    if len(samples) < MIN_SAMPLES:
        return None
    gyro = np.array([s.gyro_I for s in samples])
    accel = np.array([s.accel_I for s in samples])
    mean_gyro, mean_accel = gyro.mean(axis=0), accel.mean(axis=0)
    white_gyro = noise.gyroscope_noise_density * np.sqrt(noise.update_rate)
    white_accel = noise.accelerometer_noise_density * np.sqrt(noise.update_rate)
    gravity_error_m_s2 = abs(float(np.linalg.norm(mean_accel)) - gravity_m_s2)

    # 2. Does the IMU move? After TREMOR_S the image shows that a tremor displaces nothing.
    long = image.age_s >= TREMOR_S
    moves = (
        np.any(gyro.std(axis=0) > (TREMOR_GYRO_STD if long else GYRO_STD_RAD_S) + 2.0 * white_gyro)
        or np.any(accel.std(axis=0) > (TREMOR_ACCEL_STD if long else ACCEL_STD_M_S2) + 2.0 * white_accel)
        or np.linalg.norm(mean_gyro) > MAX_BIAS_G_RAD_S
        or gravity_error_m_s2 > MAX_GRAVITY_ERROR_M_S2
    )
    if moves:
        return None

    # 3. Mean: the specific force f = R_WI^T (0, 0, g) gives R_WI, the mean rate is b_g; p = v = b_a = 0.
    R_WI = upright(mean_accel)
    state = State(t_ns, R_WI, np.zeros(3), np.zeros(3), mean_gyro, np.zeros(3), np.zeros((CORE, CORE)))

    # 4. Sigmas. A tremor's mean acceleration decays as 1 / T; a motion hidden in the image is d / T, d = moved (3 m).
    tremor_m_s2 = float(np.sqrt(max(0.0, float(accel.var(axis=0).mean()) - white_accel**2)))
    mean_m_s2 = tremor_m_s2 * TREMOR_MEAN_S / image.age_s
    if mean_m_s2 > MAX_MEAN_M_S2 and not long:
        return None
    bias_g = float(np.sqrt(white_gyro**2 / len(samples) + SIGMA_BIAS_G**2 + (image.moved_rad / image.age_s) ** 2))
    bias_a = float(np.hypot(SIGMA_BIAS_A, gravity_error_m_s2))
    mean_a = float(np.hypot(white_accel / np.sqrt(len(samples)), mean_m_s2))
    v = float(np.linalg.norm([SIGMA_V_M_S, TREMOR_V_S * tremor_m_s2, DISTANCE_M * image.moved_rad / image.age_s]))

    # 5. Covariance. A bias b of the accelerometer tilts the estimate by theta = [g_I]x b / g^2; the correlation of both
    #    lets the filter correct the tilt when it learns the bias.
    cov = np.zeros((CORE, CORE))
    cov[BIAS_A, BIAS_A] = np.eye(3) * bias_a**2
    cov[BIAS_G, BIAS_G] = np.eye(3) * bias_g**2
    cov[V, V] = np.eye(3) * v**2
    r_theta_bias = so3.hat(R_WI.T @ np.array([0.0, 0.0, gravity_m_s2])) / gravity_m_s2**2
    cov[THETA, THETA] = r_theta_bias @ r_theta_bias.T * (bias_a**2 + mean_a**2) + np.eye(3) * EXACT
    cov[THETA, BIAS_A] = r_theta_bias * bias_a**2
    cov[BIAS_A, THETA] = cov[THETA, BIAS_A].T
    cov[P, P] = np.eye(3) * EXACT
    state.cov = cov
    return state
