"""The last word on every joint target: finite, within the joints' limits, and at rest whenever it has to be."""

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
NOT_FINITE = "control gave a target that is no number"


class _Phase(Enum):
    FOLLOW = auto()
    HOLD = auto()
    RESUME = auto()


class Guard:
    """Follows control within the limits of position, rate and acceleration; a hold brakes every joint at its limit.

    An E-stop (``latch``) and a hold differ in one thing: after a hold ``resume`` moves again, after an E-stop only once
    ``reset`` has cleared it, which itself never moves anything. Resuming goes smoothly from the held posture to what
    control asks for.
    """

    def __init__(self, limits: JointLimits, reason: str | None = None) -> None:
        self._limits = limits
        self._reason = reason
        self._held_because = reason
        self._phase = _Phase.FOLLOW if reason is None else _Phase.HOLD
        self._follower: LimitedFollower | None = None
        self._offset_rad: Float | None = None
        self._resumed_s = 0.0

    @property
    def reason(self) -> str | None:
        """Why the E-stop is latched; None when it is not."""
        return self._reason

    @property
    def held_because(self) -> str | None:
        """Why the robot is held, until it is told to resume; None when it is not."""
        return self._held_because

    @property
    def q_rad(self) -> Float | None:
        """The last target let through, (N,)."""
        return None if self._follower is None else self._follower.q_rad

    def start_at(self, q_rad: Float) -> None:
        """Tell the measured angles (N,) before the first step, from which targets are then approached."""
        if self._follower is None and q_rad.ndim == 1 and np.all(np.isfinite(q_rad)):
            self._follower = LimitedFollower(self._limits, q_rad)

    def latch(self, reason: str) -> None:
        """E-stop: stop and hold; the first reason stays."""
        self._reason = self._reason or reason or "E-stop"
        self.hold(self._reason)

    def hold(self, reason: str) -> None:
        """Ramp to a hold and stay; the first reason stays."""
        self._held_because = self._held_because or reason
        self._phase = _Phase.HOLD

    def reset(self) -> None:
        """Clear the E-stop; the hold stays."""
        self._reason = None

    def resume(self) -> None:
        """Follow control again; nothing while the E-stop is latched."""
        if self._reason is None and self._phase is _Phase.HOLD:
            self._phase, self._held_because = _Phase.RESUME, None
            self._offset_rad, self._resumed_s = None, 0.0

    def step(self, target: JointTarget) -> JointTarget:
        """Return what the robot gets instead of ``target``, one control period (10 ms) later than the last."""
        asked_rad = target.q_rad
        if not np.all(np.isfinite(asked_rad)) or not self._fits(asked_rad):
            self.hold(NOT_FINITE)
            asked_rad = np.zeros_like(asked_rad) if self._follower is None else self._follower.q_rad
        if self._follower is None:
            self._follower = LimitedFollower(self._limits, asked_rad)
        return JointTarget(target.t_ns, self._next(self._follower, asked_rad), target.head_roll_rad)

    def _fits(self, asked_rad: Float) -> bool:
        """Whether there is an angle for each joint: the compiled follower would read beyond a shorter array."""
        return self._follower is None or asked_rad.shape == self._follower.q_rad.shape

    def brake(self, t_ns: int) -> JointTarget | None:
        """Return the next target of a hold, for when control has none; None before the first measured angles."""
        if self._follower is None:
            return None
        return JointTarget(t_ns, self._follower.brake(STEP_S))

    def _next(self, follower: LimitedFollower, asked_rad: Float) -> Float:
        if self._phase is _Phase.HOLD:
            return follower.brake(STEP_S)
        if self._phase is _Phase.RESUME:
            return self._blend(follower, asked_rad)
        return follower.step(asked_rad, STEP_S)

    def _blend(self, follower: LimitedFollower, asked_rad: Float) -> Float:
        """Let the difference between the held and the asked posture fade over RESUME_S."""
        if self._offset_rad is None:
            self._offset_rad = follower.q_rad - asked_rad
        self._resumed_s += STEP_S
        s = min(self._resumed_s / RESUME_S, 1.0)
        q = follower.step(asked_rad + self._offset_rad * (1.0 - s * s * (3.0 - 2.0 * s)), STEP_S)
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
