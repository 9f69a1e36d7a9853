"""The camera's extrinsics on the IMU, its time offset and its readout time, as parts of the filter's state.

- Extrinsics (R_IC, p_IC) enter every camera row.
- Time offset: a frame stamped t shows the IMU of t + t_d, so an error t_d moves the pose that is cloned for the frame
  by (w_I t_d, v_W t_d); it enters with the clone's covariance, and no row depends on it [Li14].
- Rolling shutter: row v of H is exposed (v / H - 1/2) t_r after the middle of the image, which enters every row [Li13].
"""

from dataclasses import dataclass, replace

import numpy as np

from snakeslam.calibration import CameraCalibration
from snakeslam.estimation.filter.settings import CalibrationSettings
from snakeslam.geometry import so3
from snakeslam.messages import Float

POSE_SIZE = 6
SIGNIFICANT = 5.0
"""A rate or velocity below so many sigmas is treated as zero when the time offset is estimated from it."""
RATE_SPAN_S = 0.01
"""Time before the frame over which the gyro is averaged for the rate at the frame, in s: two samples at 200 Hz."""


@dataclass(frozen=True, slots=True)
class Extrinsics:
    """Extrinsics ``R_IC`` (3, 3), ``p_IC`` (3,) m and clock of the camera, and which of them the filter estimates.

    ``offset_s`` is added to a frame's time; ``readout_s`` is how much later the last row is exposed than the first. The
    error is (t_d | theta, p | t_r), R_true = R_IC Exp(theta), of which only the estimated parts are in the state.
    ``first`` are the calibrated extrinsics, where Jacobians are taken: a stationary head does not observe the
    extrinsics, and with Jacobians at changing values the filter would seem to learn them.
    """

    R_IC: Float
    p_IC: Float
    first: "Extrinsics | None" = None
    offset_s: float = 0.0
    estimates_time: bool = False
    estimates_pose: bool = False
    readout_s: float = 0.0
    estimates_readout: bool = False

    @property
    def size(self) -> int:
        """Length of the error."""
        return self.time_size + POSE_SIZE * self.estimates_pose + self.estimates_readout

    @property
    def time_size(self) -> int:
        """Length of the time offset's error, 1 or 0."""
        return int(self.estimates_time)

    def plus(self, dx: Float) -> "Extrinsics":
        """Return X [+] dx for an error ``dx`` (size,)."""
        moved = self
        if self.estimates_time:
            moved = replace(moved, offset_s=self.offset_s + float(dx[0]))
        if self.estimates_pose:
            pose = dx[self.time_size : self.time_size + POSE_SIZE]
            moved = replace(moved, R_IC=self.R_IC @ so3.exp(pose[:3]), p_IC=self.p_IC + pose[3:])
        if self.estimates_readout:
            moved = replace(moved, readout_s=self.readout_s + float(dx[-1]))
        return replace(moved, first=self.first or self)


def initial_extrinsics(cam0: CameraCalibration, settings: CalibrationSettings) -> tuple[Extrinsics, Float] | None:
    """Return the calibrated extrinsics with the variance of their estimated part; None if nothing is estimated.

    The calibration's own statements about the camera's clock and shutter take precedence over the settings.
    """
    # One sigma of each part; those with sigma 0 are not estimated.
    known_s, T_IC = cam0.timeshift_sigma_s, cam0.T_IC
    time_s = settings.time_offset_sigma_ms / 1e3 if known_s is None else known_s
    pose = np.repeat([np.deg2rad(settings.rotation_sigma_deg), settings.position_sigma_mm / 1e3], 3)
    readout_s = 0.0 if cam0.shutter == "global" else settings.readout_sigma_ms / 1e3
    extrinsics = Extrinsics(T_IC[:3, :3], T_IC[:3, 3], None, 0.0, time_s > 0.0, bool(pose.any()), 0.0, readout_s > 0.0)
    if not extrinsics.size:
        return None
    parts = [
        [time_s] * extrinsics.estimates_time,
        pose if extrinsics.estimates_pose else [],
        [readout_s] * extrinsics.estimates_readout,
    ]
    sigma = np.concatenate(parts)
    return extrinsics, sigma**2


def pose_rate(rate_I: Float, cov_rate: Float, v_W: Float, cov_v: Float) -> Float:
    """Return d(theta, p)/dt of a clone, (w_I, v_W) (6,), each zero unless it is significant.

    If the noise of a stationary head were taken for motion, the filter would seem to observe the time offset.
    """
    parts = ((rate_I, cov_rate), (v_W, cov_v))
    significant = [np.linalg.norm(x) > SIGNIFICANT * np.sqrt(np.linalg.eigvalsh(cov)[-1]) for x, cov in parts]
    return np.concatenate([x * bool(keep) for (x, _), keep in zip(parts, significant, strict=True)])


def readout_flow(xy: Float, height: Float, w_C: Float) -> Float:
    """Return d(x, y)/dt_r (N, 2) of features (N, 2) at ``height`` v / H (N,) while the camera rotates at ``w_C`` (3,).

    A ray r = (x, y, 1) that is constant in W moves by m = -w_C x r in the camera, which is (v / H - 1/2) (m_xy - (x, y)
    m_z) in the image. The camera's translation during the readout is neglected.
    """
    r = np.column_stack([xy, np.ones(len(xy))])
    moved = so3.cross(r, np.broadcast_to(w_C, r.shape))
    return (moved[:, :2] - xy * moved[:, 2:]) * (height[:, None] - 0.5)
