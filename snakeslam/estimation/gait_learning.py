"""The slow states of the gait's model, learnt while the camera sees: friction's ratio, the velocity's bias, its scale.

They stand outside the filter: the camera knows the way so much better than the gait that what the two tell of each
other beyond it is nothing.
"""

from dataclasses import replace

import numpy as np

from snakeslam.estimation.gait_odometry import Reckoned
from snakeslam.estimation.gait_settings import GaitSensorSettings
from snakeslam.messages import Float

CHI2_3_999 = 16.27
"""The 99.9 % quantile of chi^2 with three degrees of freedom: beyond it a way says nothing of ratio and bias."""
RATIO_WALK_PER_S = 0.001
"""Growth of the variance of log(ratio), 1/s: another ground comes slowly."""
BIAS_TIME_S = 30.0
"""Another gait brings another bias: its variance grows back in about so long."""
SCALE_TIME_S = 3.0
MAX_STEP = 10.0
LEAST_SCALE, MOST_SCALE = 1.0, 20.0
"""Less is not believed: the filter's own covariance, too, is in what it is learnt from."""
MAX_RATIO = 20.0


class SlipModel:
    """(log(ratio), bias) as a random walk, and the scale of the velocity's error in sigmas of the reckoning.

    The bias (2,) m/s is ahead and to the left along the ground: what rolling loses of its speed no ratio explains.
    """

    def __init__(self, settings: GaitSensorSettings) -> None:
        self._settings = settings
        self._slow = np.array([np.log(settings.friction_ratio), 0.0, 0.0])
        self._prior = np.array([settings.ratio_sigma, settings.bias_sigma_m_s, settings.bias_sigma_m_s]) ** 2
        self._cov = np.diag(self._prior)
        self.scale = settings.slip_scale

    @property
    def log_ratio(self) -> float:
        """Logarithm of the ratio."""
        return float(self._slow[0])

    @property
    def ratio(self) -> float:
        """Friction across the body over friction along it."""
        return float(np.exp(self._slow[0]))

    @property
    def bias_m_s(self) -> Float:
        """What is missing of the reckoned velocity ahead and to the left, (2,)."""
        return self._slow[1:].copy()

    def corrected(self, way: Reckoned) -> Reckoned:
        """Return a way reckoned with the ratio with the bias added."""
        bias = self._slow[1:]
        return replace(way, dp_I=way.dp_I + way.dp_D_bias @ bias, v_I=way.v_I + way.heading_I @ bias)

    def cov(self, way: Reckoned) -> Float:
        """Return the covariance (3, 3) of a way: slip that lasts, and the slow states that are not known."""
        J = _jacobian(way)
        return (self._slip(way) + J @ self._cov @ J.T) * self._lasts(way)

    def _slip(self, way: Reckoned) -> Float:
        return self.scale**2 * way.cov_v * way.dt_s**2

    def _lasts(self, way: Reckoned) -> float:
        return max(1.0, 2.0 * self._settings.slip_time_s / way.dt_s)

    def learn(self, way: Reckoned, moved_I: Float, cov_moved: Float) -> None:
        """Take what the filter, seeing, says of a corrected way: ``moved_I`` (3,) m with covariance (3, 3).

        A Kalman step on the slow states, slip as lasting noise; then scale^2 <- scale^2 (1 + (d^2 / 3 - 1) dt / T).
        """
        e = moved_I - way.dp_I
        self._learn_slow(way, e, cov_moved)
        distance = float(e @ np.linalg.solve(self._slip(way) + cov_moved, e)) / 3.0
        gain = min(1.0, way.dt_s / SCALE_TIME_S)
        scale = self.scale * np.sqrt(1.0 + (min(distance, MAX_STEP) - 1.0) * gain)
        self.scale = float(np.clip(scale, LEAST_SCALE, MOST_SCALE))

    def _learn_slow(self, way: Reckoned, e: Float, cov_moved: Float) -> None:
        J = _jacobian(way)
        self._let_walk(way.dt_s)
        S = self._slip(way) * self._lasts(way) + cov_moved + J @ self._cov @ J.T
        if float(e @ np.linalg.solve(S, e)) > CHI2_3_999:
            return
        gain = np.linalg.solve(S, J @ self._cov).T
        self._slow = self._slow + gain @ e
        self._slow[0] = np.clip(self._slow[0], 0.0, np.log(MAX_RATIO))
        cov = self._cov - gain @ J @ self._cov
        self._cov = 0.5 * (cov + cov.T)

    def _let_walk(self, dt_s: float) -> None:
        """Let the variances grow, each up to its prior; one whose prior is 0 is held."""
        growth = np.array([RATIO_WALK_PER_S, *self._prior[1:] / BIAS_TIME_S]) * dt_s
        room = np.maximum(0.0, self._prior - np.diag(self._cov))
        self._cov = self._cov + np.diag(np.minimum(growth, room))


def _jacobian(way: Reckoned) -> Float:
    """Return how the way changes with (log(ratio), bias), (3, 3)."""
    return np.column_stack([way.dp_D_log_ratio, way.dp_D_bias])
