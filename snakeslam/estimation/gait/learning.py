"""The slow states of the gait's model, learnt while the camera sees: friction's ratio, the velocity's bias, its scale.

The bias is steady or turns with the gait: what the model does not know of how the weight is shared out comes back in
each of its periods. Half a period later a body that winds is its own image in a mirror: what is wrong ahead is then the
same and turns twice in a period, what is wrong sideways is opposite and turns once. A gait that does not is believed
only little of it.

They stand outside the filter: the camera knows the way so much better than the gait that what the two tell of each
other beyond it is nothing.
"""

from dataclasses import replace

import numpy as np

from snakeslam.estimation.gait.odometry import Reckoned
from snakeslam.estimation.gait.settings import GaitSensorSettings
from snakeslam.estimation.gait.wave import GaitWave
from snakeslam.messages import Float

CHI2_3_999 = 16.27
"""The 99.9 % quantile of chi^2 with three degrees of freedom: beyond it a way says nothing of ratio and bias."""
RATIO_WALK_PER_S = 0.001
"""Growth of the variance of log(ratio), 1/s: another ground comes slowly."""
BIAS_TIME_S = 30.0
"""Another gait brings another bias: its variance grows back in about so long."""
WAVE_TIME_S = 300.0
"""Another gait has another wave, learnt anew: within a gait it hardly changes."""
SCALE_TIME_S = 3.0
FIRST_SCALE_TIME_S = 1.0
"""What is assumed of the scale at the start weighs as much as having watched it for so long."""
MAX_STEP = 10.0
LEAST_SCALE, MOST_SCALE = 0.1, 20.0
"""In serpentine gaits the model errs by .2 to .4 sigmas along the ground, in rolling and raised ones by 1."""
MAX_RATIO = 20.0
UNLIKE_ITS_IMAGE = 0.2
"""Prior sigma of what a mirrored half period does not allow, as a part of that of what it does."""
HARMONICS = 4
SLOW = 3 + 2 * HARMONICS
BIAS, WAVE = slice(1, 3), slice(3, SLOW)


class SlipModel:
    """(log(ratio), bias, wave) as a random walk, and the scale of the velocity's error in sigmas of the reckoning.

    The scale (3,) is ahead, to the left and out of the ground: a head that knocks is wrong upwards and right ahead.

    The bias (2,) m/s is ahead and to the left along the ground: what rolling loses of its speed no ratio explains. The
    wave (2, 4) m/s is a bias that turns with the gait: along cosine and sine of ``GaitWave``, and of twice its angle.
    """

    def __init__(self, settings: GaitSensorSettings) -> None:
        self._settings = settings
        self._slow = np.zeros(SLOW)
        self._slow[0] = np.log(settings.friction_ratio)
        bias, wave = settings.bias_sigma_m_s, settings.wave_sigma_m_s
        little = UNLIKE_ITS_IMAGE * wave
        ahead, left = [little, little, wave, wave], [wave, wave, little, little]
        self._prior = np.array([settings.ratio_sigma, bias, bias, *ahead, *left]) ** 2
        self._cov = np.diag(self._prior)
        self._wave = GaitWave()
        self._phasors = np.zeros(HARMONICS)
        self.scale: Float = np.full(3, settings.slip_scale)
        self._watched_s = FIRST_SCALE_TIME_S

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
        return self._slow[BIAS].copy()

    @property
    def wave_m_s(self) -> Float:
        """What turns with the gait, (2, 4): ahead and to the left by cosine and sine, once and twice in a period."""
        return self._slow[WAVE].reshape(2, HARMONICS).copy()

    def see(self, way: Reckoned) -> None:
        """Take the way of the next frame: where in its period the gait is."""
        once, anew = self._wave.see(way.dq_rad_s, way.axes_I[:, 2])
        self._phasors = np.concatenate([once, _twice(once)])
        if anew:
            self._slow[WAVE] = 0.0
            self._cov[WAVE, :] = self._cov[:, WAVE] = 0.0
            self._cov[WAVE, WAVE] = np.diag(self._prior[WAVE])

    def corrected(self, way: Reckoned) -> Reckoned:
        """Return a way reckoned with the ratio with the bias added."""
        bias = self._slow[BIAS] + self.wave_m_s @ self._phasors
        return replace(way, dp_I=way.dp_I + way.dp_D_bias @ bias, v_I=way.v_I + way.axes_I[:, :2] @ bias)

    def cov(self, way: Reckoned) -> Float:
        """Return the covariance (3, 3) of a way: slip and steady states that last, and the wave, which turns."""
        J = self._jacobian(way)
        steady, turning = J[:, : WAVE.start], J[:, WAVE]
        lasting = self._slip(way) + steady @ self._cov[: WAVE.start, : WAVE.start] @ steady.T
        return np.asarray(lasting * self._lasts(way) + turning @ self._cov[WAVE, WAVE] @ turning.T, dtype=np.float64)

    def _slip(self, way: Reckoned) -> Float:
        stretch = way.axes_I * self.scale @ way.axes_I.T
        return stretch @ way.cov_v @ stretch * way.dt_s**2

    def _lasts(self, way: Reckoned) -> float:
        return max(1.0, 2.0 * self._settings.slip_time_s / way.dt_s)

    def _jacobian(self, way: Reckoned) -> Float:
        """Return how the way changes with (log(ratio), bias, wave), (3, 11)."""
        J = np.zeros((3, SLOW))
        J[:, 0], J[:, BIAS] = way.dp_D_log_ratio, way.dp_D_bias
        J[:, WAVE] = (way.dp_D_bias[:, :, None] * self._phasors).reshape(3, 2 * HARMONICS)
        return J

    def learn(self, way: Reckoned, moved_I: Float, cov_moved: Float) -> None:
        """Take what the filter, seeing, says of a corrected way: ``moved_I`` (3,) m with covariance (3, 3).

        A Kalman step on the slow states, slip as lasting noise; then along each axis
        scale^2 <- scale^2 (1 + (d^2 - 1) dt / T), where T is the time watched so far, up to SCALE_TIME_S.
        """
        e = moved_I - way.dp_I
        self._learn_slow(way, e, cov_moved)
        axes_I = way.axes_I
        d2 = (axes_I.T @ e) ** 2 / np.diag(axes_I.T @ (self._slip(way) + cov_moved) @ axes_I)
        self._watched_s = min(self._watched_s + way.dt_s, SCALE_TIME_S)
        gain = min(1.0, way.dt_s / self._watched_s)
        scale = self.scale * np.sqrt(1.0 + (np.minimum(d2, MAX_STEP) - 1.0) * gain)
        self.scale = np.clip(scale, LEAST_SCALE, MOST_SCALE)

    def _learn_slow(self, way: Reckoned, e: Float, cov_moved: Float) -> None:
        J = self._jacobian(way)
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
        growth = np.concatenate([[RATIO_WALK_PER_S], self._prior[BIAS] / BIAS_TIME_S, self._prior[WAVE] / WAVE_TIME_S])
        growth = growth * dt_s
        room = np.maximum(0.0, self._prior - np.diag(self._cov))
        self._cov = self._cov + np.diag(np.minimum(growth, room))


def _twice(once: Float) -> Float:
    """Return cosine and sine of the double angle, as long as those of the single one."""
    length = max(float(np.hypot(*once)), 1e-9)
    return np.array([once[0] ** 2 - once[1] ** 2, 2.0 * once[0] * once[1]]) / length
