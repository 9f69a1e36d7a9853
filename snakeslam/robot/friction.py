"""How a sliding body moves when its joints move: the head's motion is the one with zero net friction.

The resistive law is linear in the velocities (viscous, stiffer across a link than along it) and gives a map from joint
rates to the head's planar twist, for control. Coulomb's law needs the loads and an iteration, serves every gait in 3D,
and gives the head's velocity with its covariance, for odometry.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snakeslam.geometry.compiled import compiled
from snakeslam.geometry.so3 import cross_of_two
from snakeslam.messages import Float
from snakeslam.robot.ground import Ground, level
from snakeslam.robot.kinematics import link_poses_from_imu
from snakeslam.robot.model import SnakeModel

PLANAR = (0, 1, 4)
"""Of a twist (v_x, v_y, w_x, w_y, w_z), what is in the plane."""
ROUNDS = 30
ENOUGH_M_S = 1e-5
SLIP_M_S = 0.02
"""Slips below this resist in proportion to their speed."""
FLOOR_M_S = 0.005


def resistive_map(model: SnakeModel, q_rad: Float, T_WI: Float, loads: Float, ratio: float) -> Float:
    """Return the map from joint rates to the planar twist (v_x, v_y, w_z) of the IMU in W, (3, N).

    Each link i resists with sqrt(w_i) { sqrt(c_t l) v_t, sqrt(c_n l) v_n, sqrt(c_n l^3 / 12) w } = A x + B dq; zero net
    force and moment is x = -(A^T A)^-1 A^T B dq. ``loads`` (N + 1,) are the weights w, ``ratio`` is c_n / c_t.

    With the head fixed, joint j moves all links behind it as one body, by the twist s_j, so A^T B_j is the sum of their
    resistances to any twist, times s_j.
    """
    Ts_WL = link_poses_from_imu(model, q_rad, T_WI)
    shape = (model.com_L[0], model.joint_length_m, model.is_yaw)
    behind, forces = _resisted(Ts_WL, T_WI[:3, 3], *shape, loads, ratio)
    return np.asarray(-np.linalg.solve(behind, forces), dtype=np.float64)


@compiled
def _resisted(
    Ts_WL: Float,
    origin_W: Float,
    com_x_m: float,
    length_m: float,
    is_yaw: NDArray[np.bool_],
    loads: Float,
    ratio: float,
) -> tuple[Float, Float]:
    """Return the body's planar resistance to planar twists (3, 3), and to the rotation of each joint (3, N)."""
    joints = len(is_yaw)
    behind, forces = np.zeros((3, 5)), np.empty((3, joints))
    for k in range(joints + 1):
        _add_resistance(behind, Ts_WL[k], origin_W, com_x_m, length_m, loads[k], ratio)
        if k < joints:
            twist = _joint_twist(Ts_WL[k + 1], origin_W, is_yaw[k])
            for row in range(3):
                forces[row, k] = np.sum(behind[row] * twist)
    planar = np.empty((3, 3))
    for column, of_twist in enumerate(PLANAR):
        planar[:, column] = behind[:, of_twist]
    return planar, forces


@compiled
def _add_resistance(
    behind: Float, T_WL: Float, origin_W: Float, com_x_m: float, length_m: float, load: float, ratio: float
) -> None:
    """Add a link's planar force and moment for a twist (v_x, v_y, w_x, w_y, w_z) at the origin to ``behind`` (3, 5)."""
    x, y, z = T_WL[:3, 3] + T_WL[:3, 0] * com_x_m - origin_W
    reach = np.hypot(T_WL[0, 0], T_WL[1, 0])
    t_x, t_y = T_WL[0, 0] / reach, T_WL[1, 0] / reach
    m_xx, m_xy, m_yy = ratio - (ratio - 1.0) * t_x * t_x, (1.0 - ratio) * t_x * t_y, ratio - (ratio - 1.0) * t_y * t_y
    # The velocity of the link's middle by each of the five, and the force against it.
    for column, (v_x, v_y) in enumerate(((1.0, 0.0), (0.0, 1.0), (0.0, -z), (z, 0.0), (-y, x))):
        f_x, f_y = m_xx * v_x + m_xy * v_y, m_xy * v_x + m_yy * v_y
        behind[0, column] += load * f_x
        behind[1, column] += load * f_y
        behind[2, column] += load * (x * f_y - y * f_x)
    behind[2, 4] += load * ratio / 12.0 * length_m**2


@compiled
def _joint_twist(T_WL: Float, origin_W: Float, is_yaw: bool) -> Float:
    """Return the twist (v_x, v_y, w_x, w_y, w_z) at the origin of what is behind a joint, per joint rate, (5,)."""
    w = -T_WL[:3, 2] if is_yaw else T_WL[:3, 1]
    arm = origin_W - T_WL[:3, 3]
    return np.array([w[1] * arm[2] - w[2] * arm[1], w[2] * arm[0] - w[0] * arm[2], w[0], w[1], w[2]])


@dataclass(frozen=True, slots=True)
class Sliding:
    """The head's velocity ``v_I`` (3,) m/s with its covariance (3, 3), and the ground it follows from.

    ``v_D_log_ratio`` (3,) is its derivative by the logarithm of the ratio of friction.
    """

    v_I: Float
    cov: Float
    ground: Ground
    v_D_log_ratio: Float


