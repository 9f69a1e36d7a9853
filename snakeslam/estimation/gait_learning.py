"""The ratio of friction, and how far the gait's model is wrong, learnt while the camera sees."""

import numpy as np

from snakeslam.estimation.gait_odometry import Reckoned
from snakeslam.estimation.gait_settings import GaitSensorSettings
from snakeslam.messages import Float

CHI2_3_999 = 16.27
"""The 99.9 % quantile of chi^2 with three degrees of freedom: beyond it a way says nothing of the ratio."""
WALK_PER_S = 0.001
"""Growth of the variance of log(ratio), 1/s: another ground comes slowly."""
SCALE_TIME_S = 3.0
MAX_STEP = 10.0
LEAST_SCALE, MOST_SCALE = 1.0, 20.0
"""Less is not believed: the filter's own covariance, too, is in what it is learnt from."""
MAX_RATIO = 20.0


class SlipModel:
    """log(ratio) as a random walk, and the scale of the velocity's error in sigmas of the reckoning."""

    def __init__(self, settings: GaitSensorSettings) -> None:
        self._settings = settings
        self.log_ratio = float(np.log(settings.friction_ratio))
        self.variance = settings.ratio_sigma**2
        self.scale = settings.slip_scale

    @property
    def ratio(self) -> float:
        """Friction across the body over friction along it."""
        return float(np.exp(self.log_ratio))

    def cov(self, way: Reckoned) -> Float:
        """Return the covariance (3, 3) of a way: slip that lasts, and the ratio that is not known."""
        J = way.dp_D_log_ratio
        lasts = max(1.0, 2.0 * self._settings.slip_time_s / way.dt_s)
        return (self._slip(way) + self.variance * np.outer(J, J)) * lasts

    def _slip(self, way: Reckoned) -> Float:
        return self.scale**2 * way.cov_v * way.dt_s**2

    def learn(self, way: Reckoned, moved_I: Float, cov_moved: Float) -> None:
        """Take what the filter, seeing, says of the same way: ``moved_I`` (3,) m with covariance (3, 3).

        A Kalman step on log(ratio) with the slip as lasting noise; then scale^2 <- scale^2 (1 + (d^2 / 3 - 1) dt / T).
        """
        self._learn_ratio(way, moved_I - way.dp_I, cov_moved)
        e = moved_I - way.dp_I
        distance = float(e @ np.linalg.solve(self._slip(way) + cov_moved, e)) / 3.0
        gain = min(1.0, way.dt_s / SCALE_TIME_S)
        scale = self.scale * np.sqrt(1.0 + (min(distance, MAX_STEP) - 1.0) * gain)
        self.scale = float(np.clip(scale, LEAST_SCALE, MOST_SCALE))

    def _learn_ratio(self, way: Reckoned, e: Float, cov_moved: Float) -> None:
        prior = self._settings.ratio_sigma**2
        self.variance = min(prior, self.variance + WALK_PER_S * way.dt_s) if prior else 0.0
        J = way.dp_D_log_ratio
        lasts = max(1.0, 2.0 * self._settings.slip_time_s / way.dt_s)
        S = self._slip(way) * lasts + cov_moved + self.variance * np.outer(J, J)
        gain = self.variance * np.linalg.solve(S, J)
        if float(e @ np.linalg.solve(S, e)) > CHI2_3_999:
            return
        self.log_ratio = float(np.clip(self.log_ratio + gain @ e, 0.0, np.log(MAX_RATIO)))
        self.variance *= 1.0 - float(gain @ J)
