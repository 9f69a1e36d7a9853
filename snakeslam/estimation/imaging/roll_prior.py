"""The roll that a rolling gait gives the head, predicted by control: the front-end's prior where there is no gyro."""

from collections import deque

import numpy as np

from snakeslam.geometry import so3
from snakeslam.messages import Float

MEMORY_NS = 1_000_000_000
"""Predictions older than this are dropped; the front-end asks only for the time since the last frame."""


class RollPrior:
    """The head's roll about its optical axis over the last second, as control predicted it."""

    def __init__(self) -> None:
        self._predicted: deque[tuple[int, float]] = deque()

    def add(self, t_ns: int, roll_rad: float | None) -> None:
        """Add the predicted roll at ``t_ns``; None while the gait does not roll, which clears the history."""
        if roll_rad is None:
            self._predicted.clear()
            return
        self._predicted.append((t_ns, roll_rad))
        while t_ns - self._predicted[0][0] > MEMORY_NS:
            self._predicted.popleft()

    def between(self, from_ns: int, to_ns: int) -> float | None:
        """Return the predicted roll from one time to another, in rad; None where there is no prediction."""
        if len(self._predicted) < 2 or not self._predicted[0][0] <= from_ns < to_ns:
            return None
        times, rolls = zip(*self._predicted, strict=True)
        return float(np.interp(to_ns, times, rolls) - np.interp(from_ns, times, rolls))


def with_roll(R_C0C1: Float, roll_rad: float) -> Float:
    """Return Exp((w_x, w_y, roll)) for R_C0C1 = Exp(w): the rotation with its roll about the optical axis replaced."""
    w = so3.log(R_C0C1)
    return so3.exp(np.array([w[0], w[1], roll_rad]))
