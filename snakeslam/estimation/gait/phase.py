"""The phase of a gait in its period, from the joint rates alone: two numbers that rotate like cosine and sine."""

import numpy as np

from snakeslam.messages import Float

STATIONARY_RAD_S = 0.03
"""Joint rates (RMS) below this contain no phase; servos report rates in steps of 0.024 rad/s."""
MIN_SHARE = 0.5
"""Rates of which less than this share lies in the plane of the two directions belong to another gait."""
MAX_COSINE = 0.2
"""Largest cosine between two directions that are taken to be a quarter of the period apart."""
MAX_GROWTH = 1.5
"""Rates so many times the directions are those of the full gait, and the directions were found while it started."""
MAX_TILT_COS = float(np.cos(np.deg2rad(30.0)))
"""A head whose upward direction rotates further than 30 deg rolls with the body: then the period has no symmetry."""
PATIENCE_FRAMES = 10
"""After so many frames of another gait its directions are determined anew."""


class GaitPhase:
    """Two directions in the space of joint rates, a quarter of the gait's period apart, and the phase along them.

    The joint rates of a periodic gait are dq(t) = a cos(phi) + b sin(phi). The directions a and b are found in the
    rates themselves: the rates at one time, and those at the first later time at which they are orthogonal to them.
    The components of later rates along a and b are cos(phi) and sin(phi), and they shrink when the gait is slowed
    down.
    """

    def __init__(self) -> None:
        self._axes: list[Float] = []
        self._up_I: Float = np.zeros(3)
        self._frames_unlike = 0

    @property
    def complete(self) -> bool:
        """Whether both directions are known."""
        return len(self._axes) == 2

    def update(self, dq_rad_s: Float, up_I: Float) -> tuple[Float, bool]:
        """Add joint rates (N,); return their (cos, sin) along the directions, and whether these have just been found.

        The result is (0, 0) while the directions are not known, and while the head rolls, which its upward direction
        ``up_I`` (3,) shows.
        """
        moving = float(np.sqrt(np.mean(dq_rad_s**2))) > STATIONARY_RAD_S
        if float(self._up_I @ up_I) < MAX_TILT_COS:
            self._axes, self._up_I = [], up_I
        if not self.complete:
            found = moving and self._add_direction(dq_rad_s)
            return (np.array([0.0, 1.0]) if found else np.zeros(2)), found
        a, b = self._axes
        along = np.array([a @ dq_rad_s / (a @ a), b @ dq_rad_s / (b @ b)])
        share = float(np.linalg.norm(along[0] * a + along[1] * b) / max(1e-9, np.linalg.norm(dq_rad_s)))
        self._frames_unlike = self._frames_unlike + 1 if moving and share < MIN_SHARE else 0
        if self._frames_unlike > PATIENCE_FRAMES or np.linalg.norm(along) > MAX_GROWTH:
            self._axes, self._frames_unlike = [], 0
        return along, False

    def _add_direction(self, dq_rad_s: Float) -> bool:
        """Use rates as the first direction, or as the second if orthogonal to it; return True for the second."""

        if not self._axes:
            self._axes.append(dq_rad_s)
            return False
        a = self._axes[0]
        if abs(a @ dq_rad_s) > MAX_COSINE * np.linalg.norm(a) * np.linalg.norm(dq_rad_s):
            return False
        self._axes.append(dq_rad_s - a * (a @ dq_rad_s) / (a @ a))
        return True
