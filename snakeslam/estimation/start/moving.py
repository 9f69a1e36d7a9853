"""The start in motion: the filter's state from frames that a moving head has observed, without a stationary time."""

from collections.abc import Sequence

import numpy as np

from snakeslam.calibration import ImuCalibration
from snakeslam.estimation.filter.preintegration import ImuBuffer, ImuSegments
from snakeslam.estimation.filter.state import BIAS_A, BIAS_G, CORE, THETA, P, State, V
from snakeslam.estimation.frontend.tracks import TrackTable
from snakeslam.estimation.measurements.camera import Observations, ReprojectionModel
from snakeslam.estimation.start import refine as unknowns
from snakeslam.estimation.start.closed_form import gyro_bias, velocity_and_gravity
from snakeslam.estimation.start.refine import MIN_TRACKS, SIZE, Refined, refine
from snakeslam.estimation.start.stationary import upright
from snakeslam.estimation.start.window import StartWindow
from snakeslam.geometry import so3
from snakeslam.messages import Float

MIN_TRACK_FRAMES = 4
"""Frames in which a feature must have been tracked to be used."""
MAX_RESIDUAL = 3.0
"""Largest RMS of the whitened residuals: the frames fit the motion within three sigmas."""
MAX_SIGMA_V_M_S = 0.25
MAX_SIGMA_TILT_RAD = np.deg2rad(3.0)
"""With larger sigmas of velocity or tilt the motion was too small to determine them."""
MAX_BIAS_G_RAD_S = 0.5
MAX_BIAS_A_M_S2 = 1.0
"""Larger biases are no biases: something else contradicts the images."""
INFORMATION_SHARE = 10.0
"""The start's sigmas are widened by this factor, its information divided by its square. The filter then uses the same
frames once more, so that the start only provides the point of linearisation."""


def start_moving(
    tracks: TrackTable,
    times_ns: Sequence[int],
    imu: ImuBuffer,
    camera: ReprojectionModel,
    noise: ImuCalibration,
    gravity_m_s2: float,
    accel_sign: float = 1.0,
) -> State | None:
    """Return the state at the first of ``times_ns`` from the tracks of these frames; None while it is undetermined.

    W is z up, its origin at the IMU, its yaw zero. With ``accel_sign`` -1 the accelerometer's sign is reversed, to find
    out whether that explains the frames.
    """
    # 1. The IMU's spans from the first frame to each later one, and the features tracked for long enough.
    spans = [imu.segments(times_ns[0], t_ns) for t_ns in times_ns[1:]]
    long = tracks.lengths >= MIN_TRACK_FRAMES
    if long.sum() < MIN_TRACKS or any(span is None for span in spans):
        return None
    t_s = (np.array(times_ns) - times_ns[0]) / 1e9
    kept = [ImuSegments(span.gyro_I, accel_sign * span.accel_I, span.dt_s) for span in spans if span is not None]
    observed = Observations.weighted(tracks.xyz[long], tracks.seen[long], camera, tracks.motion_blur_rad)
    window = StartWindow(t_s, kept, observed, camera, noise, gravity_m_s2)
    try:
        # 2. The gyro's bias from epipolar planes, min sum lambda_min(sum n n^T) [Kneip13].
        bias_g = gyro_bias(window)
        if float(np.linalg.norm(bias_g)) > MAX_BIAS_G_RAD_S:
            return None

        # 3. Velocity and gravity, linear in all rays, (I - d d^T)(P - v t - g t^2 / 2 - alpha) = 0 [Martinelli14].
        linear = velocity_and_gravity(window, window.motions(bias_g, np.zeros(3)))
        if linear is None:
            return None

        # 4. Refinement of (v, tilt of g, b_g, b_a) and all points: Gauss-Newton on the reprojection errors.
        refined = refine(window, bias_g, *linear)
        if refined is None or not _plausible(refined):
            return None
        cov_x = refined.cov(INFORMATION_SHARE**2)
    except np.linalg.LinAlgError:
        # Frames that leave a part of the unknowns undetermined give singular equations: no start from them.
        return None

    # 5. The state: W is level where g points down, v_W = R_WI v.
    R_WI = upright(-refined.g)
    v_W = R_WI @ refined.v
    state = State(times_ns[0], R_WI, np.zeros(3), v_W, refined.bias_g, refined.bias_a, np.zeros((CORE, CORE)))

    # 6. Its covariance M cov(x) M^T. g_true = Exp(d) g, R_true = R_WI Exp(theta): theta = -d for d orthogonal to g, and
    #    dv_W = R_WI (dv + [v]x d). Yaw and position define W; they get small variances.
    M = np.zeros((CORE, SIZE))
    orthogonal = np.eye(3) - np.outer(refined.g, refined.g) / gravity_m_s2**2
    M[THETA, unknowns.TILT] = -orthogonal
    M[V, unknowns.V] = R_WI
    M[V, unknowns.TILT] = R_WI @ so3.hat(refined.v) @ orthogonal
    M[BIAS_G, unknowns.BIAS_G] = M[BIAS_A, unknowns.BIAS_A] = np.eye(3)
    cov = M @ cov_x @ M.T
    cov[THETA, THETA] += np.eye(3) * 1e-8
    cov[P, P] += np.eye(3) * 1e-10
    state.cov = 0.5 * (cov + cov.T)
    return state


def _plausible(refined: Refined) -> bool:
    """Return whether residuals, sigmas and biases are those of a start that can be trusted."""
    sigma: Float = np.sqrt(np.maximum(np.diag(refined.cov()), 0.0))
    return (
        refined.count >= MIN_TRACKS
        and refined.rms < MAX_RESIDUAL
        and bool(np.all(sigma[unknowns.V] < MAX_SIGMA_V_M_S))
        and bool(np.all(sigma[unknowns.TILT] < MAX_SIGMA_TILT_RAD))
        and float(np.linalg.norm(refined.bias_g)) < MAX_BIAS_G_RAD_S
        and float(np.linalg.norm(refined.bias_a)) < MAX_BIAS_A_M_S2
    )
