"""The paths of the live session: bounded, and ready to be sent."""

import json
import math
from dataclasses import dataclass, field

import numpy as np

from snakeslam.messages import Float

MAX_PATH = 20_000
STATIONARY_M = 5e-4
"""A robot whose head moves less between two rows of its path is stationary."""


@dataclass(slots=True)
class TimedPath:
    """Positions over time: rows of (t_s, x, y, z), thinned when too many, first where the robot is stationary."""

    rows: list[tuple[float, float, float, float]] = field(default_factory=list)
    _texts: list[str] = field(default_factory=list)
    _every: int = 1
    _count: int = 0
    _newest_s: float = -math.inf

    def add(self, t_s: float, T_WI: Float) -> None:
        """Append a position if it is newer than those that are known, and not left out by the thinning."""
        if t_s <= self._newest_s:
            return  # A part of a recording that is played again.
        self._newest_s = t_s
        self._count += 1
        if self._count % self._every:
            return
        x, y, z = T_WI[:3, 3].tolist()
        self.rows.append((round(t_s, 4), x, y, z))
        self._texts.append(json.dumps(self.rows[-1], separators=(",", ":")))
        if len(self.rows) > MAX_PATH:
            self._thin()

    def _thin(self) -> None:
        """Drop every second row of a stationary robot; of all rows where most of them are in motion."""
        steps_m = np.linalg.norm(np.diff([row[1:] for row in self.rows], axis=0), axis=1)
        stationary = np.r_[steps_m < STATIONARY_M, False] & np.r_[False, steps_m < STATIONARY_M]
        if MAX_PATH // 4 < stationary.sum() < len(self.rows) - 2:
            kept = ~(stationary & (stationary.cumsum() % 2 == 0))
        else:
            kept = np.arange(len(self.rows)) % 2 == 0
            self._every *= 2
        self.rows = [self.rows[k] for k in np.flatnonzero(kept)]
        self._texts = [self._texts[k] for k in np.flatnonzero(kept)]

    def text(self) -> str:
        """The rows as JSON, without the brackets around them; each was written when it came."""
        return ",".join(self._texts)
