"""The robot's clock as another process reads it, over any link, with no clocks in step."""

from collections import deque
from collections.abc import Callable
from time import monotonic_ns

WINDOW_NS = 10_000_000_000


class RobotClock:
    """Reads the robot's clock off its stamps: what came fastest in the last 10 s tells the offset best.

    The reading is behind the robot's by the fastest way of a message, never ahead: a command's age, as the robot sees
    it, counts its way in both directions. Pure but for the local clock that is given to it.
    """

    def __init__(self, local_ns: Callable[[], int] = monotonic_ns) -> None:
        self._local_ns = local_ns
        self._heard: deque[tuple[int, int]] = deque()

    def hear(self, stamp_ns: int) -> None:
        """Take a stamp that has just come from the robot."""
        now_ns = self._local_ns()
        offset_ns = stamp_ns - now_ns
        # Only what may yet be the best of the window is kept: offsets fall from the front to the back.
        while self._heard and self._heard[-1][1] <= offset_ns:
            self._heard.pop()
        self._heard.append((now_ns, offset_ns))
        while now_ns - self._heard[0][0] > WINDOW_NS:
            self._heard.popleft()

    def restart(self) -> None:
        """Forget a robot node that was; the next one's clock may be another machine's."""
        self._heard.clear()

    def now_ns(self) -> int | None:
        """Return the robot's time now; None while nothing was heard of it."""
        return None if not self._heard else self._local_ns() + self._heard[0][1]
