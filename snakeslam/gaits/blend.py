"""Motion without steps: start, stop, drive, steering, change of parameters and of gait.

The angles are q = g(sigma) + e: those of the gait at its phase, and a remainder e of the last change. A change adds the
difference of the two gaits to e, which then decays like a critically damped spring, so that neither the angles nor
their rates jump. One signed pace in [-1, 1] scales time: at 0 the robot keeps the shape that it has.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from snakeslam.gaits.gait import ResolvedGait
from snakeslam.gaits.posture import posed_angles
from snakeslam.messages import Float
from snakeslam.robot.model import SnakeModel

PACE_RAMP_S = 0.4
"""From full speed to a hold, and back."""
DECAY_RAD_S = 2.5
"""Rate at which the remainder of a change decays."""
FORMED_RAD = 0.05
"""A rolling gait waits until its arc lies flat to within this, or the arc would stand up and be thrown."""
LEAST_PACE = 0.05
"""Below this pace a joint rate does not determine the rate per unit of paced time."""
REVOLUTION_RAD = 2.0 * np.pi


class Shape(Protocol):
    """The joint angles of a gait at a phase."""

    def angles(self, gait: ResolvedGait, sigma: float) -> Float:
        """Return the angles, (N,) rad."""
        ...

    def __call__(self, gait: ResolvedGait, sigma: float) -> tuple[Float, Float]:
        """Return the angles and their slope d/d(sigma), each (N,)."""
        ...


class GaitBlend:
    """Plays one gait after another from the angles ``q_rad`` (N,) of a robot that lies upright and still.

    ``shape`` gives the angles of a gait, with a closed form of head control or, by default, with the posture alone.
    """

    def __init__(self, model: SnakeModel, gait: ResolvedGait, q_rad: Float, shape: Shape | None = None) -> None:
        self._shape: Shape = shape or PlainShape(model)
        self._gait, self._next = gait, gait
        self._sigma = gait.start_sigma
        self._pace = 0.0
        self._phase_pace = 0.0 if gait.rolls else 1.0
        self._left = np.asarray(q_rad, dtype=np.float64) - self._shape.angles(gait, self._sigma)
        self._left_rate = np.zeros(model.joint_count)
        self._came_upright = False

    @property
    def gait(self) -> ResolvedGait:
        """The gait being played; a newer one may be waiting for a rolling body to come upright."""
        return self._gait

    @property
    def sigma(self) -> float:
        """Phase of the gait (rad)."""
        return self._sigma

    @property
    def pace(self) -> float:
        """Present speed of time in [-1, 1]."""
        return self._pace

    @property
    def roll_rad(self) -> float | None:
        """Angle by which the gait has rolled the body since it was upright; None where it does not roll."""
        return self._sigma - self._gait.start_sigma if self._gait.rolls else None

    def set_gait(self, gait: ResolvedGait) -> None:
        """Change to ``gait``: at once, or when a rolling body is upright again."""
        self._next = gait
        if gait.name == self._gait.name or not self._gait.rolls or self._upright():
            self._change()

    def set_shape(self, shape: Shape) -> None:
        """Change the shape; the angles continue from their present values."""
        before = self._angles_and_rates()
        self._shape = shape
        self._keep(before)

    def resume_from(self, q_rad: Float, dq_rad_s: Float) -> None:
        """Continue from these angles (N,) rad and rates (N,) rad/s, which feedback has given to the joints."""
        q_gait, rate_gait = self._angles_and_rates()
        self._left = q_rad - q_gait
        pace = abs(self._pace)
        self._left_rate = dq_rad_s / pace - rate_gait if pace > LEAST_PACE else np.zeros_like(q_rad)

    def step(self, drive: float, dt_s: float) -> Float:
        """Advance by ``dt_s`` with ``drive`` in [-1, 1] and return the angles, (N,) rad."""
        if self._came_upright and self._next is not self._gait:
            self._change()
        largest = dt_s / PACE_RAMP_S
        self._pace += float(np.clip(np.clip(drive, -1.0, 1.0) - self._pace, -largest, largest))
        self._advance_phase(dt_s)
        self._decay(abs(self._pace) * dt_s)
        return self._shape.angles(self._gait, self._sigma) + self._left

    def _advance_phase(self, dt_s: float) -> None:
        if self._phase_pace < 1.0 and np.max(np.abs(self._left)) < FORMED_RAD:
            self._phase_pace = min(1.0, self._phase_pace + abs(self._pace) * dt_s / PACE_RAMP_S)
        before = self._revolutions()
        self._sigma += self._pace * self._phase_pace * self._gait.omega * dt_s
        self._came_upright = bool(np.floor(before) != np.floor(self._revolutions()))

    def _decay(self, dt_s: float) -> None:
        """Advance e'' = -2 w e' - w^2 e exactly."""
        w = DECAY_RAD_S
        rate = self._left_rate + w * self._left
        fade = np.exp(-w * dt_s)
        self._left = (self._left + rate * dt_s) * fade
        self._left_rate = rate * fade - w * self._left

    def _revolutions(self) -> float:
        """Revolutions that the gait has rolled the body since it was upright."""
        return (self._sigma - self._gait.start_sigma) / REVOLUTION_RAD

    def _upright(self) -> bool:
        revolutions = self._revolutions()
        return abs(revolutions - round(revolutions)) < 1e-6

    def _change(self) -> None:
        """Swap the gaits and keep the angles and the rates (per unit of paced time) as they are."""
        old, new = self._gait, self._next
        before = self._angles_and_rates()
        if new.name != old.name:
            self._sigma = new.start_sigma
            self._phase_pace = 0.0 if new.rolls else 1.0
        self._gait = new
        self._keep(before)

    def _keep(self, before: tuple[Float, Float]) -> None:
        """Add to e the difference between the gait's angles and rates ``before`` and now."""
        q_rad, rate = self._angles_and_rates()
        self._left = self._left + before[0] - q_rad
        self._left_rate = self._left_rate + before[1] - rate

    def _angles_and_rates(self) -> tuple[Float, Float]:
        q_rad, slope = self._shape(self._gait, self._sigma)
        return q_rad, slope * self._gait.omega * self._phase_pace * float(np.sign(self._pace))


@dataclass(frozen=True, slots=True)
class PlainShape:
    """The gaits' own angles, with the head posture of the model."""

    model: SnakeModel

    def angles(self, gait: ResolvedGait, sigma: float) -> Float:
        """Return the angles, (N,) rad."""
        return posed_angles(gait, self.model, sigma)[0]

    def __call__(self, gait: ResolvedGait, sigma: float) -> tuple[Float, Float]:
        """Return the angles and their slope d/d(sigma), each (N,)."""
        return posed_angles(gait, self.model, sigma)
