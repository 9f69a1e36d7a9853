"""Where the filter starts from rest: gravity from the mean specific force, the gyro's bias from its mean rate.

W is z up with its origin at the IMU and its yaw zero at the start.
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
STILL_GYRO_STD, STILL_ACCEL_STD = 0.02, 0.25
"""Spread of the samples that a camera may have that is stationary in two frames, rad/s and m/s^2."""
TREMOR_S = 0.35
"""An image that has not moved for so long allows the larger spread of a tremor, or of motors' vibration."""
STILL_GYRO_MEAN = 0.5
"""The most that is taken for a gyro's bias, rad/s."""
STILL_GRAVITY_OFF = 0.6
MIN_STILL_SAMPLES = 10
SIGMA_BIAS_G = 1e-3
SIGMA_V_M_S = 0.01
TREMOR_MEAN_S = 0.18
"""Mean acceleration of a tremor over a time T, times T, over its spread in that time, s: sqrt(12) / (2 pi 3 Hz)."""
MAX_MEAN_M_S2 = 0.1
"""With a larger sigma of the mean acceleration a longer time is waited for."""


@dataclass(frozen=True, slots=True)
class Stationary:
    """What the image shows: for ``age_s`` its features have moved by no more than ``moved_rad`` (median)."""

    age_s: float
    moved_rad: float


def upright(gravity_I: Float) -> Float:
    """Return R_WI with zero yaw for the specific force at rest ``gravity_I`` (3,) (it points up)."""
    up = gravity_I / np.linalg.norm(gravity_I)
    ahead = np.array([1.0, 0.0, 0.0]) - up[0] * up
    if np.linalg.norm(ahead) < 0.1:
        ahead = np.array([0.0, 1.0, 0.0]) - up[1] * up
    ahead /= np.linalg.norm(ahead)
    return np.asarray(np.stack([ahead, np.cross(up, ahead), up]), dtype=np.float64)


def start_still(
    samples: Sequence[ImuSample], t_ns: int, gravity_m_s2: float, noise: ImuCalibration, image: Stationary
) -> State | None:
    """Return the state of an IMU at rest at ``t_ns``, or None when ``samples`` show that it moves.

    The image has not moved; ``samples`` are those of the same time. Tilt comes from the mean specific force, the gyro's
    bias from its mean; what a bias of the accelerometer does to the tilt is in the covariance, as their correlation.
    """
    if len(samples) < MIN_STILL_SAMPLES:
        return None
    gyro = np.array([s.gyro_I for s in samples])
    accel = np.array([s.accel_I for s in samples])
    mean_gyro, mean_accel = gyro.mean(axis=0), accel.mean(axis=0)
    off_m_s2 = abs(float(np.linalg.norm(mean_accel)) - gravity_m_s2)
    white_gyro = noise.gyroscope_noise_density * np.sqrt(noise.update_rate)
    white_accel = noise.accelerometer_noise_density * np.sqrt(noise.update_rate)
    long = image.age_s >= TREMOR_S
    moves = (
        np.any(gyro.std(axis=0) > (TREMOR_GYRO_STD if long else STILL_GYRO_STD) + 2.0 * white_gyro)
        or np.any(accel.std(axis=0) > (TREMOR_ACCEL_STD if long else STILL_ACCEL_STD) + 2.0 * white_accel)
        or np.linalg.norm(mean_gyro) > STILL_GYRO_MEAN
        or off_m_s2 > STILL_GRAVITY_OFF
    )
    if moves:
        return None
    R_WI = upright(mean_accel)
    state = State(t_ns, R_WI, np.zeros(3), np.zeros(3), mean_gyro, np.zeros(3), np.zeros((CORE, CORE)))
    tremor_m_s2 = float(np.sqrt(max(0.0, float(accel.var(axis=0).mean()) - white_accel**2)))
    mean_m_s2 = tremor_m_s2 * TREMOR_MEAN_S / image.age_s
    if mean_m_s2 > MAX_MEAN_M_S2 and not long:
        return None
    sigmas = _Sigmas(
        bias_g=float(np.sqrt(white_gyro**2 / len(samples) + SIGMA_BIAS_G**2 + (image.moved_rad / image.age_s) ** 2)),
        bias_a=float(np.hypot(SIGMA_BIAS_A, off_m_s2)),
        mean_a=float(np.hypot(white_accel / np.sqrt(len(samples)), mean_m_s2)),
        v=float(np.linalg.norm([SIGMA_V_M_S, TREMOR_V_S * tremor_m_s2, DISTANCE_M * image.moved_rad / image.age_s])),
    )
    state.cov = _still_covariance(R_WI, gravity_m_s2, sigmas)
    return state


@dataclass(frozen=True, slots=True)
class _Sigmas:
    """One sigma of the biases, of the mean specific force without its bias, and of the velocity."""

    bias_g: float
    bias_a: float
    mean_a: float
    v: float


def _still_covariance(R_WI: Float, gravity: float, sigma: _Sigmas) -> Float:
    """Return the covariance of a still start: an accelerometer bias b tilts the estimate by theta = [g_I]x b / g^2."""
    cov = np.zeros((CORE, CORE))
    cov[BIAS_A, BIAS_A] = np.eye(3) * sigma.bias_a**2
    cov[BIAS_G, BIAS_G] = np.eye(3) * sigma.bias_g**2
    cov[V, V] = np.eye(3) * sigma.v**2
    r_theta_bias = so3.hat(R_WI.T @ np.array([0.0, 0.0, gravity])) / gravity**2
    cov[THETA, THETA] = r_theta_bias @ r_theta_bias.T * (sigma.bias_a**2 + sigma.mean_a**2) + np.eye(3) * 1e-10
    cov[THETA, BIAS_A] = r_theta_bias * sigma.bias_a**2
    cov[BIAS_A, THETA] = cov[THETA, BIAS_A].T
    cov[P, P] = np.eye(3) * 1e-10
    return cov
