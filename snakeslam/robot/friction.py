"""How a body that slides on its belly moves when its joints move: zero net friction gives the head's motion.

The resistive law is linear in the velocities (viscous, stiffer across a link than along it) and gives a map from joint
rates to the head's planar twist, for control. Coulomb's law needs the loads and an iteration, serves every gait in 3D,
and gives the head's velocity with its covariance, for odometry.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snakeslam.geometry import so3
from snakeslam.messages import Float
from snakeslam.robot.ground import Ground, level
from snakeslam.robot.kinematics import link_poses_from_imu
from snakeslam.robot.model import SnakeModel

PLANAR = [0, 1, 4]
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

    While the head is held, joint j turns all links behind it as one, by the twist s_j, so A^T B_j is the sum of their
    resistances to any twist, times s_j.
    """
    Ts_WL = link_poses_from_imu(model, q_rad, T_WI)
    resists = _resistances(model, Ts_WL, T_WI[:3, 3], loads, ratio)
    behind = np.cumsum(resists, axis=0)
    forces = np.einsum("nab,nb->an", behind[:-1], _turns(model, Ts_WL, T_WI[:3, 3]))
    return np.asarray(-np.linalg.solve(behind[-1][:, PLANAR], forces), dtype=np.float64)


def _resistances(model: SnakeModel, Ts_WL: Float, origin_W: Float, loads: Float, ratio: float) -> Float:
    """Return each link's planar force for a twist (v_x, v_y, w_x, w_y, w_z) at the origin, (N + 1, 3, 5)."""
    x, y, z = (Ts_WL[:, :3, 3] + Ts_WL[:, :3, :3] @ model.com_L - origin_W).T
    along = Ts_WL[:, :2, 0] / np.hypot(Ts_WL[:, 0, 0], Ts_WL[:, 1, 0])[:, None]
    rigid = np.zeros((model.link_count, 2, 5))
    rigid[:, 0, 0] = rigid[:, 1, 1] = 1.0
    rigid[:, 0, 3], rigid[:, 0, 4], rigid[:, 1, 2], rigid[:, 1, 4] = z, -y, -z, x
    metric = ratio * np.eye(2) - (ratio - 1.0) * along[:, :, None] * along[:, None, :]
    resists = np.swapaxes(rigid[:, :, PLANAR], 1, 2) @ (metric @ rigid)
    resists[:, 2, 4] += ratio / 12.0 * model.joint_length_m**2
    return resists * loads[:, None, None]


def _turns(model: SnakeModel, Ts_WL: Float, origin_W: Float) -> Float:
    """Return the twist (v_x, v_y, w_x, w_y, w_z) at the origin of what is behind each joint, per joint rate, (N, 5)."""
    w = -np.einsum("nij,nj->ni", Ts_WL[1:, :3, :3], model.axes_L)
    arm = origin_W - Ts_WL[1:, :3, 3]
    v_x, v_y = w[:, 1] * arm[:, 2] - w[:, 2] * arm[:, 1], w[:, 2] * arm[:, 0] - w[:, 0] * arm[:, 2]
    return np.column_stack([v_x, v_y, w])


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
    the IMU only turns at ``w_I`` (3,) rad/s, the metric of || . || weighs what is across the link, and out of the
    ground, by ``ratio``. Angles and rates (N,), ``up_I`` (3,) the upward direction. For isotropic friction this is
    exactly the balance of forces. Covariance: slip scattered over the effective number of contacts, and 5 mm/s.
    """
    Ts_IL = link_poses_from_imu(model, q_rad, np.eye(4))
    ground = level(model, Ts_IL, up_I)
    bears = ground.loads_n > 0.0
    link, points, loads = ground.link[bears], ground.contacts_I[bears], ground.loads_n[bears]
    u_I = contact_velocities(model, Ts_IL, dq_rad_s, w_I, link, points)
    metric = _metric(Ts_IL[link, :3, 0], ground.normal_I, ratio)
    v_I = np.zeros(3) if guess_I is None else guess_I
    # What the weights are summed with in every round, as rows.
    metric_rows, pull_rows = metric.reshape(-1, 9), np.einsum("cij,cj->ci", metric, u_I)
    for _ in range(ROUNDS):
        slip = v_I + u_I
        weights = loads / np.sqrt((slip * slip).sum(axis=1) + SLIP_M_S**2)
        after = np.linalg.solve((weights @ metric_rows).reshape(3, 3), -(weights @ pull_rows))
        moved, v_I = float(np.abs(after - v_I).max()), after
        if moved < ENOUGH_M_S:
            break
    slip = v_I + u_I
    share = loads / loads.sum()
    scatter = (slip * share[:, None]).T @ slip
    cov = scatter * float(share @ share) + FLOOR_M_S**2 * np.eye(3)
    along_I = _along(Ts_IL[link, :3, 0], ground.normal_I)
    return Sliding(v_I, cov, ground, _by_log_ratio(slip, loads, metric, along_I, ratio))


def contact_velocities(
    model: SnakeModel, Ts_IL: Float, dq_rad_s: Float, w_I: Float, link: NDArray[np.int64], points_I: Float
) -> Float:
    """Return the velocities of points of links while the IMU turns in place at ``w_I``, (M, 3) m/s in I."""
    axes_I = np.einsum("nij,nj->ni", Ts_IL[1:, :3, :3], model.axes_L)
    # From the head backwards: the turn of link k against the head, and the velocity of its frame.
    spin = -axes_I * dq_rad_s[:, None]
    w_links = np.concatenate([np.cumsum(spin[::-1], axis=0)[::-1], np.zeros((1, 3))])
    moment = -so3.cross(spin, Ts_IL[1:, :3, 3])
    shift = np.concatenate([np.cumsum(moment[::-1], axis=0)[::-1], np.zeros((1, 3))])
    return shift[link] + so3.cross(w_links[link] + w_I, points_I)


def _metric(axes_I: Float, normal_I: Float, ratio: float) -> Float:
    """Return what friction weighs a slip with, (M, 3, 3): 1 along the link on the ground, ``ratio`` across."""
    t = _along(axes_I, normal_I)
    return ratio * np.eye(3) - (ratio - 1.0) * t[:, :, None] * t[:, None, :]


def _along(axes_I: Float, normal_I: Float) -> Float:
    """Return the directions of links on the ground, (M, 3)."""
    t = axes_I - (axes_I @ normal_I)[:, None] * normal_I
    return t / np.maximum(np.linalg.norm(t, axis=1), 1e-9)[:, None]


def _by_log_ratio(slip: Float, loads: Float, metric: Float, along_I: Float, ratio: float) -> Float:
    """Return dv/d(log ratio) (3,) where the friction F(v, ratio) = sum N M s / n, n = sqrt(s^2 + eps^2), stays zero.

    dv = -(dF/dv)^-1 (dF/dratio) ratio, with dF/dv = sum N M (I - s s^T / n^2) / n and dM/dratio = I - t t^T.
    """
    n = np.sqrt(np.einsum("ci,ci->c", slip, slip) + SLIP_M_S**2)
    weights = loads / n
    bent = np.eye(3) - slip[:, :, None] * slip[:, None, :] / (n**2)[:, None, None]
    F_v = np.einsum("c,cij,cjk->ik", weights, metric, bent)
    across = slip - along_I * np.einsum("ci,ci->c", along_I, slip)[:, None]
    return -ratio * np.linalg.solve(F_v, weights @ across)
