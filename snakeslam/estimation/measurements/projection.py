"""Compiled loops over M points in n cameras: projection, residuals and Jacobians of the camera measurements.

Windows are so small that numpy's overhead would dominate. Arrays are contiguous: for strided arrays every kernel would
be compiled a second time.
"""

import numpy as np

from snakeslam.geometry.compiled import compiled
from snakeslam.messages import Float

MIN_Z_M = 0.02
"""Depths below this are replaced by it in a division: points near or behind the camera get large, finite residuals."""


@compiled
def cameras_from_imu(R_WI: Float, p_WI: Float, R_IC: Float, p_IC: Float) -> tuple[Float, Float]:
    """Return R_CW = R_CI R_IW (n, 3, 3) and R_CW p_WC (n, 3), p_WC = p_WI + R_WI p_IC, for n poses of the IMU."""
    R_CW, origin_C = np.empty((len(R_WI), 3, 3)), np.empty((len(R_WI), 3))
    for k in range(len(R_WI)):
        for i in range(3):
            for j in range(3):
                R_CW[k, i, j] = R_IC[0, i] * R_WI[k, j, 0] + R_IC[1, i] * R_WI[k, j, 1] + R_IC[2, i] * R_WI[k, j, 2]
            to_imu = R_CW[k, i, 0] * p_WI[k, 0] + R_CW[k, i, 1] * p_WI[k, 1] + R_CW[k, i, 2] * p_WI[k, 2]
            origin_C[k, i] = to_imu + (p_IC[0] * R_IC[0, i] + p_IC[1] * R_IC[1, i] + p_IC[2] * R_IC[2, i])
    return R_CW, origin_C


@compiled
def points_in_cameras(points_W: Float, R_CW: Float, origin_C: Float) -> Float:
    """Return p_C = R_CW p_W - R_CW p_WC of points (M, 3) in every camera, (M, n, 3)."""
    out = np.empty((len(points_W), len(R_CW), 3))
    for m in range(len(points_W)):
        x, y, z = points_W[m]
        for k in range(len(R_CW)):
            R = R_CW[k]
            for i in range(3):
                out[m, k, i] = R[i, 0] * x + R[i, 1] * y + R[i, 2] * z - origin_C[k, i]
    return out


@compiled
def weighted_residuals(p_C: Float, xyz: Float, weight: Float) -> Float:
    """Return the residuals z - h(p_C) times the weights, h = (X/Z, Y/Z, Z) of ``p_C``; all arrays are (M, n, 3)."""
    out = np.empty(p_C.shape)
    for m in range(p_C.shape[0]):
        for k in range(p_C.shape[1]):
            x, y, z = p_C[m, k]
            ahead = max(z, MIN_Z_M)
            out[m, k, 0] = (xyz[m, k, 0] - x / ahead) * weight[m, k, 0]
            out[m, k, 1] = (xyz[m, k, 1] - y / ahead) * weight[m, k, 1]
            out[m, k, 2] = (xyz[m, k, 2] - z) * weight[m, k, 2]
    return out


@compiled
def project_jacobian(axes: Float, p_C: Float, weight: Float) -> Float:
    """Return weight dh/dp_C axes, (M, n, 3, 3), for points ``p_C`` (M, n, 3) and matrices ``axes`` (n, 3, 3).

    dh/dp_C = [1/z 0 -x/z^2; 0 1/z -y/z^2; 0 0 1].
    """
    out = np.empty((*p_C.shape, 3))
    for m in range(p_C.shape[0]):
        for k in range(p_C.shape[1]):
            inverse_z = 1.0 / max(p_C[m, k, 2], MIN_Z_M)
            for i in range(3):
                for row in range(2):
                    slope = axes[k, row, i] - p_C[m, k, row] * inverse_z * axes[k, 2, i]
                    out[m, k, row, i] = slope * (inverse_z * weight[m, k, row])
                out[m, k, 2, i] = axes[k, 2, i] * weight[m, k, 2]
    return out


@compiled
def pose_jacobian(rows: Float, p: Float, by_shift: Float) -> Float:
    """Return (``rows`` [p]x, -``by_shift``), (M, n, 3, 6): the Jacobian by a pose (theta, p).

    ``rows`` (M, n, 3, 3) is dh/dp in the rotated frame, ``p`` (M, n, 3) the points there, ``by_shift`` dh by a shift.
    """
    out = np.empty((*p.shape, 6))
    for m in range(p.shape[0]):
        for k in range(p.shape[1]):
            x, y, z = p[m, k]
            for i in range(3):
                a, b, c = rows[m, k, i]
                out[m, k, i, 0] = b * z - c * y
                out[m, k, i, 1] = c * x - a * z
                out[m, k, i, 2] = a * y - b * x
                for j in range(3):
                    out[m, k, i, 3 + j] = -by_shift[m, k, i, j]
    return out


@compiled
def huber(r: Float, limit: float) -> Float:
    """Return the square root of Huber's weight, min(1, limit / |r|), of each residual (N, 3), (N,)."""
    out = np.empty(len(r))
    for n in range(len(r)):
        size = np.sqrt(r[n, 0] ** 2 + r[n, 1] ** 2 + r[n, 2] ** 2)
        out[n] = np.sqrt(limit / size) if size > limit else 1.0
    return out
