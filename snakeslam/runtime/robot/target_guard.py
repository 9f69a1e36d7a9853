"""The last check of every joint target: finite, within the joints' limits, and stationary in a hold or E-stop."""

from enum import Enum, auto

import numpy as np

from snakeslam.messages import Float, JointTarget
from snakeslam.robot.limits import JointLimits, LimitedFollower

STEP_S = 0.01
"""The control period."""
RESUME_S = 2.0
"""After a hold the difference between the held posture and control's targets fades over this time."""
ARRIVED_RAD = 1e-6
ROUNDING_RAD = 1e-9
"""A target that is met to this is passed on as it is, so that the guard changes no bit of a run within the limits."""
NOT_FINITE = "control gave a target that is not a finite number"


class _Phase(Enum):
    FOLLOW = auto()
    HOLD = auto()
    RESUME = auto()


class TargetGuard:
    """Follows control within the limits of position, rate and acceleration, or brakes every joint to a stop and holds.

    It owns the latch of the E-stop. A hold ends with ``resume``; after an E-stop ``resume`` has no effect until
    ``reset`` has cleared the latch, which itself moves nothing. ``estop_reason``: latched from the beginning.
    """

    def __init__(self, limits: JointLimits, estop_reason: str | None = None) -> None:
        self._limits = limits
        self._estop_reason = estop_reason
        self._held_because = estop_reason
        self._phase = _Phase.FOLLOW if estop_reason is None else _Phase.HOLD
        self._follower: LimitedFollower | None = None
        self._offset_rad: Float | None = None
        self._resumed_s = 0.0

    @property
    def estop_reason(self) -> str | None:
        """Why the E-stop is latched; None when it is not."""
        return self._estop_reason

    @property
    def held_because(self) -> str | None:
        """Why the robot is held, until ``resume``; None when it is not held."""
        return self._held_because

    @property
    def q_rad(self) -> Float | None:
        """The last target that was let through, (N,)."""
        return None if self._follower is None else self._follower.q_rad

    def start_at(self, q_rad: Float) -> None:
        """Set the measured angles (N,) from which the first target is approached; ignored after the first step."""
        if self._follower is None and q_rad.ndim == 1 and np.all(np.isfinite(q_rad)):
            self._follower = LimitedFollower(self._limits, q_rad)

    def latch(self, reason: str) -> None:
        """Latch the E-stop: brake and hold; the first reason is kept."""
        self._estop_reason = self._estop_reason or reason or "E-stop"
        self.hold(self._estop_reason)

    def hold(self, reason: str) -> None:
        """Brake every joint to a stop and hold; the first reason is kept."""
        self._held_because = self._held_because or reason
        self._phase = _Phase.HOLD

    def reset(self) -> None:
        """Clear the latch of the E-stop; the robot stays held."""
        self._estop_reason = None

    def resume(self) -> None:
        """Follow control again, smoothly from the held posture; no effect while the E-stop is latched."""
        if self._estop_reason is None and self._phase is _Phase.HOLD:
            self._phase, self._held_because = _Phase.RESUME, None
            self._offset_rad, self._resumed_s = None, 0.0

    def step(self, target: JointTarget) -> JointTarget:
        """Return what the servos get in place of control's ``target``, one control period after the last call."""
        wanted_rad = target.q_rad
        if not np.all(np.isfinite(wanted_rad)) or not self._has_all_joints(wanted_rad):
            self.hold(NOT_FINITE)
            wanted_rad = np.zeros_like(wanted_rad) if self._follower is None else self._follower.q_rad
        if self._follower is None:
            self._follower = LimitedFollower(self._limits, wanted_rad)
        return JointTarget(target.t_ns, self._next(self._follower, wanted_rad), target.head_roll_rad)

    def brake(self, t_ns: int) -> JointTarget | None:
        """Return the next target of the brake ramp, for when control gave none; None while no angles are known."""
        if self._follower is None:
            return None
        return JointTarget(t_ns, self._follower.brake(STEP_S))

    def _has_all_joints(self, wanted_rad: Float) -> bool:
        """Return whether there is an angle for each joint: the compiled follower would read past a shorter array."""
        return self._follower is None or wanted_rad.shape == self._follower.q_rad.shape

    def _next(self, follower: LimitedFollower, wanted_rad: Float) -> Float:
        if self._phase is _Phase.HOLD:
            return follower.brake(STEP_S)
        if self._phase is _Phase.RESUME:
            return self._blend(follower, wanted_rad)
        q_rad = follower.step(wanted_rad, STEP_S)
        if np.max(np.abs(q_rad - wanted_rad), initial=0.0) > ROUNDING_RAD:
            return q_rad
        return np.clip(wanted_rad, -self._limits.position_rad, self._limits.position_rad)

    def _blend(self, follower: LimitedFollower, wanted_rad: Float) -> Float:
        """Add the offset of the held posture to control's target, with a weight that falls smoothly from 1 to 0."""
        if self._offset_rad is None:
            self._offset_rad = follower.q_rad - wanted_rad
        self._resumed_s += STEP_S
        s = min(self._resumed_s / RESUME_S, 1.0)
        q = follower.step(wanted_rad + self._offset_rad * (1.0 - s * s * (3.0 - 2.0 * s)), STEP_S)
        if s >= 1.0 and np.allclose(q, wanted_rad, rtol=0.0, atol=ARRIVED_RAD):
            self._phase = _Phase.FOLLOW
        return q
