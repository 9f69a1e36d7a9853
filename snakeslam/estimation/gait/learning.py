"""The slowly varying errors of the friction model, estimated while the camera supports the pose.

They are log(friction ratio), a bias of the velocity along the ground, constant and periodic with the gait, and the
scale of the remaining error. Why periodic: how the weight is shared out between the links is not known exactly, and
what is wrong with it returns in every period. Half a period later a serpentine body is its own mirror image. So the
bias ahead is then the same and has twice the gait's frequency; the bias to the left is opposite and has the gait's
frequency. A periodic bias without that symmetry gets a small prior.

The estimate stands outside of the filter: the camera measures displacements so much better than the gait that the
correlations between both contain next to nothing.
"""

from dataclasses import replace

import numpy as np

from snakeslam.estimation.gait.odometry import ModelledDisplacement
from snakeslam.estimation.gait.phase import GaitPhase
from snakeslam.estimation.gait.settings import GaitSensorSettings
from snakeslam.messages import Float

CHI2_3_999 = 16.27
"""The 99.9 % quantile of chi^2 with three degrees of freedom: beyond it a displacement corrects neither ratio nor
bias."""
RATIO_WALK_PER_S = 0.001
"""Growth of the variance of log(ratio), 1/s: the ground changes slowly."""
BIAS_TIME_S = 30.0
"""Time in which the variance of the bias grows back to its prior: another gait has another bias."""
PERIODIC_TIME_S = 300.0
"""The same for the periodic bias, which is reset with the gait and hardly changes within one."""
SCALE_TIME_S = 3.0
"""Longest time over which the scale of the error is averaged."""
FIRST_SCALE_TIME_S = 1.0
"""Weight of the initial scale: that of having observed it for so long."""
MAX_SQUARED_INNOVATION = 10.0
"""Larger normalised squared innovations count as this one in the scale: one outlier does not make the model useless."""
MIN_SCALE, MAX_SCALE = 0.1, 20.0
"""Along the ground the model errs by 0.2 to 0.4 sigmas in serpentine gaits, by 1 in rolling and raised ones."""
MAX_RATIO = 20.0
ASYMMETRIC_SHARE = 0.2
"""Prior sigma of a periodic bias without the mirror symmetry, as a share of that with it."""
HARMONICS = 4
"""Cosine and sine of the gait's phase and of its double."""
SIZE = 3 + 2 * HARMONICS
BIAS, PERIODIC = slice(1, 3), slice(3, SIZE)


