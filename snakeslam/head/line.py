"""The line in the world that the head is held on, and the head's errors to it now, from estimates of the past.

The yaw is the newest estimate's, carried on by the gyroscope; the sideways position is carried on by its velocity.
What an estimate says at once that gyroscope and velocity did not foretell is an estimate set right, not a motion. A
small correction of the place comes in over ``CORRECTION_S``, so that it does not jerk the head; a large one, of place
or yaw (a start, a reset), moves the line with it.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from snakeslam.geometry import so3
from snakeslam.messages import Float, ImuSample, PoseEstimate

NS = 1e-9
MEMORY_NS = 1_000_000_000
"""An estimate is carried on for so long at most."""
JUMP_RAD = float(np.deg2rad(5.0))
JUMP_M = 0.08
CORRECTION_S = 0.25
TURN_RATE_RAD_S = float(np.deg2rad(8.0))
"""How fast the line turns to a new heading."""


@dataclass(frozen=True, slots=True)
class LineErrors:
    """Yaw of the head against the line (rad, positive to the left) and its distance to the left of it (m)."""

    yaw_rad: float = 0.0
    lateral_m: float = 0.0


class HeadLine:
    """Follows the head's yaw and sideways position; call ``update`` for every target."""

    def __init__(self) -> None:
        self._turned: deque[tuple[int, float]] = deque()
        self._rate_rad_s = 0.0
        self._pose: PoseEstimate | None = None
        self._pose_yaw_rad = 0.0
        self._withheld_W: Float = np.zeros(2)
        self._t_ns = 0
        self._running = False
        self._heading_rad = 0.0
        self._origin_W: Float = np.zeros(2)
        self._to_turn_rad = 0.0

    @property
    def heading_rad(self) -> float:
        """Heading of the line in the estimate's world."""
        return self._heading_rad

    @property
    def errors(self) -> LineErrors:
        """The head's errors now; none without any sensor, for what is not seen cannot be steered out."""
        if self._pose is None and not self._turned:
            return LineErrors()
        across = np.array([-np.sin(self._heading_rad), np.cos(self._heading_rad)])
        lateral_m = 0.0 if self._pose is None else float(across @ (self._position_W() - self._origin_W))
        return LineErrors(_wrapped(self._yaw_rad() - self._heading_rad), lateral_m)

    def update(self, t_ns: int, pose: PoseEstimate | None, imu: ImuSample | None) -> None:
        """Go on to ``t_ns`` with what is known there."""
        dt_s = (t_ns - self._t_ns) * NS if self._running else 0.0
        self._t_ns, self._running = t_ns, True
        self._withheld_W = float(np.exp(-dt_s / CORRECTION_S)) * self._withheld_W
        if imu is not None:
            self._take_gyro(t_ns, imu)
        if pose is not None and (self._pose is None or pose.t_ns > self._pose.t_ns):
            self._take_pose(pose)
        self._turn(dt_s)

    def lay(self, heading_rad: float, offset_W: Float) -> None:
        """Lay the line through a point, (2,) m from the head, at a heading."""
        self._heading_rad = heading_rad
        self._origin_W = self._position_W() + offset_W
        self._to_turn_rad = 0.0

    def turn_by(self, angle_rad: float) -> None:
        """Turn the line, positive to the left, at ``TURN_RATE_RAD_S`` about where the head will be."""
        self._to_turn_rad += angle_rad

    def _yaw_rad(self) -> float:
        turned = self._turned[-1][1] if self._turned else 0.0
        return self._pose_yaw_rad + turned - (self._turned_at(self._pose.t_ns) if self._pose is not None else 0.0)

    def _position_W(self) -> Float:
        if self._pose is None:
            return np.zeros(2)
        ahead_s = min(self._t_ns - self._pose.t_ns, MEMORY_NS) * NS
        return self._pose.T_WI[:2, 3] + self._pose.v_W[:2] * ahead_s - self._withheld_W

    def _take_gyro(self, t_ns: int, imu: ImuSample) -> None:
        """Integrate the rate about the vertical."""
        up_I = np.array([0.0, 0.0, 1.0]) if self._pose is None else self._pose.T_WI[2, :3]
        rate = float(up_I @ imu.gyro_I)
        if self._turned:
            before_ns, turned = self._turned[-1]
            self._turned.append((t_ns, turned + (rate + self._rate_rad_s) / 2.0 * (t_ns - before_ns) * NS))
        else:
            self._turned.append((t_ns, 0.0))
        self._rate_rad_s = rate
        while t_ns - self._turned[0][0] > MEMORY_NS:
            self._turned.popleft()

    def _turned_at(self, t_ns: int) -> float:
        later: tuple[int, float] | None = None
        for at_ns, turned in reversed(self._turned):
            if at_ns <= t_ns:
                if later is None:
                    return turned
                return turned + (later[1] - turned) * (t_ns - at_ns) / (later[0] - at_ns)
            later = at_ns, turned
        return 0.0 if later is None else later[1]

    def _take_pose(self, pose: PoseEstimate) -> None:
        """Take a newer estimate; carry the line along where it jumps."""
        yaw = float(so3.yaw(pose.T_WI[:3, :3]))
        since = 0.0 if self._pose is None else self._turned_at(self._pose.t_ns)
        jump_rad = _wrapped(yaw - self._pose_yaw_rad - self._turned_at(pose.t_ns) + since)
        jump_W = pose.T_WI[:2, 3].copy()
        if self._pose is not None:
            jump_W -= self._pose.T_WI[:2, 3] + self._pose.v_W[:2] * ((pose.t_ns - self._pose.t_ns) * NS)
        if self._pose is None or abs(jump_rad) > JUMP_RAD or float(np.linalg.norm(jump_W)) > JUMP_M:
            self._carry_along(pose, jump_rad, jump_W)
        else:
            self._withheld_W = self._withheld_W + jump_W
        self._pose, self._pose_yaw_rad = pose, yaw

    def _carry_along(self, pose: PoseEstimate, jump_rad: float, jump_W: Float) -> None:
        """Turn the line about the head, and move it, as the estimate did."""
        c, s = np.cos(jump_rad), np.sin(jump_rad)
        p_W = pose.T_WI[:2, 3]
        self._origin_W = p_W + np.array([[c, -s], [s, c]]) @ (self._origin_W + jump_W - p_W)
        self._heading_rad += jump_rad

    def _turn(self, dt_s: float) -> None:
        """Turn the line about the head's foot on it."""
        step = float(np.clip(self._to_turn_rad, -TURN_RATE_RAD_S * dt_s, TURN_RATE_RAD_S * dt_s))
        if step == 0.0:
            return
        lateral_m = self.errors.lateral_m
        self._heading_rad += step
        self._to_turn_rad -= step
        across = np.array([-np.sin(self._heading_rad), np.cos(self._heading_rad)])
        self._origin_W = self._position_W() - lateral_m * across


def _wrapped(angle_rad: float) -> float:
    return float((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)
