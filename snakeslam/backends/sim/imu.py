"""The IMU: means over each interval that integrate back to the true motion, then biases, noise and saturation.

Convention of a sample at t_k, over the interval dt = t_k - t_(k-1), with phi = Log(R_(k-1)^T R_k):

    gyro  = phi / dt
    accel = J_l(phi)^-1 R_(k-1)^T (v_k - v_(k-1) - g dt) / dt

that is, the constant body rate and the constant specific force in I that turn the pose and velocity at t_(k-1) into
those at t_k: R_k = R_(k-1) Exp(gyro dt), v_k = v_(k-1) + g dt + R_(k-1) J_l(gyro dt) accel dt. The mid-point rule
R_(k-1) Exp(gyro dt / 2) accel dt agrees to second order in phi.
"""

from dataclasses import dataclass

import numpy as np

from snakeslam.backends.sim.settings import IMU_RATE_HZ, ImuSettings
from snakeslam.calibration import ImuCalibration
from snakeslam.geometry import so3
from snakeslam.messages import Float, ImuSample

GRAVITY_W = np.array([0.0, 0.0, -9.81])


def interval_means(R_WI0: Float, v0_W: Float, R_WI1: Float, v1_W: Float, dt_s: float) -> tuple[Float, Float]:
    """Return the mean angular rate (3,) rad/s and specific force (3,) m/s^2 in I between two states dt_s apart."""
    phi = so3.log(R_WI0.T @ R_WI1)
    force_I0 = R_WI0.T @ ((v1_W - v0_W) / dt_s - GRAVITY_W)
    return phi / dt_s, so3.right_jacobian_inv(-phi) @ force_I0


@dataclass(slots=True)
class Imu:
    """A noisy IMU; call ``measure`` once for each interval, in order."""

    settings: ImuSettings
    rng: np.random.Generator

    gyro_bias_I: Float
    accel_bias_I: Float

    @classmethod
    def switched_on(cls, settings: ImuSettings, rng: np.random.Generator) -> "Imu":
        """Return an IMU with its first biases drawn."""
        gyro_bias_I = rng.normal(0.0, settings.gyro_initial_bias_rad_s, 3)
        accel_bias_I = rng.normal(0.0, settings.accel_initial_bias_m_s2, 3)
        return cls(settings, rng, gyro_bias_I, accel_bias_I)

    def measure(self, t_ns: int, gyro_I: Float, accel_I: Float) -> ImuSample:
        """Return the sample of an interval's true means (3,) rad/s and (3,) m/s^2; the biases walk on."""
        settings, draw = self.settings, self.rng.standard_normal((4, 3))
        density, walk = np.sqrt(IMU_RATE_HZ), 1.0 / np.sqrt(IMU_RATE_HZ)
        self.gyro_bias_I = self.gyro_bias_I + settings.gyro_random_walk * walk * draw[0]
        self.accel_bias_I = self.accel_bias_I + settings.accel_random_walk * walk * draw[1]
        gyro_I = gyro_I + self.gyro_bias_I + settings.gyro_noise_density * density * draw[2]
        accel_I = accel_I + self.accel_bias_I + settings.accel_noise_density * density * draw[3]
        return ImuSample(
            t_ns,
            np.clip(gyro_I, -settings.gyro_range_rad_s, settings.gyro_range_rad_s),
            np.clip(accel_I, -settings.accel_range_m_s2, settings.accel_range_m_s2),
        )


def imu_calibration(settings: ImuSettings) -> ImuCalibration:
    """Return the densities that ``Imu`` draws its noise with."""
    return ImuCalibration(
        gyroscope_noise_density=settings.gyro_noise_density,
        gyroscope_random_walk=settings.gyro_random_walk,
        accelerometer_noise_density=settings.accel_noise_density,
        accelerometer_random_walk=settings.accel_random_walk,
        update_rate=IMU_RATE_HZ,
        sample_kind="mean",
    )
