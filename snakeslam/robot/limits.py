"""Joint limits and a follower that never breaks them."""

from dataclasses import dataclass

import numpy as np

from snakeslam.geometry.compiled import compiled
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
        # Compiled here, if it is not yet, and not while the robot moves.
        _follow(self._q_rad, self._dq_rad_s, self._q_rad, self._q_rad, 1.0, (1.0, 1.0, 1.0))

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
        self._q_rad, self._dq_rad_s, self._target_rad = _follow(
            self._q_rad,
            self._dq_rad_s,
            self._target_rad,
            np.asarray(target_rad, dtype=np.float64),
            dt_s,
            (limits.position_rad, limits.rate_rad_s, limits.acceleration_rad_s2),
        )
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


@compiled
def _follow(
    q_rad: Float, dq_rad_s: Float, before_rad: Float, wanted_rad: Float, dt_s: float, limits: tuple[float, float, float]
) -> tuple[Float, Float, Float]:
    """Return angles and rates after ``dt_s``, and the targets ``wanted_rad`` cut to the limits; each (N,).

    ``before_rad`` (N,) are the targets of the step before.
    """
    position, fastest, acceleration = limits
    q, dq, targets = np.empty_like(q_rad), np.empty_like(q_rad), np.empty_like(q_rad)
    for n in range(len(q_rad)):
        target = _within(wanted_rad[n], -position, position)
        target_rate = (target - before_rad[n]) / dt_s
        gap = target - q_rad[n] - target_rate * dt_s
        rate = target_rate + np.sign(gap) * _stoppable_rate(abs(gap), dt_s, fastest, acceleration)
        down = _stoppable_rate(position + q_rad[n], dt_s, fastest, acceleration)
        up = _stoppable_rate(position - q_rad[n], dt_s, fastest, acceleration)
        rate = _within(rate, -down, up)
        step = acceleration * dt_s
        rate = _within(_within(rate, dq_rad_s[n] - step, dq_rad_s[n] + step), -fastest, fastest)
        q[n], dq[n], targets[n] = q_rad[n] + rate * dt_s, rate, target
    return q, dq, targets


@compiled
def _stoppable_rate(margin_rad: float, dt_s: float, fastest: float, acceleration: float) -> float:
    """Return the largest v with v dt + v^2 / (2 a) <= margin."""
    margin = max(margin_rad, 0.0)
    return min(fastest, acceleration * (np.sqrt(dt_s**2 + 2.0 * margin / acceleration) - dt_s))


@compiled
def _within(value: float, low: float, high: float) -> float:
    """Return ``value`` cut to the bounds; NaN stays NaN, so that the guard detects it."""
    if value < low:
        return low
    return high if value > high else value
