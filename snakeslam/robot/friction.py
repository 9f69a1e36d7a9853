"""How a body that slides on its belly moves when its joints move: zero net friction gives the head's motion.

The resistive law is linear in the velocities (viscous, stiffer across a link than along it) and gives a map from joint
rates to the head's planar twist.
"""

import numpy as np

from snakeslam.messages import Float
from snakeslam.robot.kinematics import link_poses_from_imu
from snakeslam.robot.model import SnakeModel


def link_motion(model: SnakeModel, Ts_WL: Float) -> tuple[Float, Float]:
    """Return how joint rates move the links' centres while the head's link is held.

    Velocities (N + 1, 3, N) in m/s and angular rates (N + 1, 3, N) in rad/s per rad/s, in W.
    """
    centres_W = Ts_WL[:, :3, 3] + Ts_WL[:, :3, :3] @ model.com_L
    axes_W = np.einsum("nij,nj->ni", Ts_WL[1:, :3, :3], model.axes_L)
    arms_W = centres_W[:, None] - Ts_WL[None, 1:, :3, 3]
    behind = np.arange(model.link_count)[:, None] <= np.arange(model.joint_count)
    turn = np.where(behind[..., None], -axes_W, 0.0)
    (ax, ay, az), (x, y, z) = np.moveaxis(turn, -1, 0), np.moveaxis(arms_W, -1, 0)
    velocity = np.stack([ay * z - az * y, az * x - ax * z, ax * y - ay * x], axis=1)
    return velocity, np.moveaxis(turn, -1, 1)


def resistive_map(model: SnakeModel, q_rad: Float, T_WI: Float, loads: Float, ratio: float) -> Float:
    """Return the map from joint rates to the planar twist (v_x, v_y, w_z) of the IMU in W, (3, N).

    Each link i resists with sqrt(w_i) { sqrt(c_t l) v_t, sqrt(c_n l) v_n, sqrt(c_n l^3 / 12) w } = A x + B dq; zero net
    force and moment is x = -(A^T A)^-1 A^T B dq. ``loads`` (N + 1,) are the weights w, ``ratio`` is c_n / c_t.
    """
    Ts_WL = link_poses_from_imu(model, q_rad, T_WI)
    velocity, turn = link_motion(model, Ts_WL)
    centres_W = Ts_WL[:, :3, 3] + Ts_WL[:, :3, :3] @ model.com_L
    x, y = (centres_W[:, :2] - T_WI[:2, 3]).T
    along = Ts_WL[:, :2, 0] / np.linalg.norm(Ts_WL[:, :2, 0], axis=1)[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    rigid = np.zeros((model.link_count, 2, 3))
    rigid[:, 0, 0] = rigid[:, 1, 1] = 1.0
    rigid[:, 0, 2], rigid[:, 1, 2] = -y, x
    axes = np.stack([along, np.sqrt(ratio) * across], axis=1) * np.sqrt(loads)[:, None, None]
    spin = np.sqrt(loads * ratio / 12.0) * model.joint_length_m
    A = np.concatenate([(axes @ rigid).reshape(-1, 3), np.outer(spin, [0.0, 0.0, 1.0])])
    B = np.concatenate([(axes @ velocity[:, :2]).reshape(-1, model.joint_count), spin[:, None] * turn[:, 2]])
    return np.asarray(-np.linalg.solve(A.T @ A, A.T @ B), dtype=np.float64)