def sliding_velocity(
    model: SnakeModel,
    q_rad: Float,
    dq_rad_s: Float,
    w_I: Float,
    up_I: Float,
    ratio: float,
    guess_I: Float | None = None,
) -> Sliding:
    """Return the velocity of the IMU that leaves no net Coulomb friction on the body, quasi-statically, for any gait.

    v = argmin sum N_i || v + u_i ||, by iteratively re-weighted least squares: u_i is the velocity of contact i while
    the IMU only rotates at ``w_I`` (3,) rad/s, the metric of || . || weighs what is across the link, and out of the
    ground, by ``ratio``. Angles and rates (N,), ``up_I`` (3,) the upward direction. For isotropic friction this is
    exactly the balance of forces. Covariance: slip scattered over the effective number of contacts, and 5 mm/s.
    """
    Ts_IL = link_poses_from_imu(model, q_rad, np.eye(4))
    ground = level(model, Ts_IL, up_I)
    bears = ground.loads_n > 0.0
    link, points, loads = ground.link[bears], ground.contacts_I[bears], ground.loads_n[bears]
    u_I = contact_velocities(model, Ts_IL, dq_rad_s, w_I, link, points)
    along_I = _along(Ts_IL, link, ground.normal_I)
    metric = _metric(along_I, ratio)
    v_I = np.zeros(3) if guess_I is None else guess_I
    v_I = _balanced(u_I, loads, metric, v_I)
    slip = v_I + u_I
    share = loads / loads.sum()
    scatter = (slip * share[:, None]).T @ slip
    cov = scatter * float(share @ share) + FLOOR_M_S**2 * np.eye(3)
    return Sliding(v_I, cov, ground, _by_log_ratio(slip, loads, metric, along_I, ratio))


@compiled
def _balanced(u_I: Float, loads: Float, metric: Float, v_I: Float) -> Float:
    """Return the velocity (3,) at which the friction of all contacts is in balance, from the guess ``v_I``."""
    for _ in range(ROUNDS):
        held, pull = np.zeros((3, 3)), np.zeros(3)
        for c in range(len(loads)):
            slip = v_I + u_I[c]
            weight = loads[c] / np.sqrt(np.sum(slip * slip) + SLIP_M_S**2)
            for i in range(3):
                for j in range(3):
                    held[i, j] += weight * metric[c, i, j]
                    pull[i] -= weight * metric[c, i, j] * u_I[c, j]
        after = np.linalg.solve(held, pull).astype(np.float64)
        moved, v_I = np.max(np.abs(after - v_I)), after
        if moved < ENOUGH_M_S:
            break
    return v_I


def contact_velocities(
    model: SnakeModel, Ts_IL: Float, dq_rad_s: Float, w_I: Float, link: NDArray[np.int64], points_I: Float
) -> Float:
    """Return the velocities of points of links while the IMU rotates at ``w_I`` without moving, (M, 3) m/s in I."""
    return _contact_velocities(model.axes_L, Ts_IL, dq_rad_s, w_I, link, points_I)


@compiled
def _contact_velocities(
    axes_L: Float, Ts_IL: Float, dq_rad_s: Float, w_I: Float, link: NDArray[np.int64], points_I: Float
) -> Float:
    """From the head backwards: each link's angular rate relative to the head, its frame's velocity, the points'."""
    joints = len(dq_rad_s)
    turn, shift = np.zeros((joints + 1, 3)), np.zeros((joints + 1, 3))
    for k in range(joints - 1, -1, -1):
        T, axis = Ts_IL[k + 1], axes_L[k]
        spin = np.empty(3)
        for i in range(3):
            spin[i] = -(T[i, 0] * axis[0] + T[i, 1] * axis[1] + T[i, 2] * axis[2]) * dq_rad_s[k]
        turn[k] = turn[k + 1] + spin
        shift[k] = shift[k + 1] + cross_of_two(T[:3, 3], spin)
    out = np.empty((len(link), 3))
    for c in range(len(link)):
        out[c] = shift[link[c]] + cross_of_two(turn[link[c]] + w_I, points_I[c])
    return out


@compiled
def _along(Ts_IL: Float, link: NDArray[np.int64], normal_I: Float) -> Float:
    """Return the directions of links on the ground, (M, 3)."""
    out = np.empty((len(link), 3))
    for c in range(len(link)):
        axis = Ts_IL[link[c], :3, 0].copy()
        t = axis - np.sum(axis * normal_I) * normal_I
        out[c] = t / max(np.sqrt(np.sum(t * t)), 1e-9)
    return out


@compiled
def _metric(t: Float, ratio: float) -> Float:
    """Return what friction weighs a slip with, (M, 3, 3): 1 along the link on the ground ``t``, ``ratio`` across."""
    out = np.empty((len(t), 3, 3))
    for c in range(len(t)):
        for i in range(3):
            for j in range(3):
                out[c, i, j] = (ratio if i == j else 0.0) - (ratio - 1.0) * t[c, i] * t[c, j]
    return out


@compiled
def _by_log_ratio(slip: Float, loads: Float, metric: Float, along_I: Float, ratio: float) -> Float:
    """Return dv/d(log ratio) (3,) where the friction F(v, ratio) = sum N M s / n, n = sqrt(s^2 + eps^2), stays zero.

    dv = -(dF/dv)^-1 (dF/dratio) ratio, with dF/dv = sum N M (I - s s^T / n^2) / n and dM/dratio = I - t t^T.
    """
    F_v, across = np.zeros((3, 3)), np.zeros(3)
    for c in range(len(loads)):
        s, t = slip[c], along_I[c]
        n2 = np.sum(s * s) + SLIP_M_S**2
        weight = loads[c] / np.sqrt(n2)
        across += weight * (s - t * np.sum(t * s))
        for i in range(3):
            M_s = metric[c, i, 0] * s[0] + metric[c, i, 1] * s[1] + metric[c, i, 2] * s[2]
            for k in range(3):
                F_v[i, k] += weight * (metric[c, i, k] - M_s * s[k] / n2)
    return -ratio * np.linalg.solve(F_v, across).astype(np.float64)
