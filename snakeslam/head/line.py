"""The line in the world that the head is held on, and the head's errors to it now, from estimates of the past.

The yaw is that of the newest estimate, propagated by the gyroscope; the sideways position is propagated by the
estimated velocity. A new estimate that differs from what gyroscope and velocity predicted is a correction of the
estimate, not a motion of the head. A small correction of the position is applied over ``CORRECTION_S``, so that it does
not jerk the head; a large one, of position or yaw (a start, a reset), moves the line with it.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from snakeslam.geometry import so3
from snakeslam.messages import Float, ImuSample, PoseEstimate

NS = 1e-9
MEMORY_NS = 1_000_000_000
"""An estimate is propagated for so long at most."""
JUMP_RAD = float(np.deg2rad(5.0))
JUMP_M = 0.08
CORRECTION_S = 0.25
STEERING_RATE_RAD_S = float(np.deg2rad(8.0))
"""Rate at which the line rotates to a new heading."""


@dataclass(frozen=True, slots=True)
class LineErrors:
    """Yaw of the head against the line (rad, positive to the left) and its distance to the left of it (m)."""

    yaw_rad: float = 0.0
    lateral_m: float = 0.0


class HeadLine:
    """Follows the head's yaw and sideways position; call ``update`` for every target."""

    def __init__(self) -> None:
        self._rotations: deque[tuple[int, float]] = deque()
        self._rate_rad_s = 0.0
        self._pose: PoseEstimate | None = None
        self._pose_yaw_rad = 0.0
        self._withheld_W: Float = np.zeros(2)
        self._t_ns = 0
        self._running = False
        self._heading_rad = 0.0
        self._origin_W: Float = np.zeros(2)
        self._to_steer_rad = 0.0

    @property
    def heading_rad(self) -> float:
        """Heading of the line in the estimate's world."""
        return self._heading_rad

    @property
    def errors(self) -> LineErrors:
        """The head's errors now; zero without any sensor, because an unknown error cannot be corrected."""
        if self._pose is None and not self._rotations:
            return LineErrors()
        across = np.array([-np.sin(self._heading_rad), np.cos(self._heading_rad)])
        lateral_m = 0.0 if self._pose is None else float(across @ (self._position_W() - self._origin_W))
        return LineErrors(_wrapped(self._yaw_rad() - self._heading_rad), lateral_m)

    def update(self, t_ns: int, pose: PoseEstimate | None, imu: ImuSample | None) -> None:
        """Propagate to ``t_ns`` with the newest estimate and the IMU sample of that time."""
        dt_s = (t_ns - self._t_ns) * NS if self._running else 0.0
        self._t_ns, self._running = t_ns, True
        self._withheld_W = float(np.exp(-dt_s / CORRECTION_S)) * self._withheld_W
        if imu is not None:
            self._add_gyro(t_ns, imu)
        if pose is not None and (self._pose is None or pose.t_ns > self._pose.t_ns):
            self._add_pose(pose)
        self._steer(dt_s)

    def lay(self, heading_rad: float, offset_W: Float) -> None:
        """Set the line through a point, (2,) m from the head, at a heading."""
        self._heading_rad = heading_rad
        self._origin_W = self._position_W() + offset_W
        self._to_steer_rad = 0.0

    def steer_by(self, angle_rad: float) -> None:
        """Rotate the line by an angle, positive to the left, at ``STEERING_RATE_RAD_S`` about the head."""
        self._to_steer_rad += angle_rad

    def _yaw_rad(self) -> float:
        rotated = self._rotations[-1][1] if self._rotations else 0.0
        return self._pose_yaw_rad + rotated - (self._rotated_at(self._pose.t_ns) if self._pose is not None else 0.0)

    def _position_W(self) -> Float:
        if self._pose is None:
            return np.zeros(2)
        ahead_s = min(self._t_ns - self._pose.t_ns, MEMORY_NS) * NS
        return self._pose.T_WI[:2, 3] + self._pose.v_W[:2] * ahead_s - self._withheld_W

    def _add_gyro(self, t_ns: int, imu: ImuSample) -> None:
        """Integrate the rate about the vertical."""
        up_I = np.array([0.0, 0.0, 1.0]) if self._pose is None else self._pose.T_WI[2, :3]
        rate = float(up_I @ imu.gyro_I)
        if self._rotations:
            before_ns, rotated = self._rotations[-1]
            self._rotations.append((t_ns, rotated + (rate + self._rate_rad_s) / 2.0 * (t_ns - before_ns) * NS))
        else:
            self._rotations.append((t_ns, 0.0))
        self._rate_rad_s = rate
        while t_ns - self._rotations[0][0] > MEMORY_NS:
            self._rotations.popleft()

    def _rotated_at(self, t_ns: int) -> float:
        later: tuple[int, float] | None = None
        for at_ns, rotated in reversed(self._rotations):
            if at_ns <= t_ns:
                if later is None:
                    return rotated
                return rotated + (later[1] - rotated) * (t_ns - at_ns) / (later[0] - at_ns)
            later = at_ns, rotated
        return 0.0 if later is None else later[1]

    def _add_pose(self, pose: PoseEstimate) -> None:
        """Use a newer estimate; where it jumps, move the line with it."""
        yaw = float(so3.yaw(pose.T_WI[:3, :3]))
        since = 0.0 if self._pose is None else self._rotated_at(self._pose.t_ns)
        jump_rad = _wrapped(yaw - self._pose_yaw_rad - self._rotated_at(pose.t_ns) + since)
        jump_W = pose.T_WI[:2, 3].copy()
        if self._pose is not None:
            jump_W -= self._pose.T_WI[:2, 3] + self._pose.v_W[:2] * ((pose.t_ns - self._pose.t_ns) * NS)
        if self._pose is None or abs(jump_rad) > JUMP_RAD or float(np.linalg.norm(jump_W)) > JUMP_M:
            self._move_with(pose, jump_rad, jump_W)
        else:
            self._withheld_W = self._withheld_W + jump_W
        self._pose, self._pose_yaw_rad = pose, yaw

    def _move_with(self, pose: PoseEstimate, jump_rad: float, jump_W: Float) -> None:
        """Rotate the line about the head, and shift it, as the estimate did."""
        c, s = np.cos(jump_rad), np.sin(jump_rad)
        p_W = pose.T_WI[:2, 3]
        self._origin_W = p_W + np.array([[c, -s], [s, c]]) @ (self._origin_W + jump_W - p_W)
        self._heading_rad += jump_rad

    def _steer(self, dt_s: float) -> None:
        """Rotate the line about the point of it that is nearest to the head."""
        step = float(np.clip(self._to_steer_rad, -STEERING_RATE_RAD_S * dt_s, STEERING_RATE_RAD_S * dt_s))
        if step == 0.0:
            return
        lateral_m = self.errors.lateral_m
        self._heading_rad += step
        self._to_steer_rad -= step
        across = np.array([-np.sin(self._heading_rad), np.cos(self._heading_rad)])
        self._origin_W = self._position_W() - lateral_m * across


def _wrapped(angle_rad: float) -> float:
    return float((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)
