"""Forward kinematics and Jacobians of the chain, on numpy batches; frames as in ``robot.model``."""

import numpy as np

from snakeslam.geometry import se3, so3
from snakeslam.messages import Float
from snakeslam.robot.model import SnakeModel


def joint_transforms(model: SnakeModel, q_rad: Float) -> Float:
    """Return T_(k-1)k of joints 1..N: the step of one link, then the joint's turn; q (..., N) -> (..., N, 4, 4)."""
    q_rad = np.asarray(q_rad, dtype=np.float64)
    c, s = np.cos(q_rad), np.sin(q_rad)
    yaw = model.is_yaw
    T = np.zeros((*q_rad.shape, 4, 4))
    T[..., 0, 0], T[..., 3, 3] = c, 1.0
    T[..., 1, 1], T[..., 2, 2] = np.where(yaw, c, 1.0), np.where(yaw, 1.0, c)
    T[..., 1, 0], T[..., 0, 1] = np.where(yaw, s, 0.0), np.where(yaw, -s, 0.0)
    T[..., 2, 0], T[..., 0, 2] = np.where(yaw, 0.0, s), np.where(yaw, 0.0, -s)
    T[..., 0, 3] = model.joint_length_m
    return T


def link_poses(model: SnakeModel, q_rad: Float, T_W_base: Float) -> Float:
    """Return Ts_WL of links 0..N from the tail's pose; q (..., N), T_W_base (..., 4, 4) -> (..., N + 1, 4, 4)."""
    steps = joint_transforms(model, q_rad)
    first = np.broadcast_to(np.asarray(T_W_base, dtype=np.float64), (*steps.shape[:-3], 4, 4))
    Ts = np.concatenate([first[..., None, :, :], steps], axis=-3)
    reach = 1
    while reach < model.link_count:
        Ts[..., reach:, :, :] = Ts[..., :-reach, :, :] @ Ts[..., reach:, :, :]
        reach *= 2
    return Ts


def link_poses_from_imu(model: SnakeModel, q_rad: Float, T_WI: Float) -> Float:
    """Return Ts_WL of links 0..N from the pose of the head's IMU; shapes as ``link_poses``."""
    Ts_BL = link_poses(model, q_rad, np.eye(4))
    T_W_base = np.asarray(T_WI) @ se3.inv(Ts_BL[..., -1, :, :] @ model.T_HI)
    return T_W_base[..., None, :, :] @ Ts_BL


def link_jacobian(model: SnakeModel, Ts_WL: Float, link: int, p_L: Float) -> Float:
    """Return the Jacobian of a point's velocity and its link's angular rate, (6, 6 + N).

    Rows: v_W (m/s) of the point ``p_L`` (3,) fixed in link ``link``, then w_W (rad/s). Columns: velocity of the base
    (tail) origin in W, angular rate of the base in W, joint rates. ``Ts_WL`` (N + 1, 4, 4) as from ``link_poses``.
    """
    p_W = se3.act(Ts_WL[link], np.asarray(p_L, dtype=np.float64))
    axes_W = np.einsum("nij,nj->ni", Ts_WL[1:, :3, :3], model.axes_L)[:link]
    J = np.zeros((6, 6 + model.joint_count))
    J[:3, :3] = J[3:, 3:6] = np.eye(3)
    J[:3, 3:6] = -so3.hat(p_W - Ts_WL[0, :3, 3])
    J[:3, 6 : 6 + link] = np.cross(axes_W, p_W - Ts_WL[1 : link + 1, :3, 3]).T
    J[3:, 6 : 6 + link] = axes_W.T
    return J


def imu_jacobian(model: SnakeModel, Ts_WL: Float) -> Float:
    """Return ``link_jacobian`` of the head's IMU origin, (6, 6 + N)."""
    return link_jacobian(model, Ts_WL, model.joint_count, model.T_HI[:3, 3])
