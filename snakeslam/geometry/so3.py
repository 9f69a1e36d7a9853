"""Rotations SO(3) on numpy batches, with the right perturbation R [+] d = R Exp(d).

Shapes are ``(..., 3)`` for tangent vectors (rad), ``(..., 3, 3)`` for matrices and ``(..., 4)`` for quaternions in
(w, x, y, z) order. Formulas: [Sola18] "A micro Lie theory for state estimation in robotics".
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SMALL_ANGLE_RAD = 1e-4


def hat(w: Array) -> Array:
    """Return the skew matrix [w]x with [w]x v = w x v, (..., 3) -> (..., 3, 3)."""
    w = np.asarray(w, dtype=np.float64)
    out = np.zeros((*w.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -w[..., 2], w[..., 1]
    out[..., 1, 0], out[..., 1, 2] = w[..., 2], -w[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -w[..., 1], w[..., 0]
    return out


def cross(a: Array, b: Array) -> Array:
    """Return a x b, (..., 3); numpy's own takes ten times as long on few rows."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def vee(W: Array) -> Array:
    """Return the vector of a skew matrix, (..., 3, 3) -> (..., 3)."""
    return np.stack([W[..., 2, 1], W[..., 0, 2], W[..., 1, 0]], axis=-1)


def _rodrigues_factors(angle: Array) -> tuple[Array, Array, Array]:
    """Return sin(t)/t, (1 - cos t)/t^2 and (t - sin t)/t^3, by series near zero."""
    small = angle < SMALL_ANGLE_RAD
    t = np.where(small, 1.0, angle)
    a2 = angle * angle
    first = np.where(small, 1.0 - a2 / 6.0, np.sin(t) / t)
    second = np.where(small, 0.5 - a2 / 24.0, 2.0 * (np.sin(t / 2.0) / t) ** 2)
    third = np.where(small, 1.0 / 6.0 - a2 / 120.0, (t - np.sin(t)) / t**3)
    return first, second, third


def exp(w: Array) -> Array:
    """Return Exp(w) = I + sin(t)/t [w]x + (1 - cos t)/t^2 [w]x^2 with t = |w|, (..., 3) -> (..., 3, 3)."""
    w = np.asarray(w, dtype=np.float64)
    first, second, _ = _rodrigues_factors(np.linalg.norm(w, axis=-1))
    W = hat(w)
    return np.eye(3) + first[..., None, None] * W + second[..., None, None] * (W @ W)


def log(R: Array) -> Array:
    """Return Log(R) with |Log(R)| in [0, pi], (..., 3, 3) -> (..., 3)."""
    q = quat_wxyz_from_matrix(R)
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1)
    small = sine < SMALL_ANGLE_RAD
    angle = 2.0 * np.arctan2(sine, q[..., 0])
    w = np.where(small, q[..., 0], 1.0)
    series = 2.0 / w * (1.0 - sine**2 / (3.0 * w**2))
    scale = np.where(small, series, angle / np.where(small, 1.0, sine))
    return scale[..., None] * q[..., 1:]


def right_jacobian(w: Array) -> Array:
    """Return Jr(w) with Exp(w + d) = Exp(w) Exp(Jr(w) d) to first order, (..., 3) -> (..., 3, 3)."""
    w = np.asarray(w, dtype=np.float64)
    _, second, third = _rodrigues_factors(np.linalg.norm(w, axis=-1))
    W = hat(w)
    return np.eye(3) - second[..., None, None] * W + third[..., None, None] * (W @ W)


def right_jacobian_inv(w: Array) -> Array:
    """Return Jr(w)^-1 with Log(Exp(w) Exp(d)) = w + Jr(w)^-1 d to first order, (..., 3) -> (..., 3, 3)."""
    w = np.asarray(w, dtype=np.float64)
    angle = np.linalg.norm(w, axis=-1)
    small = angle < SMALL_ANGLE_RAD
    t = np.where(small, 1.0, angle)
    exact = (1.0 - 0.5 * t * np.cos(t / 2.0) / np.where(small, 1.0, np.sin(t / 2.0))) / t**2
    factor = np.where(small, 1.0 / 12.0 + angle**2 / 720.0, exact)
    W = hat(w)
    return np.eye(3) + 0.5 * W + factor[..., None, None] * (W @ W)


def quat_wxyz_from_matrix(R: Array) -> Array:
    """Return the unit quaternion of R, (..., 3, 3) -> (..., 4); the largest component is positive [Shepperd78]."""
    R = np.asarray(R, dtype=np.float64)
    r00, r11, r22 = R[..., 0, 0], R[..., 1, 1], R[..., 2, 2]
    squares = np.stack([1 + r00 + r11 + r22, 1 + r00 - r11 - r22, 1 - r00 + r11 - r22, 1 - r00 - r11 + r22], axis=-1)
    wx, wy, wz = R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]
    xy, xz, yz = R[..., 0, 1] + R[..., 1, 0], R[..., 0, 2] + R[..., 2, 0], R[..., 1, 2] + R[..., 2, 1]
    rows = np.stack(
        [
            np.stack([squares[..., 0], wx, wy, wz], axis=-1),
            np.stack([wx, squares[..., 1], xy, xz], axis=-1),
            np.stack([wy, xy, squares[..., 2], yz], axis=-1),
            np.stack([wz, xz, yz, squares[..., 3]], axis=-1),
        ],
        axis=-2,
    )
    best = np.argmax(squares, axis=-1)
    q = np.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :]
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def matrix_from_quat_wxyz(q_wxyz: Array) -> Array:
    """Return the matrix of a (not necessarily unit) quaternion, (..., 4) -> (..., 3, 3)."""
    q = np.asarray(q_wxyz, dtype=np.float64)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    V = hat(q[..., 1:])
    return np.eye(3) + 2.0 * q[..., :1, None] * V + 2.0 * (V @ V)


def from_yaw(yaw_rad: Array | float) -> Array:
    """Return the rotation about z by ``yaw_rad``, (...) -> (..., 3, 3)."""
    yaw = np.asarray(yaw_rad, dtype=np.float64)
    out = np.zeros((*yaw.shape, 3, 3))
    out[..., 0, 0] = out[..., 1, 1] = np.cos(yaw)
    out[..., 1, 0] = np.sin(yaw)
    out[..., 0, 1] = -out[..., 1, 0]
    out[..., 2, 2] = 1.0
    return out


def yaw(R: Array) -> Array:
    """Return the yaw of R in the Z-Y-X sense (rad), (..., 3, 3) -> (...)."""
    return np.arctan2(R[..., 1, 0], R[..., 0, 0])
