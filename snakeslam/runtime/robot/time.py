"""The robot's time, by which the age of every message is judged: a real robot's clock, or a simulator's time."""

from bisect import bisect_right
from collections import deque

from snakeslam.runtime.robot.safety import FROZEN_NS

WINDOW = 1000
"""Control periods that are remembered, 10 s of the robot's time."""


class RobotTime:
    """Converts stamps of the node's clock into the robot's time; pure.

    A real robot's time is the clock of its node. A simulator that is slower than real time moves its robot less by the
    clock, so ages are judged in simulated time. Where the node itself stood still for longer than ``FROZEN_NS``, that
    time counts in full.
    """

    def __init__(self, *, simulated: bool) -> None:
        self._simulated = simulated
        self._iteration_ns: int | None = None
        self._frozen_ns = 0
        self._clock_ns: deque[int] = deque(maxlen=WINDOW)
        self._t_ns: deque[int] = deque(maxlen=WINDOW)

    def add(self, clock_ns: int, t_ns: int) -> None:
        """Add an iteration of the node's loop at ``clock_ns`` of its clock, at which the backend's time is ``t_ns``."""
        if self._iteration_ns is not None and clock_ns - self._iteration_ns > FROZEN_NS:
            self._frozen_ns += clock_ns - self._iteration_ns
        self._iteration_ns = clock_ns
        t_ns += self._frozen_ns
        if not self._t_ns or t_ns > self._t_ns[-1]:
            self._clock_ns.append(clock_ns)
            self._t_ns.append(t_ns)

    def at(self, clock_ns: int) -> int:
        """Return the robot's time at ``clock_ns``; before the first iteration kept, the rate of the clock is taken."""
        if not self._simulated or not self._clock_ns:
            return clock_ns
        k = bisect_right(self._clock_ns, clock_ns)
        if k == 0:
            return self._t_ns[0] - (self._clock_ns[0] - clock_ns)
        return self._t_ns[k - 1]

    def of_stamp(self, stamp_ns: int, clock_ns: int) -> int:
        """Return the robot's time of a stamp that arrived at ``clock_ns``; a future stamp stays as far ahead."""
        return self.at(min(stamp_ns, clock_ns)) + max(stamp_ns - clock_ns, 0)
