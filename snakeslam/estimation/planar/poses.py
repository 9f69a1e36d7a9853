"""Poses of the head in the plane: (x, y, yaw) out of and into a pose in space, and their covariances."""

import numpy as np

from snakeslam.estimation.planar.state import wrapped
from snakeslam.geometry import se3, so3
from snakeslam.messages import Float

XY_YAW = [3, 4, 2]
"""Indices of x, y and yaw in a covariance of (theta_W, p_W, v_W)."""
START_SIGMA = np.array([1e-4, 1e-4, 1e-4, 0.1, 0.3])
"""Sigmas of the first state: its pose defines W (0.1 mm, 0.1 mrad), speed (m/s) and yaw rate (rad/s) are unknown."""


def plane_pose(T_WI: Float) -> Float:
    """Return (x, y, yaw) of a pose."""
    return np.array([*T_WI[:2, 3], float(so3.yaw(T_WI[:3, :3]))])


def with_plane_pose(T_WI: Float, head: Float) -> Float:
    """Return the pose with ``head`` (3,) for its (x, y, yaw); z, roll and pitch stay."""
    dyaw = float(wrapped(head - plane_pose(T_WI))[2])
    return se3.from_rt(so3.from_yaw(dyaw) @ T_WI[:3, :3], np.array([*head[:2], T_WI[2, 3]]))


def rotate_theta(cov: Float, R: Float) -> Float:
    """Return a covariance of (theta, p, v) with theta <- R theta: from I to W with R_WI, back with its transpose."""
    A = np.eye(9)
    A[:3, :3] = R
    return A @ cov @ A.T
