"""Predictive head control: the neck holds the head on a line in the world against what the whole body will do.

The closed forms assume that the motion of the neck does not move the body. Here the resistive model of the whole body
gives the head's planar twist J dq for any joint rates, and the neck's rates are those that give the head the wanted
twist,

    dq_n = r + (W J_n)^T (W J_n J_n^T W + lambda I)^-1 W [ v - J_b dq_b - J_n r ],    r = dq_c + 2 (q_c - q_n),

with q_c the closed form of Eq. (20), v = (v_mean, -8 e_y + s, -8 psi) from the head's yaw error psi and its sideways
error e_y to the line, s the correction learned over the gait's period (``rhythm.py``), W = diag(w_x, 3, 1). The
line is where the robot is to go: rotating it steers.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from snakeslam.geometry import se3, so3
from snakeslam.geometry.compiled import compiled
from snakeslam.head.line import LineErrors
from snakeslam.head.neck import Neck
from snakeslam.head.rhythm import GaitRhythm
from snakeslam.messages import Float
from snakeslam.robot.friction import resistive_map
from snakeslam.robot.model import SnakeModel

LARGEST_RAD = float(np.deg2rad(88.0))
RETURN_RAD_S = 2.0
"""Rate at which the neck returns to the closed form where the head does not need it."""
YAW_GAIN_RAD_S = 8.0
LATERAL_GAIN_RAD_S = 8.0
LATERAL_MOST_M_S = 0.15
"""Largest lateral velocity asked for, so that a distant line is approached gently."""
YAW_MOST_RAD_S = 1.0
"""Largest yaw rate asked for, so that a head that is caught in its swing returns gently."""
DAMPING = 1e-3
LEAST_EASE = 1e-3
EASE_POWER = 2
WEIGHTS = np.array([0.1, 3.0, 1.0])
MEAN_SPEED_PERIODS = 1.0


@dataclass(slots=True)
class PredictiveNeck:
    """The neck's angles, integrated: one ``step`` for each target."""

    model: SnakeModel
    neck: Neck
    loads: Float
    friction_ratio: float
    q_neck_rad: Float
    v_mean_m_s: float = 0.0
    sway: GaitRhythm = field(default_factory=GaitRhythm)

    def step(
        self, q_rad: Float, dq_rad_s: Float, errors: LineErrors, pace: float, period_s: float, dt_s: float
    ) -> Float:
        """Return the neck's angles (n,) rad after ``dt_s``.

        ``q_rad`` and ``dq_rad_s`` (N,) are the body's targets and rates, the neck's own being the closed form's;
        ``pace`` in [-1, 1] is the gait's speed, 0 holds.
        """
        chosen = self.neck.joints
        shape = q_rad.copy()
        shape[chosen] = self.q_neck_rad
        T_WI = se3.from_rt(so3.from_yaw(errors.yaw_rad), np.zeros(3))
        J = resistive_map(self.model, shape, T_WI, self.loads, self.friction_ratio)
        self.sway.learn(errors.lateral_m, LATERAL_GAIN_RAD_S, pace, period_s, dt_s)
        eager = abs(pace)
        back = dq_rad_s.copy()
        back[chosen] += RETURN_RAD_S * eager * (q_rad[chosen] - self.q_neck_rad)
        rate, v_free = _neck_rates(J, back, chosen, self.q_neck_rad, self._wanted(errors, eager))
        self.v_mean_m_s += (float(v_free) - self.v_mean_m_s) * min(1.0, eager * dt_s / (MEAN_SPEED_PERIODS * period_s))
        self.q_neck_rad = np.minimum(np.maximum(self.q_neck_rad + rate * dt_s, -LARGEST_RAD), LARGEST_RAD)
        return self.q_neck_rad

    def _wanted(self, errors: LineErrors, eager: float) -> Float:
        sideways = -LATERAL_GAIN_RAD_S * errors.lateral_m + self.sway.correction_m_s
        sideways = min(max(sideways, -LATERAL_MOST_M_S), LATERAL_MOST_M_S)
        turn = min(max(-YAW_GAIN_RAD_S * errors.yaw_rad, -YAW_MOST_RAD_S), YAW_MOST_RAD_S)
        return eager * np.array([self.v_mean_m_s, sideways, turn])


def prepare(model: SnakeModel, neck: Neck) -> None:
    """Compile what a step needs, if it is not yet: at its first use it would hold up a moving robot."""
    rest = model.rest_q_rad
    J = resistive_map(model, rest, np.eye(4), np.ones(model.link_count), 1.0)
    _neck_rates(J, np.zeros_like(rest), neck.joints, rest[neck.joints], np.zeros(3))


@compiled
def _neck_rates(
    J: Float, dq_rad_s: Float, neck: NDArray[np.int64], q_neck_rad: Float, wanted: Float
) -> tuple[Float, float]:
    """Return the neck's rates (n,) that leave the head the twist ``wanted`` (3,), and the forward speed without them.

    ``J`` (3, N) maps joint rates to the head's twist; ``dq_rad_s`` (N,) has the neck's rates of return in its place.
    """
    free = J @ dq_rad_s
    willing = ease(q_neck_rad)
    WJ = np.empty((3, len(neck)))
    for n in range(len(neck)):
        WJ[:, n] = WEIGHTS * J[:, neck[n]]
    QJ = np.ascontiguousarray((WJ * willing).T)
    pull = np.linalg.solve(WJ @ QJ + DAMPING * np.eye(3), WEIGHTS * (wanted - free))
    return dq_rad_s[neck] + QJ @ pull, free[0]


@compiled
def ease(q_rad: Float) -> Float:
    """Return how willing each joint is to help, (n,): a joint that is bent far leaves the work to the others."""
    return np.maximum(LEAST_EASE, (1.0 - (q_rad / LARGEST_RAD) ** 2) ** EASE_POWER)
