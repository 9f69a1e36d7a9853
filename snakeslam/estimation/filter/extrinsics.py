"""Where the camera sits on the IMU and how its clock runs against the IMU's, as parts of the filter's state.

The camera's place enters each camera row; its time enters where a pose is cloned: a frame stamped t shows the IMU of
t + t_d, so that the clone's error is (theta + w_I t_d, p + v_W t_d) for an error t_d of the offset [Li14]. A rolling
shutter enters each row too: a picture's row v of H is exposed (v / H - 1/2) t_r after its middle [Li13].
"""

from dataclasses import dataclass, replace

import numpy as np

from snakeslam.calibration import CameraCalibration
from snakeslam.estimation.filter.settings import CalibrationSettings
from snakeslam.geometry import so3
from snakeslam.messages import Float

PLACE = 6
SIGNIFICANT = 5.0
"""A motion within so many sigmas of nothing tells nothing of the camera's time."""
RATE_SPAN_S = 0.01


@dataclass(frozen=True, slots=True)
class Mount:
    """The camera on the IMU: ``R_IC`` (3, 3), ``p_IC`` (3,) m, ``offset_s`` to add to a frame's time.

    ``readout_s`` is how much later the last row is exposed than the first. Errors are (t_d | theta, p | t_r), R_true =
    R_IC Exp(theta); each part stands in the state or is held. ``first`` is the place as calibrated, where Jacobians are
    taken: of a head at rest no view tells of the camera's place, and with Jacobians that move along it would seem to.
    """

    R_IC: Float
    p_IC: Float
    first: "Mount | None" = None
    offset_s: float = 0.0
    frees_time: bool = False
    frees_place: bool = False
    readout_s: float = 0.0
    frees_readout: bool = False

    @property
    def size(self) -> int:
        """Length of the error."""
        return self.time_size + PLACE * self.frees_place + self.frees_readout

    @property
    def time_size(self) -> int:
        """Length of the time's error, 1 or 0."""
        return int(self.frees_time)

    def plus(self, dx: Float) -> "Mount":
        """Return it moved by an error (size,)."""
        moved = self
        if self.frees_time:
            moved = replace(moved, offset_s=self.offset_s + float(dx[0]))
        if self.frees_place:
            place = dx[self.time_size : self.time_size + PLACE]
            moved = replace(moved, R_IC=self.R_IC @ so3.exp(place[:3]), p_IC=self.p_IC + place[3:])
        if self.frees_readout:
            moved = replace(moved, readout_s=self.readout_s + float(dx[-1]))
        return replace(moved, first=self.first or self)


def free_mount(cam0: CameraCalibration, settings: CalibrationSettings) -> tuple[Mount, Float] | None:
    """Return the calibrated mount with what is free of it and the variance of its error, None if nothing.

    What the calibration knows of the camera's clock and shutter goes before the settings.
    """
    known_s, T_IC = cam0.timeshift_sigma_s, cam0.T_IC
    time_s = settings.time_offset_sigma_ms / 1e3 if known_s is None else known_s
    place = np.repeat([np.deg2rad(settings.rotation_sigma_deg), settings.position_sigma_mm / 1e3], 3)
    readout_s = 0.0 if cam0.shutter == "global" else settings.readout_sigma_ms / 1e3
    mount = Mount(T_IC[:3, :3], T_IC[:3, 3], None, 0.0, time_s > 0.0, bool(place.any()), 0.0, readout_s > 0.0)
    if not mount.size:
        return None
    parts = [[time_s] * mount.frees_time, place if mount.frees_place else [], [readout_s] * mount.frees_readout]
    sigma = np.concatenate(parts)
    return mount, sigma**2


def motion_by_time(rate_I: Float, cov_rate: Float, v_W: Float, cov_v: Float) -> Float:
    """Return d(theta, p)/dt of a clone, (w_I, v_W) (6,), each zero unless it stands out of its own noise.

    The noise of a head at rest taken for motion would seem to tell the camera's time.
    """
    motions = ((rate_I, cov_rate), (v_W, cov_v))
    return np.concatenate([motion * _stands_out(motion, cov) for motion, cov in motions])


def motion_of_rows(xy: Float, height: Float, w_C: Float) -> Float:
    """Return d(x, y)/dt_r (N, 2) of features (N, 2) at ``height`` v / H (N,) while the camera turns at ``w_C`` (3,).

    A ray r = (x, y, 1) at rest in W moves by -w x r in the camera.
    """
    r = np.column_stack([xy, np.ones(len(xy))])
    moved = so3.cross(r, np.broadcast_to(w_C, r.shape))
    return (moved[:, :2] - xy * moved[:, 2:]) * (height[:, None] - 0.5)


def _stands_out(motion: Float, cov: Float) -> bool:
    return bool(np.linalg.norm(motion) > SIGNIFICANT * np.sqrt(np.linalg.eigvalsh(cov)[-1]))
