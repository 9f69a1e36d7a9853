"""The emergency stop as a pure state machine between control and the robot: the last word on every joint target."""

from collections.abc import Sequence
from enum import Enum, auto

import numpy as np

from snakeslam.backends.base import Backend
from snakeslam.calibration import SensorRig
from snakeslam.messages import Float, GroundTruth, JointTarget, Packet
from snakeslam.robot.limits import JointLimits, LimitedFollower
from snakeslam.robot.model import SnakeModel

STEP_S = 0.01
RESUME_S = 2.0
ARRIVED_RAD = 1e-6


class _Phase(Enum):
    FOLLOW = auto()
    HOLD = auto()
    RESUME = auto()


class Guard:
    """Passes targets on until latched; then brakes every joint at its limit and holds.

    ``reset`` clears the latch and still holds; only ``resume`` moves again, from the held posture back to what control
    asks for, smoothly.
    """

    def __init__(self, limits: JointLimits, reason: str | None = None) -> None:
        self._limits = limits
        self._reason = reason
        self._phase = _Phase.FOLLOW if reason is None else _Phase.HOLD
        self._q_rad: Float | None = None
        self._dq_rad_s: Float | None = None
        self._offset_rad: Float | None = None
        self._follower: LimitedFollower | None = None
        self._resumed_s = 0.0

    @property
    def reason(self) -> str | None:
        """Why it is latched; None when it is not."""
        return self._reason

    @property
    def q_rad(self) -> Float | None:
        """The last target let through, (N,)."""
        return self._q_rad

    def latch(self, reason: str) -> None:
        """Stop and hold; the first reason stays."""
        self._reason = self._reason or reason
        self._phase = _Phase.HOLD

    def reset(self) -> None:
        """Clear the latch; the hold stays."""
        self._reason = None

    def resume(self) -> None:
        """Follow control again; nothing while latched."""
        if self._reason is None and self._phase is _Phase.HOLD:
            self._phase, self._follower, self._resumed_s = _Phase.RESUME, None, 0.0

    def step(self, target: JointTarget) -> JointTarget:
        """Return what the robot gets instead of ``target``, one control period (10 ms) later than the last."""
        q = self._next(target.q_rad)
        self._dq_rad_s = np.zeros_like(q) if self._q_rad is None else (q - self._q_rad) / STEP_S
        self._q_rad = q
        return JointTarget(target.t_ns, q)

    def _next(self, asked_rad: Float) -> Float:
        if self._phase is _Phase.FOLLOW or self._q_rad is None or self._dq_rad_s is None:
            return asked_rad
        if self._phase is _Phase.HOLD:
            return self._brake(self._q_rad, self._dq_rad_s)
        return self._blend(self._q_rad, asked_rad)

    def _brake(self, q_rad: Float, dq_rad_s: Float) -> Float:
        """Take as much rate off each joint as its acceleration limit allows, then stay."""
        speed = np.maximum(np.abs(dq_rad_s) - self._limits.acceleration_rad_s2 * STEP_S, 0.0)
        held = q_rad + np.sign(dq_rad_s) * speed * STEP_S
        return np.clip(held, -self._limits.position_rad, self._limits.position_rad)

    def _blend(self, q_rad: Float, asked_rad: Float) -> Float:
        """Let the difference between the held and the asked posture fade over RESUME_S, within the limits."""
        if self._follower is None or self._offset_rad is None:
            self._offset_rad, self._follower = q_rad - asked_rad, LimitedFollower(self._limits, q_rad)
        self._resumed_s += STEP_S
        s = min(self._resumed_s / RESUME_S, 1.0)
        q = self._follower.step(asked_rad + self._offset_rad * (1.0 - s * s * (3.0 - 2.0 * s)), STEP_S)
        if s >= 1.0 and np.allclose(q, asked_rad, rtol=0.0, atol=ARRIVED_RAD):
            self._phase = _Phase.FOLLOW
        return q


class GuardedBackend:
    """A backend behind its guard."""

    def __init__(self, backend: Backend, guard: Guard) -> None:
        self._backend = backend
        self._guard = guard

    @property
    def rig(self) -> SensorRig:
        """The sensors' calibration."""
        return self._backend.rig

    @property
    def model(self) -> SnakeModel | None:
        """The robot."""
        return self._backend.model

    @property
    def t_ns(self) -> int:
        """Time reached so far."""
        return self._backend.t_ns

    def step(self, target: JointTarget | None) -> Sequence[Packet] | None:
        """Advance one control period with the target that the guard lets through."""
        return self._backend.step(None if target is None else self._guard.step(target))

    def take_ground_truth(self) -> Sequence[GroundTruth]:
        """Return the truth since the last call."""
        return self._backend.take_ground_truth()

    def close(self) -> None:
        """Release the backend."""
        self._backend.close()
