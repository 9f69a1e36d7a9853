"""The time by which the robot judges how old a message is: its own, which in a simulator is the simulated one."""

from bisect import bisect_right
from collections import deque

from snakeslam.runtime.robot.safety import FROZEN_NS

WINDOW = 1000
"""Control periods that are remembered, 10 s of the robot's time."""


class RobotTime:
    """Turns stamps of the node's clock into the robot's time; pure.

    On a machine that is too slow for the simulator everything is late by the clock, the simulated robot too: it has not
    got any further meanwhile. A real robot's time is the node's clock. Where the node itself stood still for longer
    than FROZEN_NS that time counts in full.
    """

    def __init__(self, *, simulated: bool) -> None:
        self._simulated = simulated
        self._turned_ns: int | None = None
        self._skipped_ns = 0
        self._clock_ns: deque[int] = deque(maxlen=WINDOW)
        self._t_ns: deque[int] = deque(maxlen=WINDOW)

    def turn(self, clock_ns: int, t_ns: int) -> None:
        """Tell that the node gets on, and that the robot has reached ``t_ns`` at ``clock_ns`` of the node's clock."""
        if self._turned_ns is not None and clock_ns - self._turned_ns > FROZEN_NS:
            self._skipped_ns += clock_ns - self._turned_ns
        self._turned_ns = clock_ns
        t_ns += self._skipped_ns
        if not self._t_ns or t_ns > self._t_ns[-1]:
            self._clock_ns.append(clock_ns)
            self._t_ns.append(t_ns)

    def at(self, clock_ns: int) -> int:
        """Return the robot's time at ``clock_ns``; before and after what is known the clock's pace is taken."""
        if not self._simulated or not self._clock_ns:
            return clock_ns
        k = bisect_right(self._clock_ns, clock_ns)
        if k == 0:
            return self._t_ns[0] - (self._clock_ns[0] - clock_ns)
        return self._t_ns[k - 1]

    def of_stamp(self, stamp_ns: int, clock_ns: int) -> int:
        """Return the robot's time of a sender's stamp, told at ``clock_ns``; the future stays as far ahead as it is."""
        return self.at(min(stamp_ns, clock_ns)) + max(stamp_ns - clock_ns, 0)
