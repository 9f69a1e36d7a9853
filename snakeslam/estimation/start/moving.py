"""Where the filter starts in motion: gyro bias, velocity and gravity from frames seen while moving."""

from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq, minimize

from snakeslam.calibration import ImuCalibration
from snakeslam.estimation.filter.preintegration import ImuBuffer, ImuSegments, Preintegrated
from snakeslam.estimation.filter.state import State
from snakeslam.estimation.frontend.tracks import TrackTable
from snakeslam.estimation.measurements.camera import CameraRows, Observations
from snakeslam.estimation.start.refine import MAX_BIAS_G, MIN_TRACKS, Refinement, StartWindow, started
from snakeslam.messages import Float

MIN_TRACK = 4
MAX_BIAS_ITERATIONS = 40
"""Ten are usual; a gyro that contradicts the image keeps the search going."""


def start_moving(
    tracks: TrackTable,
    times_ns: Sequence[int],
    imu: ImuBuffer,
    rows: CameraRows,
    noise: ImuCalibration,
    gravity_m_s2: float,
    accel_sign: float = 1.0,
) -> State | None:
    """Return the state at the first of ``times_ns`` from frames seen in motion, or None while they do not tell enough.

    The gyro's bias makes epipolar planes meet [Kneip13]; then velocity, gravity and points follow linearly from the
    rays [Martinelli14]; then all is refined together with both biases on the reprojection errors. A result is taken
    only when its residuals, its covariance and its biases are plausible. ``accel_sign`` -1 asks whether the frames fit
    an accelerometer whose sign is reversed.
    """
    window = _window(tracks, times_ns, imu, rows, noise, gravity_m_s2, accel_sign)
    if window is None:
        return None
    try:
        bias_g = _gyro_bias(window)
        if float(np.linalg.norm(bias_g)) > MAX_BIAS_G:
            return None
        linear = _velocity_and_gravity(window, window.motions(bias_g, np.zeros(3)))
        if linear is None:
            return None
        refined = Refinement(window, bias_g, *linear).solve()
    except np.linalg.LinAlgError:
        # Frames that leave a part of the unknowns undetermined give singular equations: no start from them.
        return None
    return None if refined is None else started(refined, times_ns[0], gravity_m_s2)


def _window(
    tracks: TrackTable,
    times_ns: Sequence[int],
    imu: ImuBuffer,
    rows: CameraRows,
    noise: ImuCalibration,
    gravity_m_s2: float,
    accel_sign: float,
) -> StartWindow | None:
    spans = [imu.segments(times_ns[0], t_ns) for t_ns in times_ns[1:]]
    long = tracks.lengths >= MIN_TRACK
    if long.sum() < MIN_TRACKS or any(span is None for span in spans):
        return None
    t_s = (np.array(times_ns) - times_ns[0]) / 1e9
    kept = [ImuSegments(span.gyro_I, accel_sign * span.accel_I, span.dt_s) for span in spans if span is not None]
    observed = Observations.weighed(tracks.xyz[long], tracks.seen[long], rows, tracks.smear)
    return StartWindow(t_s, kept, observed, rows, noise, gravity_m_s2)


