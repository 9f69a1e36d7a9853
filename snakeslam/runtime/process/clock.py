"""The robot's clock as another process reads it, over any link, although no two clocks are synchronised."""

from collections import deque
from collections.abc import Callable
from time import monotonic_ns

WINDOW_NS = 10_000_000_000


class RobotClock:
    """Reads the robot's clock off the stamps of its messages: the fastest message of the last 10 s gives the offset.

    The reading is behind the robot's clock by the delay of that message and never ahead, so the age of a command, as
    the robot sees it, includes the delay in both directions. Pure but for the local clock that is given to it.
    """

    def __init__(self, local_ns: Callable[[], int] = monotonic_ns) -> None:
        self._local_ns = local_ns
        self._offsets_ns: deque[tuple[int, int]] = deque()

    def add(self, stamp_ns: int) -> None:
        """Add the stamp of a message that has just arrived from the robot."""
        now_ns = self._local_ns()
        offset_ns = stamp_ns - now_ns
        # Only what may yet be the best of the window is kept: offsets fall from the front to the back.
        while self._offsets_ns and self._offsets_ns[-1][1] <= offset_ns:
            self._offsets_ns.pop()
        self._offsets_ns.append((now_ns, offset_ns))
        while now_ns - self._offsets_ns[0][0] > WINDOW_NS:
            self._offsets_ns.popleft()

    def restart(self) -> None:
        """Forget all stamps: another robot node may run on another machine, with another clock."""
        self._offsets_ns.clear()

    def now_ns(self) -> int | None:
        """Return the robot's time now; None before the first stamp."""
        return None if not self._offsets_ns else self._local_ns() + self._offsets_ns[0][1]
