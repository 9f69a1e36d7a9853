"""The head's attitude now: the newest estimate, propagated by the gyroscope."""

from collections import deque

import numpy as np

from snakeslam.geometry import so3
from snakeslam.messages import Float, ImuSample, PoseEstimate

NS = 1e-9
MEMORY_NS = 1_000_000_000
"""Rotations are kept for so long; the newest estimate is not older."""


class HeadAttitude:
    """Call ``update`` for every target; without an estimate the attitude is relative to the first, assumed level."""

    def __init__(self) -> None:
        self._R: Float = np.eye(3)
        self._R_ns = -1
        self._rotations: deque[tuple[int, Float]] = deque()
        self._t_ns: int | None = None

    @property
    def R_WI(self) -> Float:
        """Attitude of the head, (3, 3)."""
        rotations = [rotation_I for t_ns, rotation_I in self._rotations if t_ns > self._R_ns]
        return _rotated(self._R, rotations) if rotations else self._R

    def update(self, t_ns: int, pose: PoseEstimate | None, imu: ImuSample | None) -> None:
        """Propagate to ``t_ns`` with the newest estimate and the IMU sample of that time."""
        if imu is not None:
            dt_s = 0.0 if self._t_ns is None else (t_ns - self._t_ns) * NS
            self._rotations.append((t_ns, imu.gyro_I * dt_s))
            self._t_ns = t_ns
        if pose is not None and pose.t_ns > self._R_ns:
            self._R, self._R_ns = pose.T_WI[:3, :3], pose.t_ns
        while self._rotations and t_ns - self._rotations[0][0] > MEMORY_NS:
            self._fold_in(*self._rotations.popleft())

    def _fold_in(self, t_ns: int, rotation_I: Float) -> None:
        """Apply the oldest rotation to the attitude, unless a later estimate contains it already."""
        if t_ns > self._R_ns:
            self._R, self._R_ns = _rotated(self._R, [rotation_I]), t_ns


def _rotated(R: Float, rotations_I: list[Float]) -> Float:
    for step in so3.exp(np.array(rotations_I)):
        R = R @ step
    return R
