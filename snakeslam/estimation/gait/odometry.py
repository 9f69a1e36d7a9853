"""The gait as a sensor: how far the head goes between two times, from measured joints and the balance of friction.

dp_I = int R_kI(t) v_I(t) dt in the IMU's frame at the first time: v_I from ``robot.friction.sliding_velocity``, the
turn R_kI from the gyro. Out of the ground that velocity alone would drift, since what bears next is not what bore: it
is drawn to the height h over the plane on which the body lies, v_I <- v_I + n (h - z) / T with z' = n . v_I.
The model's error lasts, so that it does not average out from frame to frame: an error of sigma that lasts for tau is
taken for white noise of the same strength, var = sigma^2 2 tau dt.
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
HEIGHT_TIME_S = 1.0
"""For shorter the contacts' velocity tells the rise better than the height, in which a head that knocks is not seen."""
STILL_RAD_S = 0.03
"""Joints that all turn slower (rms) do not move the head."""
X_AXIS, Y_AXIS = np.eye(3)[:2]


@dataclass(frozen=True, slots=True)
class Reckoned:
    """A way ``dp_I`` (3,) m over ``dt_s`` in the frame of its beginning; ``cov_v`` (3, 3) that of the mean velocity.

    ``v_I`` (3,) m/s is the velocity at its end, in the frame there; ``dp_D_log_ratio`` (3,). ``axes_I`` (3, 3): ahead
    and to the left along the ground and out of it, there too; ``dp_D_bias`` (3, 2), by a velocity along the first two.
    ``dq_rad_s`` (N,) are the joints' mean rates.
    """

    dt_s: float
    dp_I: Float
    v_I: Float
    cov_v: Float
    dp_D_log_ratio: Float
    dp_D_bias: Float
    axes_I: Float
    dq_rad_s: Float


class GaitOdometer:
    """Reckons ways from the joints of one robot."""

    def __init__(self, model: SnakeModel, settings: GaitSensorSettings) -> None:
        self._model = model
        self._period_ns = 1e9 / settings.rate_hz
        self._guess_I: Float | None = None
        self._height_m: float | None = None

    def reckon(
        self, joints: JointHistory, start_ns: int, end_ns: int, turn: ImuSegments, R_WI: Float, ratio: float
    ) -> Reckoned | None:
        """Return the way between two times, None while the joints rest.

        ``turn`` are the IMU's spans between the times with the bias taken off, ``R_WI`` (3, 3) the attitude at the
        first, of which only the upward direction is used, ``ratio`` that of friction.
        """
        steps = min(MAX_STEPS, max(1, int(np.ceil((end_ns - start_ns) / self._period_ns - 1e-6))))
        cuts = np.linspace(start_ns, end_ns, steps + 1).astype(np.int64)
        spans = [joints.mean(int(a), int(b)) for a, b in pairwise(cuts)]
        if np.sqrt(np.mean([dq**2 for _, dq in spans])) < STILL_RAD_S:
            self._guess_I = self._height_m = None
            return None
        w_I = _mean_rates(turn, np.asarray((cuts - start_ns) * NS, dtype=np.float64))
        R, dt_s = np.eye(3), np.diff(cuts) * NS
        dp_I, by_ratio, by_bias, cov = np.zeros(3), np.zeros(3), np.zeros((3, 2)), np.zeros((3, 3))
        v_I, axes_I = np.zeros(3), np.eye(3)
        for (q, dq), w, dt in zip(spans, w_I, dt_s, strict=True):
            half = so3.exp(0.5 * w * dt)
            R_middle = R @ half
            sliding = sliding_velocity(self._model, q, dq, w, (R_WI @ R_middle)[2], ratio, self._guess_I)
            self._guess_I = sliding.v_I
            v_I, axes_I = self._at_height(sliding, dt), _axes(sliding.ground.normal_I)
            dp_I = dp_I + R_middle @ v_I * dt
            by_ratio = by_ratio + R_middle @ sliding.v_D_log_ratio * dt
            by_bias = by_bias + R_middle @ axes_I[:, :2] * dt
            cov = cov + R_middle @ sliding.cov @ R_middle.T * (dt / dt_s.sum())
            R = R_middle @ half
        dq_rad_s = np.mean([dq for _, dq in spans], axis=0)
        return Reckoned(float(dt_s.sum()), dp_I, v_I, cov, by_ratio, by_bias, axes_I, dq_rad_s)

    def _at_height(self, sliding: Sliding, dt_s: float) -> Float:
        """Return the velocity, drawn to the height of the ground under the body."""
        normal_I, height_m = sliding.ground.normal_I, sliding.ground.height_m
        before_m = height_m if self._height_m is None else self._height_m
        v_I = sliding.v_I + normal_I * (height_m - before_m) * min(1.0 / HEIGHT_TIME_S, 1.0 / dt_s)
        self._height_m = before_m + float(normal_I @ v_I) * dt_s
        return v_I


def _axes(normal_I: Float) -> Float:
    """Return ahead, left and out of the ground, (3, 3): the IMU's x and y along it, y first if it looks up or down."""
    flat = abs(float(normal_I[0])) < np.cos(np.pi / 6.0)
    ahead = X_AXIS if flat else so3.cross(Y_AXIS, normal_I)
    ahead = ahead - normal_I * (normal_I @ ahead)
    ahead = ahead / np.sqrt(ahead @ ahead)
    return np.stack([ahead, so3.cross(normal_I, ahead), normal_I], axis=1)


def _mean_rates(turn: ImuSegments, cuts_s: Float) -> Float:
    """Return the mean rates between times from the start, (n, 3) rad/s."""
    ends_s = np.concatenate([[0.0], np.cumsum(turn.dt_s)])
    angles = np.concatenate([np.zeros((1, 3)), np.cumsum(turn.gyro_I * turn.dt_s[:, None], axis=0)])
    at = np.stack([np.interp(cuts_s, ends_s, angles[:, k]) for k in range(3)], axis=-1)
    return np.diff(at, axis=0) / np.diff(cuts_s)[:, None]
