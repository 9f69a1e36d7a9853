"""Where the filter starts from rest: gravity from the mean specific force, the gyro's bias from its mean rate.

W is z up with its origin at the IMU and its yaw zero at the start.
"""

from collections.abc import Sequence

import numpy as np

from snakeslam.calibration import ImuCalibration
from snakeslam.estimation.state import BIAS_A, BIAS_G, CORE, THETA, P, State, V
from snakeslam.geometry import so3
from snakeslam.messages import Float, ImuSample

SIGMA_BIAS_A = 0.08
STILL_GYRO_STD = 0.02
STILL_GYRO_MEAN = 0.15
STILL_ACCEL_STD = 0.25
STILL_GRAVITY_OFF = 0.6
MIN_STILL_SAMPLES = 10


def upright(gravity_I: Float) -> Float:
    """Return R_WI with zero yaw for the specific force at rest ``gravity_I`` (3,) (it points up)."""
    up = gravity_I / np.linalg.norm(gravity_I)
    ahead = np.array([1.0, 0.0, 0.0]) - up[0] * up
    if np.linalg.norm(ahead) < 0.1:
        ahead = np.array([0.0, 1.0, 0.0]) - up[1] * up
    ahead /= np.linalg.norm(ahead)
    return np.asarray(np.stack([ahead, np.cross(up, ahead), up]), dtype=np.float64)


def start_still(samples: Sequence[ImuSample], t_ns: int, gravity_m_s2: float, noise: ImuCalibration) -> State | None:
    """Return the state of an IMU at rest at ``t_ns``, or None when ``samples`` show that it moves.

    Tilt comes from the mean specific force, the gyro's bias from its mean; what a bias of the accelerometer does to the
    tilt is in the covariance, as their correlation.
    """
    if len(samples) < MIN_STILL_SAMPLES:
        return None
    gyro = np.array([s.gyro_I for s in samples])
    accel = np.array([s.accel_I for s in samples])
    mean_gyro, mean_accel = gyro.mean(axis=0), accel.mean(axis=0)
    white_gyro = noise.gyroscope_noise_density * np.sqrt(noise.update_rate)
    white_accel = noise.accelerometer_noise_density * np.sqrt(noise.update_rate)
    moves = (
        np.any(gyro.std(axis=0) > STILL_GYRO_STD + 2.0 * white_gyro)
        or np.any(accel.std(axis=0) > STILL_ACCEL_STD + 2.0 * white_accel)
        or np.linalg.norm(mean_gyro) > STILL_GYRO_MEAN
        or abs(np.linalg.norm(mean_accel) - gravity_m_s2) > STILL_GRAVITY_OFF
    )
    if moves:
        return None
    R_WI = upright(mean_accel)
    state = State(t_ns, R_WI, np.zeros(3), np.zeros(3), mean_gyro, np.zeros(3), np.zeros((CORE, CORE)))
    state.cov = _still_covariance(R_WI, len(samples), gravity_m_s2, white_gyro, white_accel)
    return state


def _still_covariance(R_WI: Float, n: int, gravity: float, white_gyro: float, white_accel: float) -> Float:
    """Return the covariance of a still start: an accelerometer bias b tilts the estimate by theta = [g_I]x b / g^2."""
    cov = np.zeros((CORE, CORE))
    cov[BIAS_A, BIAS_A] = np.eye(3) * SIGMA_BIAS_A**2
    cov[BIAS_G, BIAS_G] = np.eye(3) * (white_gyro**2 / n + 1e-3**2)
    cov[V, V] = np.eye(3) * 0.01**2
    r_theta_bias = so3.hat(R_WI.T @ np.array([0.0, 0.0, gravity])) / gravity**2
    cov[THETA, THETA] = r_theta_bias @ r_theta_bias.T * (SIGMA_BIAS_A**2 + white_accel**2 / n) + np.eye(3) * 1e-10
    cov[THETA, BIAS_A] = r_theta_bias * SIGMA_BIAS_A**2
    cov[BIAS_A, THETA] = cov[THETA, BIAS_A].T
    cov[P, P] = np.eye(3) * 1e-10
    return cov