def _gyro_bias(window: StartWindow) -> Float:
    """Return the gyro bias for which the epipolar planes of frame pairs share a direction of travel best."""
    n = len(window.t_s)
    stride = max(1, n // 4)
    pairs = [(k, min(k + stride, n - 1)) for k in range(0, n - stride, max(1, stride // 2))]
    rays = np.concatenate([window.observed.xyz[..., :2], np.ones((*window.observed.seen.shape, 1))], axis=-1)
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True) @ window.rows.R_IC.T
    both = [window.observed.seen[:, a] & window.observed.seen[:, b] for a, b in pairs]
    pre = window.motions(np.zeros(3), np.zeros(3))

    def turn(k: int, bias: Float) -> Float:
        return np.eye(3) if k == 0 else pre[k - 1].corrected(bias, np.zeros(3))[2]

    def cost(bias: Float) -> float:
        total = float(bias @ bias) * 1e-6
        for (a, b), seen in zip(pairs, both, strict=True):
            normals = np.cross(rays[seen, a] @ turn(a, bias).T, rays[seen, b] @ turn(b, bias).T)
            total += float(np.linalg.eigvalsh(normals.T @ normals)[0])
        return total

    return np.asarray(
        minimize(cost, np.zeros(3), method="BFGS", options={"gtol": 1e-9, "maxiter": MAX_BIAS_ITERATIONS}).x
    )


def _velocity_and_gravity(window: StartWindow, pre: list[Preintegrated]) -> tuple[Float, Float] | None:
    """Return v and g at the first frame, in its IMU frame, from the linear equations of all rays, with |g| known.

    A ray d of frame j with turn R_j sees its point P: [R_j d]x (P - v t_j - g t_j^2 / 2 - alpha_j - R_j p_IC) = 0; a
    measured depth gives the third row. Points are eliminated; the norm of g enters by a Lagrange multiplier.
    """
    R_j = np.stack([np.eye(3), *(p.gamma for p in pre)])
    alpha = np.stack([np.zeros(3), *(p.alpha for p in pre)])
    rays = np.concatenate([window.observed.xyz[..., :2], np.ones((*window.observed.seen.shape, 1))], axis=-1)
    length = np.linalg.norm(rays, axis=-1, keepdims=True)
    d = np.einsum("nij,mnj->mni", R_j @ window.rows.R_IC, rays / length)
    origin = alpha + R_j @ window.rows.p_IC
    z = window.observed.xyz[..., 2]
    along = (window.rows.usable_depth(z) & window.observed.seen) * 0.3
    W = (np.eye(3) - d[..., :, None] * d[..., None, :]) * window.observed.seen[..., None, None]
    W = W + along[..., None, None] * d[..., :, None] * d[..., None, :]
    lifted = origin[None] + d * (z * length[..., 0] * (along > 0))[..., None]
    # P - B x = lifted, weighted by W, with x = (v, g).
    t = window.t_s
    B = np.concatenate([t[:, None, None] * np.eye(3), 0.5 * t[:, None, None] ** 2 * np.eye(3)], axis=-1)
    A_pp = W.sum(axis=1) + 1e-9 * np.eye(3)
    A_px = -np.einsum("mnij,njk->mik", W, B)
    A_xx = np.einsum("nki,mnkl,nlj->ij", B, W, B, optimize=True)
    b_p = np.einsum("mnij,mnj->mi", W, lifted)
    b_x = -np.einsum("nki,mnkl,mnl->i", B, W, lifted, optimize=True)
    reduce = np.swapaxes(A_px, 1, 2) @ np.linalg.inv(A_pp)
    A = A_xx - np.einsum("mik,mkj->ij", reduce, A_px)
    b = b_x - np.einsum("mik,mk->i", reduce, b_p)
    if np.linalg.cond(A[:3, :3]) > 1e12:
        return None
    to_g = A[3:, :3] @ np.linalg.inv(A[:3, :3])
    g = _on_sphere(A[3:, 3:] - to_g @ A[:3, 3:], b[3:] - to_g @ b[:3], window.gravity_m_s2)
    return np.linalg.solve(A[:3, :3], b[:3] - A[:3, 3:] @ g), g


def _on_sphere(A: Float, b: Float, radius: float) -> Float:
    """Return argmin x^T A x / 2 - b^T x with |x| = radius (A symmetric): (A + m I) x = b with the largest fitting m."""
    values, vectors = np.linalg.eigh(0.5 * (A + A.T))
    c = vectors.T @ b

    def excess(m: float) -> float:
        return float(np.linalg.norm(c / (values + m))) - radius

    low = -values[0] + max(1e-12, 1e-9 * abs(float(values[-1])))
    high = float(np.linalg.norm(b)) / radius + abs(float(values[0])) + float(abs(values[-1])) + 1.0
    if excess(low) <= 0.0:
        x = c / (values + low)
        x[0] += np.copysign(np.sqrt(max(radius**2 - float(x @ x) + x[0] ** 2, 0.0)) - abs(x[0]), x[0] or 1.0)
        return vectors @ x
    return vectors @ (c / (values + float(brentq(excess, low, high))))