class SlipModel:
    """x = (log(ratio), bias, periodic bias) as a random walk, and the scale of the error of the velocity.

    The bias (2,) m/s is ahead and to the left along the ground: in rolling the balance of friction is too fast, at
    every ratio. The periodic bias (2, 4) m/s has the same directions, along cosine and sine of the phase and of its
    double. The scale (3,) is in sigmas of the friction model's own covariance, ahead, to the left and out of the
    ground: a head that knocks is wrong upwards and right ahead.
    """

    def __init__(self, settings: GaitSensorSettings) -> None:
        self._settings = settings
        self._x = np.zeros(SIZE)
        self._x[0] = np.log(settings.friction_ratio)
        bias, periodic = settings.bias_sigma_m_s, settings.wave_sigma_m_s
        small = ASYMMETRIC_SHARE * periodic
        ahead, left = [small, small, periodic, periodic], [periodic, periodic, small, small]
        self._prior = np.array([settings.ratio_sigma, bias, bias, *ahead, *left]) ** 2
        self._cov = np.diag(self._prior)
        self._phase = GaitPhase()
        self._harmonics = np.zeros(HARMONICS)
        self.scale: Float = np.full(3, settings.slip_scale)
        self._scale_time_s = FIRST_SCALE_TIME_S

    @property
    def log_ratio(self) -> float:
        """Logarithm of the friction ratio."""
        return float(self._x[0])

    @property
    def ratio(self) -> float:
        """Friction across the body over friction along it."""
        return float(np.exp(self._x[0]))

    @property
    def bias_m_s(self) -> Float:
        """The constant bias ahead and to the left, (2,) m/s, to be added to the modelled velocity."""
        return self._x[BIAS].copy()

    @property
    def periodic_bias_m_s(self) -> Float:
        """The periodic bias, (2, 4): ahead and to the left by (cos, sin) of the phase and of its double."""
        return self._x[PERIODIC].reshape(2, HARMONICS).copy()

    def update_phase(self, modelled: ModelledDisplacement) -> None:
        """Update the gait's phase with the next frame's displacement; a new gait resets the periodic bias."""
        once, is_new = self._phase.update(modelled.dq_rad_s, modelled.axes_I[:, 2])
        # (cos, sin)(2 phi) = (c^2 - s^2, 2 c s) / |(c, s)|, as long as (c, s) itself.
        length = max(float(np.hypot(*once)), 1e-9)
        twice = np.array([once[0] ** 2 - once[1] ** 2, 2.0 * once[0] * once[1]]) / length
        self._harmonics = np.concatenate([once, twice])
        if is_new:
            self._x[PERIODIC] = 0.0
            self._cov[PERIODIC, :] = self._cov[:, PERIODIC] = 0.0
            self._cov[PERIODIC, PERIODIC] = np.diag(self._prior[PERIODIC])

    def corrected(self, modelled: ModelledDisplacement) -> ModelledDisplacement:
        """Return the displacement with both biases added."""
        bias = self._x[BIAS] + self.periodic_bias_m_s @ self._harmonics
        dp_I, v_I = modelled.dp_I + modelled.dp_D_bias @ bias, modelled.v_I + modelled.axes_I[:, :2] @ bias
        return replace(modelled, dp_I=dp_I, v_I=v_I)

    def cov(self, modelled: ModelledDisplacement) -> Float:
        """Return the covariance (3, 3) of a displacement.

        Slip, ratio and bias last for tau, which as white noise is a factor of 2 tau / dt; the periodic bias does not.
        """
        J = self._jacobian(modelled)
        constant, periodic = J[:, : PERIODIC.start], J[:, PERIODIC]
        lasting = self._slip(modelled) + constant @ self._cov[: PERIODIC.start, : PERIODIC.start] @ constant.T
        varying = periodic @ self._cov[PERIODIC, PERIODIC] @ periodic.T
        return np.asarray(lasting * self._noise_factor(modelled) + varying, dtype=np.float64)

    def learn(self, modelled: ModelledDisplacement, dp_I: Float, cov_dp: Float) -> None:
        """Update by the filter's own displacement ``dp_I`` (3,) m with covariance (3, 3), while the camera supports it.

        ``modelled`` is the corrected displacement of the same time.
        """
        # 1. Random walk: the variances grow, each up to its prior. One whose prior is 0 is not estimated.
        growth = np.concatenate(
            [[RATIO_WALK_PER_S], self._prior[BIAS] / BIAS_TIME_S, self._prior[PERIODIC] / PERIODIC_TIME_S]
        )
        growth = growth * modelled.dt_s
        headroom = np.maximum(0.0, self._prior - np.diag(self._cov))
        self._cov = self._cov + np.diag(np.minimum(growth, headroom))

        # 2. Kalman update x <- x + K e with the innovation e, S = slip + cov_dp + J P J^T, if e is within its gate.
        e, J = dp_I - modelled.dp_I, self._jacobian(modelled)
        S = self._slip(modelled) * self._noise_factor(modelled) + cov_dp + J @ self._cov @ J.T
        if float(e @ np.linalg.solve(S, e)) <= CHI2_3_999:
            gain = np.linalg.solve(S, J @ self._cov).T
            self._x = self._x + gain @ e
            self._x[0] = np.clip(self._x[0], 0.0, np.log(MAX_RATIO))
            cov = self._cov - gain @ J @ self._cov
            self._cov = 0.5 * (cov + cov.T)

        # 3. Scale along each axis: s^2 <- s^2 (1 + (d^2 - 1) dt / T), d^2 = e^2 / (slip + cov_dp), T the time so far.
        axes_I = modelled.axes_I
        d2 = (axes_I.T @ e) ** 2 / np.diag(axes_I.T @ (self._slip(modelled) + cov_dp) @ axes_I)
        self._scale_time_s = min(self._scale_time_s + modelled.dt_s, SCALE_TIME_S)
        gain_scale = min(1.0, modelled.dt_s / self._scale_time_s)
        scale = self.scale * np.sqrt(1.0 + (np.minimum(d2, MAX_SQUARED_INNOVATION) - 1.0) * gain_scale)
        self.scale = np.clip(scale, MIN_SCALE, MAX_SCALE)

    def _slip(self, modelled: ModelledDisplacement) -> Float:
        """Return D S_v D dt^2 (3, 3), D = A diag(scale) A^T: the model's covariance, scaled along each axis."""

        D = modelled.axes_I * self.scale @ modelled.axes_I.T
        return D @ modelled.cov_v @ D * modelled.dt_s**2

    def _noise_factor(self, modelled: ModelledDisplacement) -> float:
        """Return 2 tau / dt, the factor by which an error that lasts for tau is larger as white noise."""
        return max(1.0, 2.0 * self._settings.slip_time_s / modelled.dt_s)

    def _jacobian(self, modelled: ModelledDisplacement) -> Float:
        """Return d(dp)/d(log(ratio), bias, periodic bias), (3, 11)."""
        J = np.zeros((3, SIZE))
        J[:, 0], J[:, BIAS] = modelled.dp_D_log_ratio, modelled.dp_D_bias
        J[:, PERIODIC] = (modelled.dp_D_bias[:, :, None] * self._harmonics).reshape(3, 2 * HARMONICS)
        return J
