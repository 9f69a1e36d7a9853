"""Forward kinematics and Jacobians of the chain, on batches; frames as in ``robot.model``."""

import numpy as np
from numpy.typing import NDArray

from snakeslam.geometry import se3, so3
from snakeslam.geometry.compiled import compiled
from snakeslam.messages import Float
from snakeslam.robot.model import SnakeModel

IDENTITY = np.eye(4)


def link_poses(model: SnakeModel, q_rad: Float, T_W_base: Float) -> Float:
    """Return Ts_WL of links 0..N from the tail's pose; q (..., N), T_W_base (..., 4, 4) -> (..., N + 1, 4, 4)."""
    q_rad = np.asarray(q_rad, dtype=np.float64)
    first = np.broadcast_to(np.asarray(T_W_base, dtype=np.float64), (*q_rad.shape[:-1], 4, 4))
    chains, count = q_rad.reshape(-1, model.joint_count), model.link_count
    Ts = _chain(np.cos(chains), np.sin(chains), model.is_yaw, model.joint_length_m, first.reshape(-1, 4, 4))
    return Ts.reshape(*q_rad.shape[:-1], count, 4, 4)


@compiled
def _chain(c: Float, s: Float, is_yaw: NDArray[np.bool_], length_m: float, first: Float) -> Float:
    """Return the poses of all links; a joint is a step of one link along x, then a rotation about z (yaw) or -y."""
    chains, joints = c.shape
    Ts = np.zeros((chains, joints + 1, 4, 4))
    for m in range(chains):
        Ts[m, 0] = first[m]
        for k in range(joints):
            before, after = Ts[m, k], Ts[m, k + 1]
            cos, sin = c[m, k], s[m, k]
            turned = 1 if is_yaw[k] else 2
            kept = 3 - turned
            for row in range(3):
                x, y = before[row, 0], before[row, turned]
                after[row, 0] = cos * x + sin * y
                after[row, turned] = cos * y - sin * x
                after[row, kept] = before[row, kept]
                after[row, 3] = before[row, 3] + length_m * x
            after[3, 3] = 1.0
    return Ts


def link_poses_from_imu(model: SnakeModel, q_rad: Float, T_WI: Float) -> Float:
    """Return Ts_WL of links 0..N from the pose of the head's IMU; shapes as ``link_poses``."""
    Ts_BL = link_poses(model, q_rad, IDENTITY)
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
