"""How still the head is while the body moves: heading, rate of heading, and sideways motion."""

from collections import deque

import numpy as np

from snakeslam.messages import Float, ImuSample, PoseEstimate
from snakeslam.runtime.topics import HeadMotion

NS = 1e-9
LEAST_SAMPLES = 8


class HeadStillness:
    """Watches the estimate over the last ``window_s`` seconds (about one period of a gait)."""

    def __init__(self, window_s: float = 4.0) -> None:
        self._window_s = window_s
        self._path: deque[tuple[float, float, float]] = deque()
        self._newest_R_WI: Float = np.eye(3)
        self._yaw_rad: float | None = None
        self._yaw_t_s = 0.0
        self._rate_rad_s: float | None = None
        self._has_gyro = False

    def on_imu(self, imu: ImuSample) -> None:
        """Take the rate about the vertical from the gyroscope, as the newest estimate knows the vertical."""
        self._has_gyro = True
        rate = float(self._newest_R_WI[2] @ imu.gyro_I)
        # A tenth of a second of smoothing at 200 Hz.
        self._rate_rad_s = rate if self._rate_rad_s is None else self._rate_rad_s + 0.05 * (rate - self._rate_rad_s)

    def on_pose(self, pose: PoseEstimate) -> None:
        """Take an estimate."""
        t_s, self._newest_R_WI = pose.t_ns * NS, pose.T_WI[:3, :3]
        yaw = float(np.arctan2(self._newest_R_WI[1, 0], self._newest_R_WI[0, 0]))
        if not self._has_gyro and self._yaw_rad is not None and t_s > self._yaw_t_s:
            turn = (yaw - self._yaw_rad + np.pi) % (2.0 * np.pi) - np.pi
            self._rate_rad_s = float(turn / (t_s - self._yaw_t_s))
        self._yaw_rad, self._yaw_t_s = yaw, t_s
        self._path.append((t_s, float(pose.T_WI[0, 3]), float(pose.T_WI[1, 3])))
        while t_s - self._path[0][0] > self._window_s:
            self._path.popleft()

    def motion(self) -> HeadMotion:
        """Return the three numbers; None where there is not enough yet."""
        return HeadMotion(_deg(self._yaw_rad), _deg(self._rate_rad_s), self._sway_m())

    def _sway_m(self) -> float | None:
        """Peak-to-peak distance from the straight line of mean velocity, in the ground plane."""
        if len(self._path) < LEAST_SAMPLES:
            return None
        t, x, y = np.array(self._path).T
        centred = np.column_stack([x - x.mean(), y - y.mean()])
        velocity = (t - t.mean()) @ centred
        speed = np.linalg.norm(velocity)
        across = np.array([-velocity[1], velocity[0]]) / speed if speed > 0.0 else np.array([0.0, 1.0])
        return float(np.ptp(centred @ across))


def _deg(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else float(np.rad2deg(angle_rad))
