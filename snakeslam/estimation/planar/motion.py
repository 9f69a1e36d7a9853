"""From measured joints to the motion of the robot in the plane, by the paper's models; no command is needed.

V is the virtual chassis: its origin is the centre of mass, its x axis the mean heading of the links, level.
"""

from dataclasses import dataclass

import numpy as np

from snakeslam.estimation.planar.models import Rods, Twist, fan_rolling_speed, paper_rolling_speed, wheel_speed
from snakeslam.estimation.planar.settings import RollingModel
from snakeslam.geometry import se3, so3
from snakeslam.messages import Float
from snakeslam.robot.kinematics import link_poses_from_imu
from snakeslam.robot.model import SnakeModel

FLAT_RAD = 0.05
FLAT_RAD_S = 0.12
"""Largest pitch angle and rate of a body that lies flat: then it is stationary or serpentine."""
LIFTED_RAD = 0.17
"""A pitch joint bent further than this raises the neck."""
MIN_ARC_RAD = 0.03
"""Least bend per joint of an arc."""
ARC_SPREAD = 0.3
"""Largest standard deviation of the joints of an arc, as a share of its bend."""


@dataclass(frozen=True, slots=True)
class BodyShape:
    """The head in the chassis frame: position ``r_V`` (2,) m of the IMU, its yaw ``yaw_rad`` from the mean heading."""

    r_V: Float
    yaw_rad: float


class GaitMotionModel:
    """The motion models of one robot."""

    def __init__(self, model: SnakeModel, friction_ratio: float, rolling: RollingModel) -> None:
        self._model, self._ratio, self._rolling = model, friction_ratio, rolling
        self._rods = Rods(model.link_count, model.joint_length_m / 2.0)
        self._is_yaw = np.asarray(model.is_yaw)
        body = np.arange(model.joint_count) < model.head_raise_joints[0] - 1
        self._yaw, self._pitch = body & self._is_yaw, body & ~self._is_yaw

    def twist_V(self, q_rad: Float, dq_rad_s: Float) -> Twist | None:
        """Return the motion of the chassis for joints (N,), in V; None in a gait for which the paper has no model."""
        pitch, dpitch = q_rad[self._pitch], dq_rad_s[self._pitch]
        if np.max(np.abs(pitch)) < FLAT_RAD and np.max(np.abs(dpitch)) < FLAT_RAD_S:
            return self._serpentine(q_rad, dq_rad_s)
        return self._arc_rolling(q_rad, dq_rad_s) if self._is_arc(q_rad) else None

    def shape(self, q_rad: Float, R_WI: Float) -> BodyShape:
        """Return the head's pose on the body, for joints (N,) and the attitude of the IMU (its yaw has no effect)."""
        # Links in a frame with the IMU at the origin, its yaw zero, z up; their mean is the centre of mass.
        R_level = so3.from_yaw(-so3.yaw(R_WI)) @ R_WI
        Ts = link_poses_from_imu(self._model, q_rad, se3.from_rt(R_level, np.zeros(3)))
        com = se3.act(Ts, self._model.com_L)[:, :2].mean(axis=0)
        # Headings of the links, unwrapped from the head on, whose heading is 0 here.
        headings = np.unwrap(so3.yaw(Ts[::-1, :3, :3]))
        mean = float(headings.mean())
        return BodyShape(-rotation(-mean) @ com, -mean)

    def level_attitude(self, q_rad: Float) -> Float:
        """Return R_WI (3, 3), its yaw without meaning, of a body that lies flat with these joints."""
        a, b = float(q_rad[self._yaw].mean()), float(q_rad[self._pitch].mean())
        roll_rad = np.arctan2(-b, a) if self._is_arc(q_rad) else 0.0
        Ts = link_poses_from_imu(self._model, q_rad, np.eye(4))
        R_IM = Ts[self._model.link_count // 2, :3, :3]
        return so3.exp(np.array([roll_rad, 0.0, 0.0])) @ R_IM.T

    def _is_arc(self, q_rad: Float) -> bool:
        """Return whether all yaw joints are bent alike, and all pitch joints."""
        yaw, pitch = q_rad[self._yaw], q_rad[self._pitch]
        size = float(np.hypot(yaw.mean(), pitch.mean()))
        return size > MIN_ARC_RAD and max(float(yaw.std()), float(pitch.std())) < ARC_SPREAD * size

    def _serpentine(self, q_rad: Float, dq_rad_s: Float) -> Twist:
        """Return the motion of Eq. (31), closed by the balance of friction."""
        yaw = np.where(self._is_yaw, q_rad, 0.0)
        rates = np.where(self._is_yaw, dq_rad_s, 0.0)
        theta, dtheta = (np.concatenate([[0.0], np.cumsum(x)]) for x in (yaw, rates))
        load = self._load(q_rad)
        return self._rods.twist(theta - theta.mean(), dtheta - dtheta.mean(), load, self._ratio)

    def _load(self, q_rad: Float) -> Float:
        """Return the load of each link, (N + 1,), in weights of a link.

        Links in front of a raised pitch joint have no load. Their weight is on the last link before it, about which
        they lift as many links behind it.
        """
        load = np.ones(self._model.link_count)
        raised = np.flatnonzero(~self._is_yaw & (np.abs(q_rad) > LIFTED_RAD))
        if raised.size:
            last = int(raised[0])
            lifted = len(load) - 1 - last
            load[max(0, last - lifted) :] = 0.0
            load[last] = len(load) - load.sum()
        return load

    def _arc_rolling(self, q_rad: Float, dq_rad_s: Float) -> Twist:
        """Return the motion of Eq. (32)-(36): the phase is the direction of the bend; positive rates roll right."""
        # Mean bend (a, b) = A (sin, cos)(phase) of yaw and pitch joints; its rate is omega = (b da - a db) / A^2.
        a, b = float(q_rad[self._yaw].mean()), float(q_rad[self._pitch].mean())
        da, db = float(dq_rad_s[self._yaw].mean()), float(dq_rad_s[self._pitch].mean())
        amplitude = float(np.hypot(a, b))
        omega = (b * da - a * db) / amplitude**2
        model, phase = self._model, float(np.arctan2(a, b))
        if self._rolling == "paper":
            speed = paper_rolling_speed(omega, model.radius_m, model.joint_length_m, amplitude, phase)
        else:
            speed = fan_rolling_speed(omega, model.radius_m, model.joint_count, amplitude)
        return Twist(np.array([0.0, -speed]), 0.0, abs(wheel_speed(omega, model.radius_m)))


def rotation(angle_rad: float) -> Float:
    """Return the rotation of the plane, (2, 2)."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s], [s, c]])
