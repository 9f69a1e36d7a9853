"""Predictive head control: the neck holds the head on a line in the world against what the whole body will do.

The closed forms suppose that the body does not feel the neck. Here the resistive model of the whole body gives the
head's planar twist J dq for any joint rates, and the neck's rates are those that leave the head the wanted twist,

    dq_n = r + (W J_n)^T (W J_n J_n^T W + lambda I)^-1 W [ v - J_b dq_b - J_n r ],    r = dq_c + 2 (q_c - q_n),

with q_c the closed form of Eq. (20), v = (v_mean, -8 e_y + s, -8 psi) from the head's yaw error psi and its sideways
error e_y to the line, s what the gait's rhythm taught (``rhythm.py``), W = diag(w_x, 3, 1). The line is where the robot
is to go: turning it steers.
"""

from dataclasses import dataclass, field

import numpy as np

from snakeslam.geometry import se3, so3
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
"""Fastest sideways motion asked for: a line far away is approached, not jumped at."""
YAW_MOST_RAD_S = 1.0
"""Fastest turn asked for: a head taken over amid its swing comes round, it is not thrown."""
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
        body = np.ones(len(q_rad), dtype=bool)
        body[chosen] = False
        T_WI = se3.from_rt(so3.from_yaw(errors.yaw_rad), np.zeros(3))
        J = resistive_map(self.model, shape, T_WI, self.loads, self.friction_ratio)
        eager = abs(pace)
        rate = dq_rad_s[chosen] + RETURN_RAD_S * eager * (q_rad[chosen] - self.q_neck_rad)
        free = J[:, body] @ dq_rad_s[body] + J[:, chosen] @ rate
        self.sway.learn(errors.lateral_m, LATERAL_GAIN_RAD_S, pace, period_s, dt_s)
        wanted = self._wanted(errors, eager)
        gap = WEIGHTS * (wanted - free)
        WJ = WEIGHTS[:, None] * J[:, chosen]
        QJ = ease(self.q_neck_rad)[:, None] * WJ.T
        rate = rate + QJ @ np.linalg.solve(WJ @ QJ + DAMPING * np.eye(3), gap)
        self.v_mean_m_s += (float(free[0]) - self.v_mean_m_s) * min(1.0, eager * dt_s / (MEAN_SPEED_PERIODS * period_s))
        self.q_neck_rad = np.clip(self.q_neck_rad + rate * dt_s, -LARGEST_RAD, LARGEST_RAD)
        return self.q_neck_rad

    def _wanted(self, errors: LineErrors, eager: float) -> Float:
        sideways = -LATERAL_GAIN_RAD_S * errors.lateral_m + self.sway.correction_m_s
        sideways = min(max(sideways, -LATERAL_MOST_M_S), LATERAL_MOST_M_S)
        turn = min(max(-YAW_GAIN_RAD_S * errors.yaw_rad, -YAW_MOST_RAD_S), YAW_MOST_RAD_S)
        return eager * np.array([self.v_mean_m_s, sideways, turn])


def ease(q_rad: Float) -> Float:
    """Return how willing each joint is to help, (n,): a joint that is bent far leaves the work to the others."""
    return np.maximum(LEAST_EASE, (1.0 - (q_rad / LARGEST_RAD) ** 2) ** EASE_POWER)
