"""Where the camera sits on the IMU and how its clock runs against the IMU's, as parts of the filter's state.

The camera's place enters each camera row; its time enters where a pose is cloned: a frame stamped t shows the IMU of
t + t_d, so that the clone's error is (theta + w_I t_d, p + v_W t_d) for an error t_d of the offset [Li14].
"""

from dataclasses import dataclass, replace

import numpy as np

from snakeslam.estimation.settings import CalibrationSettings
from snakeslam.geometry import so3
from snakeslam.messages import Float

PLACE = 6
SIGNIFICANT = 5.0
"""A motion within so many sigmas of nothing tells nothing of the camera's time."""
RATE_SPAN_S = 0.01


@dataclass(frozen=True, slots=True)
class Mount:
    """The camera on the IMU: ``R_IC`` (3, 3), ``p_IC`` (3,) m, ``offset_s`` to add to a frame's time.

    Errors are (t_d | theta, p), R_true = R_IC Exp(theta); each part stands in the state or is held. ``first`` is the
    place as calibrated, where Jacobians are taken: of a head at rest no view tells of the camera's place, and with
    Jacobians that move along it would seem to.
    """

    R_IC: Float
    p_IC: Float
    first: "Mount | None" = None
    offset_s: float = 0.0
    frees_time: bool = False
    frees_place: bool = False

    @property
    def size(self) -> int:
        """Length of the error."""
        return self.time_size + PLACE * self.frees_place

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
            place = dx[self.time_size :]
            moved = replace(moved, R_IC=self.R_IC @ so3.exp(place[:3]), p_IC=self.p_IC + place[3:])
        return replace(moved, first=self.first or self)


def free_mount(R_IC: Float, p_IC: Float, settings: CalibrationSettings) -> tuple[Mount, Float] | None:
    """Return the calibrated mount with what the settings free of it and the variance of its error, None if nothing."""
    time_s = settings.time_offset_sigma_ms / 1e3
    place = np.repeat([np.deg2rad(settings.rotation_sigma_deg), settings.position_sigma_mm / 1e3], 3)
    mount = Mount(R_IC, p_IC, None, 0.0, time_s > 0.0, bool(place.any()))
    if not mount.size:
        return None
    sigma = np.concatenate([[time_s] * mount.frees_time, place if mount.frees_place else []])
    return mount, sigma**2


def motion_by_time(rate_I: Float, cov_rate: Float, v_W: Float, cov_v: Float) -> Float:
    """Return d(theta, p)/dt of a clone, (w_I, v_W) (6,), each zero unless it stands out of its own noise.

    The noise of a head at rest taken for motion would seem to tell the camera's time.
    """
    motions = ((rate_I, cov_rate), (v_W, cov_v))
    return np.concatenate([motion * _stands_out(motion, cov) for motion, cov in motions])


def _stands_out(motion: Float, cov: Float) -> bool:
    return bool(np.linalg.norm(motion) > SIGNIFICANT * np.sqrt(np.linalg.eigvalsh(cov)[-1]))
