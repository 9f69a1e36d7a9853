"""Motion without steps: start, stop, drive, turn, change of parameters and of gait.

The angles are q = g(sigma) + e: the gait's own at its phase, and what is left of the last change. A change moves the
difference of the two gaits into e, which then decays like a critically damped spring, so neither the angles nor their
rates ever jump. One signed pace in [-1, 1] scales all time: at 0 the robot holds whatever shape it is in.
"""

import numpy as np

from snakeslam.gaits.catalogue import ResolvedGait
from snakeslam.gaits.posture import posed_angles
from snakeslam.messages import Float
from snakeslam.robot.model import SnakeModel

PACE_RAMP_S = 0.4
"""From full speed to a hold, and back."""
DECAY_RAD_S = 2.5
"""Rate of the spring that takes up a change."""
FORMED_RAD = 0.05
"""A rolling gait waits until its arc lies flat to within this, or the arc would stand up and be thrown."""
WHOLE_TURN = 2.0 * np.pi


class GaitBlend:
    """Plays one gait after another from the angles ``q_rad`` (N,) of a robot that lies upright and still."""

    def __init__(self, model: SnakeModel, gait: ResolvedGait, q_rad: Float) -> None:
        self._model = model
        self._gait, self._next = gait, gait
        self._sigma = gait.start_sigma
        self._pace = 0.0
        self._phase_pace = 0.0 if gait.rolls else 1.0
        self._left = np.asarray(q_rad, dtype=np.float64) - posed_angles(gait, model, self._sigma)[0]
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

    def set_gait(self, gait: ResolvedGait) -> None:
        """Change to ``gait``: at once, or when a rolling body is upright again."""
        self._next = gait
        if gait.name == self._gait.name or not self._gait.rolls or self._upright():
            self._change()

    def step(self, drive: float, dt_s: float) -> Float:
        """Advance by ``dt_s`` with ``drive`` in [-1, 1] and return the angles, (N,) rad."""
        if self._came_upright and self._next is not self._gait:
            self._change()
        largest = dt_s / PACE_RAMP_S
        self._pace += float(np.clip(np.clip(drive, -1.0, 1.0) - self._pace, -largest, largest))
        self._advance_phase(dt_s)
        self._decay(abs(self._pace) * dt_s)
        return posed_angles(self._gait, self._model, self._sigma)[0] + self._left

    def _advance_phase(self, dt_s: float) -> None:
        if self._phase_pace < 1.0 and np.max(np.abs(self._left)) < FORMED_RAD:
            self._phase_pace = min(1.0, self._phase_pace + abs(self._pace) * dt_s / PACE_RAMP_S)
        before = self._turns()
        self._sigma += self._pace * self._phase_pace * self._gait.omega * dt_s
        self._came_upright = bool(np.floor(before) != np.floor(self._turns()))

    def _decay(self, dt_s: float) -> None:
        """Advance e'' = -2 w e' - w^2 e exactly."""
        w = DECAY_RAD_S
        rate = self._left_rate + w * self._left
        fade = np.exp(-w * dt_s)
        self._left = (self._left + rate * dt_s) * fade
        self._left_rate = rate * fade - w * self._left

    def _turns(self) -> float:
        """Whole turns that the gait's body has rolled since it was upright."""
        return (self._sigma - self._gait.start_sigma) / WHOLE_TURN

    def _upright(self) -> bool:
        turns = self._turns()
        return abs(turns - round(turns)) < 1e-6

    def _change(self) -> None:
        """Swap the gaits and keep the angles and the rates (per unit of paced time) as they are."""
        old, new = self._gait, self._next
        q_old, rate_old = self._angles_and_rates()
        if new.name != old.name:
            self._sigma = new.start_sigma
            self._phase_pace = 0.0 if new.rolls else 1.0
        self._gait = new
        q_new, rate_new = self._angles_and_rates()
        self._left = self._left + q_old - q_new
        self._left_rate = self._left_rate + rate_old - rate_new

    def _angles_and_rates(self) -> tuple[Float, Float]:
        q_rad, slope = posed_angles(self._gait, self._model, self._sigma)
        return q_rad, slope * self._gait.omega * self._phase_pace * float(np.sign(self._pace))
