"""Joint limits and a follower that never breaks them."""

from dataclasses import dataclass

import numpy as np

from snakeslam.messages import Float


@dataclass(frozen=True, slots=True)
class JointLimits:
    """What every joint may do: ``|q| <= position_rad``, and likewise for its rate and acceleration."""

    position_rad: float
    rate_rad_s: float
    acceleration_rad_s2: float


class LimitedFollower:
    """Follows targets with bounded position, rate and acceleration, braking in time for each."""

    def __init__(self, limits: JointLimits, q_rad: Float) -> None:
        self._limits = limits
        self._q_rad = np.clip(np.asarray(q_rad, dtype=np.float64), -limits.position_rad, limits.position_rad)
        self._dq_rad_s = np.zeros_like(self._q_rad)
        self._target_rad = self._q_rad.copy()

    @property
    def q_rad(self) -> Float:
        """Angles reached, (N,)."""
        return self._q_rad

    @property
    def dq_rad_s(self) -> Float:
        """Rates of the last step, (N,)."""
        return self._dq_rad_s

    def step(self, target_rad: Float, dt_s: float) -> Float:
        """Move towards ``target_rad`` (N,) for ``dt_s`` and return the angles reached, (N,).

        A target that stays within the limits is met exactly; from elsewhere the approach is at constant deceleration
        relative to the target's own rate.
        """
        limits = self._limits
        target = np.clip(target_rad, -limits.position_rad, limits.position_rad)
        target_rate = (target - self._target_rad) / dt_s
        gap = target - self._q_rad - target_rate * dt_s
        approach = self._stoppable_rate(np.abs(gap), dt_s)
        rate = np.clip(target_rate + np.sign(gap) * approach, -self._rate_down(dt_s), self._rate_up(dt_s))
        step = limits.acceleration_rad_s2 * dt_s
        rate = np.clip(rate, self._dq_rad_s - step, self._dq_rad_s + step)
        self._dq_rad_s = np.clip(rate, -limits.rate_rad_s, limits.rate_rad_s)
        self._q_rad = self._q_rad + self._dq_rad_s * dt_s
        self._target_rad = target
        return self._q_rad

    def brake(self, dt_s: float) -> Float:
        """Take as much rate off each joint as the acceleration allows for ``dt_s``; return the angles reached, (N,)."""
        limits = self._limits
        speed = np.maximum(np.abs(self._dq_rad_s) - limits.acceleration_rad_s2 * dt_s, 0.0)
        self._dq_rad_s = np.sign(self._dq_rad_s) * speed
        q_rad = self._q_rad + self._dq_rad_s * dt_s
        self._q_rad = np.clip(q_rad, -limits.position_rad, limits.position_rad)
        self._target_rad = self._q_rad
        return self._q_rad

    def _rate_up(self, dt_s: float) -> Float:
        return self._stoppable_rate(self._limits.position_rad - self._q_rad, dt_s)

    def _rate_down(self, dt_s: float) -> Float:
        return self._stoppable_rate(self._limits.position_rad + self._q_rad, dt_s)

    def _stoppable_rate(self, room_rad: Float, dt_s: float) -> Float:
        """Return the largest v with v dt + v^2 / (2 a) <= room."""
        a = self._limits.acceleration_rad_s2
        return np.minimum(self._limits.rate_rad_s, a * (np.sqrt(dt_s**2 + 2.0 * np.maximum(room_rad, 0.0) / a) - dt_s))
