"""The displacement of the head between two times, from the measured joints and the balance of friction.

    dp_I = int R_kI(t) v_I(t) dt,   in the IMU's frame at the first time k,

with v_I from ``robot.friction.sliding_velocity`` and the rotation R_kI from the gyro. In rolling gaits the supporting
links change continuously, so that the vertical velocity of that balance does not integrate to zero. It is therefore
drawn to the height h of the head above the plane on which the body lies, n its normal and z the integrated height:

    v_I <- v_I + n (h - z) / T,   dz/dt = n . v_I.

The model's error lasts for tenths of a second and does not average out from frame to frame: an error of sigma that
lasts for tau is taken for white noise of the same strength, var = sigma^2 2 tau dt (``learning.SlipModel.cov``).
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from snakeslam.estimation.filter.preintegration import ImuSegments
from snakeslam.estimation.gait.joint_history import JointHistory
from snakeslam.estimation.gait.settings import GaitSensorSettings
from snakeslam.geometry import so3
from snakeslam.messages import Float
from snakeslam.robot.friction import Sliding, sliding_velocity
from snakeslam.robot.model import SnakeModel

NS = 1e-9
MAX_STEPS = 12
"""Most solutions of the balance of friction in one displacement, which bounds the time after a gap of frames."""
HEIGHT_TIME_S = 1.0
"""T above, in s. Over shorter times the contacts' velocity is the better measure: a head that knocks has no height."""
STATIONARY_RAD_S = 0.03
"""Joint rates (RMS) below this do not move the head; servos report rates in steps of 0.024 rad/s."""
X_AXIS, Y_AXIS = np.eye(3)[:2]
MAX_UP_COS = np.cos(np.pi / 6.0)
"""Cosine of 30 deg: nearer to the ground's normal the IMU's x axis has no direction along the ground."""


@dataclass(frozen=True, slots=True)
class ModelledDisplacement:
    """A displacement ``dp_I`` (3,) m over ``dt_s`` in the frame at its start; ``cov_v`` (3, 3) of its mean velocity.

    ``v_I`` (3,) m/s is the velocity at the end and ``axes_I`` (3, 3) the directions ahead, to the left along the ground
    and out of it (columns), both in the frame at the end. ``dp_D_log_ratio`` (3,) is the derivative by the logarithm of
    the friction ratio, ``dp_D_bias`` (3, 2) by a velocity ahead and to the left. ``dq_rad_s`` (N,) are the joints' mean
    rates.
    """

    dt_s: float
    dp_I: Float
    v_I: Float
    cov_v: Float
    dp_D_log_ratio: Float
    dp_D_bias: Float
    axes_I: Float
    dq_rad_s: Float


class FrictionOdometry:
    """Integrates the displacements of one robot from its joints."""

    def __init__(self, model: SnakeModel, settings: GaitSensorSettings) -> None:
        self._model = model
        self._period_ns = 1e9 / settings.rate_hz
        self._guess_I: Float | None = None
        """The last velocity, from which the next solution of the balance starts."""
        self._height_m: float | None = None

    def displacement(
        self, joints: JointHistory, start_ns: int, end_ns: int, rotation: ImuSegments, R_WI: Float, ratio: float
    ) -> ModelledDisplacement | None:
        """Return the displacement between two times, None while the joints are stationary.

        ``rotation`` are the IMU's spans between the times without the gyro's bias, ``R_WI`` (3, 3) is the attitude at
        the first time, of which only the upward direction is used, ``ratio`` the friction ratio.
        """
        # 1. Cut the time into equal steps, with mean angles and rates of the joints in each.
        steps = min(MAX_STEPS, max(1, int(np.ceil((end_ns - start_ns) / self._period_ns - 1e-6))))
        cuts = np.linspace(start_ns, end_ns, steps + 1).astype(np.int64)
        spans = [joints.mean(int(a), int(b)) for a, b in pairwise(cuts)]
        if np.sqrt(np.mean([dq**2 for _, dq in spans])) < STATIONARY_RAD_S:
            self._guess_I = self._height_m = None
            return None
        w_I = _mean_rates(rotation, np.asarray((cuts - start_ns) * NS, dtype=np.float64))
        R, dt_s = np.eye(3), np.diff(cuts) * NS
        dp_I, by_ratio, by_bias, cov = np.zeros(3), np.zeros(3), np.zeros((3, 2)), np.zeros((3, 3))
        v_I, axes_I = np.zeros(3), np.eye(3)
        for (q, dq), w, dt in zip(spans, w_I, dt_s, strict=True):
            # 2. R_kI at the middle of the step, and the velocity at which Coulomb friction balances there.
            half = so3.exp(0.5 * w * dt)
            R_middle = R @ half
            sliding = sliding_velocity(self._model, q, dq, w, (R_WI @ R_middle)[2], ratio, self._guess_I)
            self._guess_I = sliding.v_I
            v_I, axes_I = self._drawn_to_height(sliding, dt), _ground_axes(sliding.ground.normal_I)

            # 3. dp += R_kI v dt, its derivatives alike; the covariance is the mean over time of that of the velocity.
            dp_I = dp_I + R_middle @ v_I * dt
            by_ratio = by_ratio + R_middle @ sliding.v_D_log_ratio * dt
            by_bias = by_bias + R_middle @ axes_I[:, :2] * dt
            cov = cov + R_middle @ sliding.cov @ R_middle.T * (dt / dt_s.sum())
            R = R_middle @ half
        dq_rad_s = np.mean([dq for _, dq in spans], axis=0)
        return ModelledDisplacement(float(dt_s.sum()), dp_I, v_I, cov, by_ratio, by_bias, axes_I, dq_rad_s)

    def _drawn_to_height(self, sliding: Sliding, dt_s: float) -> Float:
        """Return v_I + n (h - z) / T, and integrate z."""
        normal_I, height_m = sliding.ground.normal_I, sliding.ground.height_m
        before_m = height_m if self._height_m is None else self._height_m
        v_I = sliding.v_I + normal_I * (height_m - before_m) * min(1.0 / HEIGHT_TIME_S, 1.0 / dt_s)
        self._height_m = before_m + float(normal_I @ v_I) * dt_s
        return v_I


def _ground_axes(normal_I: Float) -> Float:
    """Return the directions ahead, left and out of the ground as columns, (3, 3).

    Ahead is the IMU's x axis projected on the ground; where x points up or down, left is its y axis.
    """
    level = abs(float(normal_I[0])) < MAX_UP_COS
    ahead = X_AXIS if level else so3.cross(Y_AXIS, normal_I)
    ahead = ahead - normal_I * (normal_I @ ahead)
    ahead = ahead / np.sqrt(ahead @ ahead)
    return np.stack([ahead, so3.cross(normal_I, ahead), normal_I], axis=1)


def _mean_rates(rotation: ImuSegments, cuts_s: Float) -> Float:
    """Return the mean angular rates between times from the start, (n, 3) rad/s."""
    ends_s = np.concatenate([[0.0], np.cumsum(rotation.dt_s)])
    angles = np.concatenate([np.zeros((1, 3)), np.cumsum(rotation.gyro_I * rotation.dt_s[:, None], axis=0)])
    at_cuts = np.stack([np.interp(cuts_s, ends_s, angles[:, k]) for k in range(3)], axis=-1)
    return np.diff(at_cuts, axis=0) / np.diff(cuts_s)[:, None]
