"""Where in its period a gait is, told from the joint rates alone: two numbers that turn like cosine and sine."""

import numpy as np

from snakeslam.messages import Float

STILL_RAD_S = 0.03
"""Rates below this (rms) show nothing."""
ALIKE = 0.5
"""Rates of which the two directions show less than this part are those of another gait."""
QUARTER = 0.2
"""Two directions this close to a right angle are a quarter of the period apart."""
GROWN = 1.5
"""Rates this much larger than those that showed the directions are the gait's proper ones: those were of its start."""
UPRIGHT = float(np.cos(np.deg2rad(30.0)))
"""A head whose upward direction turns further rolls with the body, and no part of its period is like another."""
FORGET = 10
"""So many frames of another gait, and the directions are taken anew."""


class GaitWave:
    """Two directions in the space of joint rates, a quarter of the gait's period apart, and the rates along them.

    The joints of a periodic gait dq(t) = a cos(phi) + b sin(phi) show a and b themselves: the rates as they were at one
    time, and as they were when next they stood at a right angle to those. Along them later rates are cos(phi) and
    sin(phi), and they shrink as the gait is slowed down.
    """

    def __init__(self) -> None:
        self._axes: list[Float] = []
        self._up_I: Float = np.zeros(3)
        self._unlike = 0

    @property
    def complete(self) -> bool:
        """Whether both directions are known."""
        return len(self._axes) == 2

    def see(self, dq_rad_s: Float, up_I: Float) -> tuple[Float, bool]:
        """Take joint rates (N,); return them along the two directions, (2,), and whether these have just been taken.

        (0, 0) as long as they are not known, and while the upward direction ``up_I`` (3,) of the head turns.
        """
        moving = float(np.sqrt(np.mean(dq_rad_s**2))) > STILL_RAD_S
        if float(self._up_I @ up_I) < UPRIGHT:
            self._axes, self._up_I = [], up_I
        if not self.complete:
            fresh = moving and self._take(dq_rad_s)
            return (np.array([0.0, 1.0]) if fresh else np.zeros(2)), fresh
        a, b = self._axes
        along = np.array([a @ dq_rad_s / (a @ a), b @ dq_rad_s / (b @ b)])
        shown = float(np.linalg.norm(along[0] * a + along[1] * b) / max(1e-9, np.linalg.norm(dq_rad_s)))
        self._unlike = self._unlike + 1 if moving and shown < ALIKE else 0
        if self._unlike > FORGET or np.linalg.norm(along) > GROWN:
            self._axes, self._unlike = [], 0
        return along, False

    def _take(self, dq_rad_s: Float) -> bool:
        """Take a first direction, then one at a right angle to it."""
        if not self._axes:
            self._axes.append(dq_rad_s)
            return False
        a = self._axes[0]
        if abs(a @ dq_rad_s) > QUARTER * np.linalg.norm(a) * np.linalg.norm(dq_rad_s):
            return False
        self._axes.append(dq_rad_s - a * (a @ dq_rad_s) / (a @ a))
        return True
