"""Rigid motions SE(3) as 4x4 matrices on numpy batches; the tangent is (rho, theta), translation first.

X [+] d = X Exp(d). Formulas: [Sola18].
"""

import numpy as np

from snakeslam.geometry import so3
from snakeslam.geometry.so3 import Array


def from_rt(R: Array, t: Array) -> Array:
    """Return the transform with rotation ``R`` (..., 3, 3) and translation ``t`` (..., 3) in m."""
    R, t = np.asarray(R, dtype=np.float64), np.asarray(t, dtype=np.float64)
    shape = np.broadcast_shapes(R.shape[:-2], t.shape[:-1])
    T = np.zeros((*shape, 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, t, 1.0
    return T


def inv(T: Array) -> Array:
    """Return T^-1, (..., 4, 4)."""
    R_inv = np.swapaxes(T[..., :3, :3], -1, -2)
    return from_rt(R_inv, -(R_inv @ T[..., :3, 3:])[..., 0])


def act(T: Array, p: Array) -> Array:
    """Return T applied to points, T (..., 4, 4), p (..., 3) in m."""
    return (T[..., :3, :3] @ np.asarray(p)[..., None])[..., 0] + T[..., :3, 3]


def exp(xi: Array) -> Array:
    """Return Exp((rho, theta)), (..., 6) -> (..., 4, 4)."""
    xi = np.asarray(xi, dtype=np.float64)
    rho, theta = xi[..., :3], xi[..., 3:]
    left_jacobian = so3.right_jacobian(-theta)
    return from_rt(so3.exp(theta), (left_jacobian @ rho[..., None])[..., 0])


def log(T: Array) -> Array:
    """Return (rho, theta) with Exp of it equal to T, (..., 4, 4) -> (..., 6)."""
    theta = so3.log(T[..., :3, :3])
    rho = (so3.right_jacobian_inv(-theta) @ T[..., :3, 3:])[..., 0]
    return np.concatenate([rho, theta], axis=-1)


def adjoint(T: Array) -> Array:
    """Return Ad_T with T Exp(d) T^-1 = Exp(Ad_T d), (..., 4, 4) -> (..., 6, 6)."""
    R, t = T[..., :3, :3], T[..., :3, 3]
    out = np.zeros((*T.shape[:-2], 6, 6))
    out[..., :3, :3] = out[..., 3:, 3:] = R
    out[..., :3, 3:] = so3.hat(t) @ R
    return out
