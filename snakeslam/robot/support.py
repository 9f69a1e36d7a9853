"""The load of each link of a stationary body: on soft ground and, for a raised head, with compliant joints.

For a stiff chain on hard ground the loads are not determined, so both are needed.
"""

import numpy as np

from snakeslam.messages import Float
from snakeslam.robot.kinematics import link_poses
from snakeslam.robot.model import SnakeModel

GRAVITY_M_S2 = 9.81
SKIN_N_M = 2000.0
"""Stiffness of the skin at one contact sphere."""
JOINT_NM_RAD = 500.0
"""Stiffness of a servo and its gear."""
LEAST_SHARE = 0.02
"""Share of its weight that a link in the air still puts on the ground; with none a body in the air slides freely."""
ROUNDS = 40


def posture_loads(model: SnakeModel) -> Float:
    """Return the load of each link at rest over its weight, (N + 1,): a raised head rests on the links behind it.

    Minimises 1/2 k sum pen^2 + 1/2 kappa sum d^2 + m g sum z over the body's height, its pitch and the deflections d of
    its pitch joints, to first order in them; the loaded contacts are found by Newton's method.
    """
    Ts = link_poses(model, model.rest_q_rad, np.eye(4))
    spheres = Ts[:, None, :3, 3] + np.einsum("nij,sj->nsi", Ts[:, :3, :3], model.sphere_centres_L)
    lift = _rise(model, Ts, spheres)
    centres = Ts[:, :3, 3] + Ts[:, :3, :3] @ model.com_L
    weight_n = model.link_masses_kg * GRAVITY_M_S2
    stiff = np.full(lift.shape[-1], JOINT_NM_RAD)
    stiff[:2] = 0.0
    pull = np.tensordot(weight_n, _rise(model, Ts, centres[:, None])[:, 0], axes=1)
    pen = np.ones(spheres.shape[:2])
    for _ in range(ROUNDS):
        carries = pen > 0.0
        L = lift[carries]
        x = np.linalg.solve(np.diag(stiff) + SKIN_N_M * L.T @ L, -pull - SKIN_N_M * L.T @ spheres[carries][:, 2])
        pen = -(spheres[..., 2] + lift @ x)
        if np.array_equal(pen > 0.0, carries):
            break
    return np.maximum(LEAST_SHARE, SKIN_N_M * np.sum(np.maximum(pen, 0.0), axis=1) / weight_n)


def _rise(model: SnakeModel, Ts_WL: Float, points_W: Float) -> Float:
    """Return how points (N + 1, S, 3) of the links rise with height, pitch and pitch joints, (N + 1, S, 2 + P)."""
    joints = np.flatnonzero(~model.is_yaw)
    arms = points_W[..., 0, None] - Ts_WL[joints + 1, 0, 3]
    ahead = np.arange(model.link_count)[:, None, None] > joints
    return np.concatenate([np.ones((*points_W.shape[:2], 1)), points_W[..., :1], np.where(ahead, arms, 0.0)], axis=-1)
