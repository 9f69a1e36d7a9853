"""The roll that a rolling gait gives the head, foreseen by control: a prior for the front-end where no gyro tells."""

from collections import deque

import numpy as np

from snakeslam.geometry import so3
from snakeslam.messages import Float

MEMORY_NS = 1_000_000_000


class RollPrior:
    """Keeps what control foresaw over the last second."""

    def __init__(self) -> None:
        self._foreseen: deque[tuple[int, float]] = deque()

    def add(self, t_ns: int, roll_rad: float | None) -> None:
        """Take the head's roll about its view at ``t_ns``; None while the gait does not roll."""
        if roll_rad is None:
            self._foreseen.clear()
            return
        self._foreseen.append((t_ns, roll_rad))
        while t_ns - self._foreseen[0][0] > MEMORY_NS:
            self._foreseen.popleft()

    def between(self, from_ns: int, to_ns: int) -> float | None:
        """Return how far the head rolls between two times, in rad; None where that was not foreseen."""
        if len(self._foreseen) < 2 or not self._foreseen[0][0] <= from_ns < to_ns:
            return None
        times, rolls = zip(*self._foreseen, strict=True)
        return float(np.interp(to_ns, times, rolls) - np.interp(from_ns, times, rolls))


def with_roll(R_C0C1: Float, roll_rad: float) -> Float:
    """Return the rotation with its turn about the view (z of the camera) replaced, (3, 3)."""
    turn = so3.log(R_C0C1)
    return so3.exp(np.array([turn[0], turn[1], roll_rad]))
