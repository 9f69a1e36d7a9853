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
        self._turned: deque[tuple[int, Float]] = deque()
        self._R_pose: Float = np.eye(3)
        self._R_pose_gyro: Float = np.eye(3)
        self._pose_ns = -1

    @property
    def R_WI(self) -> Float:
        """Attitude of the head, (3, 3)."""
        if not self._turned:
            return self._R_pose
        return self._R_pose @ self._R_pose_gyro.T @ self._turned[-1][1]

    def update(self, t_ns: int, pose: PoseEstimate | None, imu: ImuSample | None) -> None:
        """Go on to ``t_ns`` with what is known there."""
        if imu is not None:
            before_ns, R = self._turned[-1] if self._turned else (t_ns, np.eye(3))
            self._turned.append((t_ns, R @ so3.exp(imu.gyro_I * ((t_ns - before_ns) * NS))))
            while t_ns - self._turned[0][0] > MEMORY_NS:
                self._turned.popleft()
        if pose is not None and pose.t_ns > self._pose_ns:
            self._pose_ns, self._R_pose = pose.t_ns, pose.T_WI[:3, :3]
            self._R_pose_gyro = self._at(pose.t_ns)

    def _at(self, t_ns: int) -> Float:
        """Return the gyroscope's attitude nearest in time."""
        if not self._turned:
            return np.eye(3)
        return min(self._turned, key=lambda entry: abs(entry[0] - t_ns))[1]
