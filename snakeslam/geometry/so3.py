"""Rotations SO(3) on numpy batches, with the right perturbation R [+] d = R Exp(d).

Shapes are ``(..., 3)`` for tangent vectors (rad), ``(..., 3, 3)`` for matrices and ``(..., 4)`` for quaternions in
(w, x, y, z) order. Formulas: [Sola18] "A micro Lie theory for state estimation in robotics".
"""

import numpy as np
from numpy.typing import NDArray

from snakeslam.geometry.compiled import compiled

Array = NDArray[np.float64]

SMALL_ANGLE_RAD = 1e-4
"""Below this angle the formulas are replaced by their Taylor series; the first term left out is below 1e-16."""


def hat(w: Array) -> Array:
    """Return the skew matrix [w]x with [w]x v = w x v, (..., 3) -> (..., 3, 3)."""
    w = np.asarray(w, dtype=np.float64)
    out = np.zeros((*w.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -w[..., 2], w[..., 1]
    out[..., 1, 0], out[..., 1, 2] = w[..., 2], -w[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -w[..., 1], w[..., 0]
    return out


def cross(a: Array, b: Array) -> Array:
    """Return a x b, (..., 3); numpy's own takes ten times as long on a few rows."""
    if a.shape != b.shape:
        a, b = np.broadcast_arrays(a, b)
    return _crosses(_rows(a, 1), _rows(b, 1)).reshape(a.shape)


@compiled
def _crosses(a: Array, b: Array) -> Array:
    out = np.empty((len(a), 3))
    for n in range(len(a)):
        out[n] = cross_of_two(a[n], b[n])
    return out


@compiled
def cross_of_two(a: Array, b: Array) -> Array:
    """Return a x b of two vectors (3,), for use in other compiled loops."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def vee(W: Array) -> Array:
    """Return the vector of a skew matrix, (..., 3, 3) -> (..., 3)."""
    return np.stack([W[..., 2, 1], W[..., 0, 2], W[..., 1, 0]], axis=-1)


def exp(w: Array) -> Array:
    """Return Exp(w) = I + sin(t)/t [w]x + (1 - cos t)/t^2 [w]x^2 with t = |w|, (..., 3) -> (..., 3, 3)."""
    w = np.asarray(w, dtype=np.float64)
    return _exps(_rows(w, 1)).reshape(*w.shape, 3)


@compiled
def _exps(w: Array) -> Array:
    R = np.empty((len(w), 3, 3))
    for n in range(len(w)):
        x, y, z = w[n]
        t = np.sqrt(x * x + y * y + z * z)
        if t < SMALL_ANGLE_RAD:
            first, second = 1.0 - t * t / 6.0, 0.5 - t * t / 24.0
        else:
            first, second = np.sin(t) / t, 2.0 * (np.sin(t / 2.0) / t) ** 2
        R[n, 0, 0] = 1.0 - second * (y * y + z * z)
        R[n, 1, 1] = 1.0 - second * (x * x + z * z)
        R[n, 2, 2] = 1.0 - second * (x * x + y * y)
        R[n, 0, 1], R[n, 1, 0] = second * x * y - first * z, second * x * y + first * z
        R[n, 0, 2], R[n, 2, 0] = second * x * z + first * y, second * x * z - first * y
        R[n, 1, 2], R[n, 2, 1] = second * y * z - first * x, second * y * z + first * x
    return R


def log(R: Array) -> Array:
    """Return Log(R) with |Log(R)| in [0, pi], (..., 3, 3) -> (..., 3)."""
    R = np.asarray(R, dtype=np.float64)
    return _logs(_rows(R, 2)).reshape(R.shape[:-1])


@compiled
def _logs(R: Array) -> Array:
    w_out = np.empty((len(R), 3))
    for n, q in enumerate(_quats(R)):
        sign = -1.0 if q[0] < 0.0 else 1.0
        w, sine = sign * q[0], np.sqrt(q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
        if sine < SMALL_ANGLE_RAD:
            scale = 2.0 / w * (1.0 - sine**2 / (3.0 * w**2))
        else:
            scale = 2.0 * np.arctan2(sine, w) / sine
        w_out[n] = sign * scale * q[1:]
    return w_out


def right_jacobian(w: Array) -> Array:
    """Return Jr(w) with Exp(w + d) = Exp(w) Exp(Jr(w) d) to first order, (..., 3) -> (..., 3, 3)."""
    w = np.asarray(w, dtype=np.float64)
    return _jacobians(_rows(w, 1)).reshape(*w.shape, 3)


@compiled
def _jacobians(w: Array) -> Array:
    """Jr = I - (1 - cos t)/t^2 [w]x + (t - sin t)/t^3 [w]x^2, by series near zero."""
    out = np.empty((len(w), 3, 3))
    for n in range(len(w)):
        t2 = np.sum(w[n] * w[n])
        t = np.sqrt(t2)
        if t < SMALL_ANGLE_RAD:
            second, third = 0.5 - t2 / 24.0, 1.0 / 6.0 - t2 / 120.0
        else:
            second, third = 2.0 * (np.sin(t / 2.0) / t) ** 2, (t - np.sin(t)) / t**3
        _polynomial(w[n], -second, third, out[n])
    return out


def right_jacobian_inv(w: Array) -> Array:
    """Return Jr(w)^-1 with Log(Exp(w) Exp(d)) = w + Jr(w)^-1 d to first order, (..., 3) -> (..., 3, 3)."""
    w = np.asarray(w, dtype=np.float64)
    return _inverse_jacobians(_rows(w, 1)).reshape(*w.shape, 3)


@compiled
def _inverse_jacobians(w: Array) -> Array:
    """Jr^-1 = I + [w]x / 2 + (1 - t cos(t/2) / (2 sin(t/2))) / t^2 [w]x^2, by series near zero."""
    out = np.empty((len(w), 3, 3))
    for n in range(len(w)):
        t2 = np.sum(w[n] * w[n])
        t = np.sqrt(t2)
        if t < SMALL_ANGLE_RAD:
            factor = 1.0 / 12.0 + t2 / 720.0
        else:
            factor = (1.0 - 0.5 * t * np.cos(t / 2.0) / np.sin(t / 2.0)) / t2
        _polynomial(w[n], 0.5, factor, out[n])
    return out


@compiled
def _polynomial(w: Array, first: float, second: float, out: Array) -> None:
    """Write I + first [w]x + second [w]x^2, with [w]x^2 = w w^T - |w|^2 I."""
    x, y, z = w
    rest = 1.0 - second * (x * x + y * y + z * z)
    for i in range(3):
        for j in range(3):
            out[i, j] = second * w[i] * w[j] + (rest if i == j else 0.0)
    out[0, 1] -= first * z
    out[0, 2] += first * y
    out[1, 0] += first * z
    out[1, 2] -= first * x
    out[2, 0] -= first * y
    out[2, 1] += first * x


def quat_wxyz_from_matrix(R: Array) -> Array:
    """Return the unit quaternion of R, (..., 3, 3) -> (..., 4); the largest component is positive [Shepperd78]."""
    R = np.asarray(R, dtype=np.float64)
    return _quats(_rows(R, 2)).reshape(*R.shape[:-2], 4)


@compiled
def _quats(R: Array) -> Array:
    quats = np.empty((len(R), 4))
    for n in range(len(R)):
        m = R[n]
        trace = m[0, 0] + m[1, 1] + m[2, 2]
        squares = np.array([1.0 + trace, *(1.0 - trace + 2.0 * np.diag(m))])
        q = quats[n]
        best = np.argmax(squares)
        if best == 0:
            q[0], q[1], q[2], q[3] = squares[0], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
        else:
            i = best - 1
            j, k = (i + 1) % 3, (i + 2) % 3
            q[0], q[best] = m[k, j] - m[j, k], squares[best]
            q[1 + j], q[1 + k] = m[i, j] + m[j, i], m[i, k] + m[k, i]
        q /= np.sqrt(np.sum(q * q))
    return quats


def matrix_from_quat_wxyz(q_wxyz: Array) -> Array:
    """Return the matrix of a (not necessarily unit) quaternion, (..., 4) -> (..., 3, 3)."""
    q = np.asarray(q_wxyz, dtype=np.float64)
    return _matrices(_rows(q, 1)).reshape(*q.shape[:-1], 3, 3)


@compiled
def _matrices(quats: Array) -> Array:
    R = np.empty((len(quats), 3, 3))
    for n in range(len(quats)):
        w, x, y, z = quats[n] / np.sqrt(np.sum(quats[n] * quats[n]))
        R[n, 0, 0], R[n, 0, 1], R[n, 0, 2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
        R[n, 1, 0], R[n, 1, 1], R[n, 1, 2] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
        R[n, 2, 0], R[n, 2, 1], R[n, 2, 2] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    return R


def _rows(values: Array, axes: int) -> Array:
    """Return a batch of any shape as one sequence of vectors (``axes`` 1) or matrices (``axes`` 2)."""
    return np.ascontiguousarray(values).reshape(-1, *values.shape[values.ndim - axes :])


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
