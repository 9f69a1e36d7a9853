"""Head control in 3D: the neck's yaw and pitch joints keep the head level and looking ahead in any gait.

The root of the neck rotates at w_R, which follows from gyroscope and joints: w_R = w_I - J dq_n. It repeats with the
gait's phase, so a Fourier series in the phase, fitted by recursive least squares, predicts it for the time at which
the servos will have followed. The rates of the neck compensate it and rotate the head back to the wanted attitude,

    dq_n = J^+ [ -K e - w_R(sigma + omega lag) ] + (1 - J^+ J) r (q_c - q_n),

e the head's attitude error. In a rolling gait the neck would wind up, so there the roll about the optical axis is left
out.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from snakeslam.geometry import so3
from snakeslam.head.predictive import LARGEST_RAD, ease
from snakeslam.messages import Float, JointState
from snakeslam.robot.kinematics import link_poses_from_imu
from snakeslam.robot.model import SnakeModel

GAIN_RAD_S = 4.0
RETURN_RAD_S = 1.0
DAMPING = 0.02
LAG_S = 0.05
"""From a target to the motion of the joint, and from that to the gyroscope."""
HARMONICS = 4
FORGETTING = 0.998
"""Share of the past kept in one step: about five seconds."""
RATE_MOST_RAD_S = 3.0


@dataclass(slots=True)
class PhaseSeries:
    """A Fourier series of a vector (3,) in the phase, fitted by recursive least squares."""

    coefficients: Float = field(default_factory=lambda: np.zeros((2 * HARMONICS + 1, 3)))
    spread: Float = field(default_factory=lambda: 10.0 * np.eye(2 * HARMONICS + 1))

    def at(self, sigma: float) -> Float:
        """Return the series at a phase, (3,)."""
        return _waves(sigma) @ self.coefficients

    def learn(self, sigma: float, value: Float) -> None:
        """Add the value measured at a phase."""
        waves = _waves(sigma)
        gain = self.spread @ waves / (FORGETTING + waves @ self.spread @ waves)
        self.coefficients = self.coefficients + np.outer(gain, value - waves @ self.coefficients)
        spread = (self.spread - np.outer(gain, waves @ self.spread)) / FORGETTING
        self.spread = np.minimum((spread + spread.T) / 2.0, 100.0)


def _waves(sigma: float) -> Float:
    angles = sigma * np.arange(1, HARMONICS + 1)
    return np.concatenate([[1.0], np.cos(angles), np.sin(angles)])


@dataclass(slots=True)
class LevelNeck:
    """The angles of the foremost joints (indices ``joints``), integrated: one ``step`` for each target."""

    model: SnakeModel
    joints: NDArray[np.int64]
    q_neck_rad: Float
    holds_roll: bool
    root: PhaseSeries = field(default_factory=PhaseSeries)

    def step(
        self,
        q_rad: Float,
        joints: JointState | None,
        gyro_I: Float,
        R_WI: Float,
        heading_rad: float,
        sigma: float,
        rate_rad_s: float,
        dt_s: float,
    ) -> Float:
        """Return the neck's angles (m,) rad after ``dt_s``.

        ``q_rad`` (N,) are the gait's targets, ``R_WI`` the head's attitude, ``heading_rad`` where it shall look,
        ``sigma`` and ``rate_rad_s`` the gait's phase and its speed.
        """
        shape = q_rad.copy()
        shape[self.joints] = self.q_neck_rad
        J = self._jacobian(shape if joints is None else joints.q_rad)
        if joints is not None:
            self.root.learn(sigma, R_WI @ (gyro_I - J @ joints.dq_rad_s[self.joints]))
        eager = min(1.0, abs(rate_rad_s))
        root_I = R_WI.T @ self.root.at(sigma + LAG_S * rate_rad_s)
        wanted = -eager * GAIN_RAD_S * self._error(R_WI, heading_rad) - (root_I if eager else 0.0)
        if not self.holds_roll:
            J, wanted = J[1:], wanted[1:]
        JQ = ease(self.q_neck_rad)[:, None] * J.T
        pinv = JQ @ np.linalg.inv(J @ JQ + DAMPING * np.eye(len(J)))
        back = RETURN_RAD_S * eager * (q_rad[self.joints] - self.q_neck_rad)
        rate = np.clip(pinv @ (wanted - J @ back) + back, -RATE_MOST_RAD_S, RATE_MOST_RAD_S)
        self.q_neck_rad = np.clip(self.q_neck_rad + rate * dt_s, -LARGEST_RAD, LARGEST_RAD)
        return self.q_neck_rad

    def _jacobian(self, q_rad: Float) -> Float:
        """Return the head's angular rate for the neck's joint rates, (3, m) in I."""
        Ts_IL = link_poses_from_imu(self.model, q_rad, np.eye(4))
        return np.einsum("mij,mj->im", Ts_IL[self.joints + 1, :3, :3], self.model.axes_L[self.joints])

    def _error(self, R_WI: Float, heading_rad: float) -> Float:
        """Return the error of the attitude as sine times axis, (3,) in I; in rolling that of the optical axis."""
        R_WV = so3.from_yaw(heading_rad)
        if self.holds_roll:
            R_VI = R_WV.T @ R_WI
            return so3.vee(R_VI - R_VI.T) / 2.0
        ahead_I = R_WI.T @ R_WV[:, 0]
        return np.array([0.0, ahead_I[2], -ahead_I[1]])
