"""The head's attitude now: the newest estimate's, carried on by the gyroscope."""

from collections import deque

import numpy as np

from snakeslam.geometry import so3
from snakeslam.messages import Float, ImuSample, PoseEstimate

NS = 1e-9
MEMORY_NS = 1_000_000_000


class HeadAttitude:
    """Call ``update`` for every target; without an estimate the attitude is that since the start, taken for level."""

    def __init__(self) -> None:
        self._R: Float = np.eye(3)
        self._R_ns = -1
        self._turns: deque[tuple[int, Float]] = deque()
        self._t_ns: int | None = None

    @property
    def R_WI(self) -> Float:
        """Attitude of the head, (3, 3)."""
        turns = [turn_I for t_ns, turn_I in self._turns if t_ns > self._R_ns]
        return _turned(self._R, turns) if turns else self._R

    def update(self, t_ns: int, pose: PoseEstimate | None, imu: ImuSample | None) -> None:
        """Go on to ``t_ns`` with what is known there."""
        if imu is not None:
            dt_s = 0.0 if self._t_ns is None else (t_ns - self._t_ns) * NS
            self._turns.append((t_ns, imu.gyro_I * dt_s))
            self._t_ns = t_ns
        if pose is not None and pose.t_ns > self._R_ns:
            self._R, self._R_ns = pose.T_WI[:3, :3], pose.t_ns
        while self._turns and t_ns - self._turns[0][0] > MEMORY_NS:
            self._forget(*self._turns.popleft())

    def _forget(self, t_ns: int, turn_I: Float) -> None:
        """Take the oldest turn into the attitude, if no estimate has told of it."""
        if t_ns > self._R_ns:
            self._R, self._R_ns = _turned(self._R, [turn_I]), t_ns


def _turned(R: Float, turns_I: list[Float]) -> Float:
    for step in so3.exp(np.array(turns_I)):
        R = R @ step
    return R
