"""Keeps the backend's time in step with the wall clock, as far as the machine is fast enough."""

from collections import deque
from collections.abc import Callable
from time import monotonic

NS = 1e-9


class Pacer:
    """Computes how long to wait for real time; a delay up to ``slack_s`` is caught up, a longer one is given up."""

    def __init__(self, clock: Callable[[], float] = monotonic, slack_s: float = 0.5, window_s: float = 3.0) -> None:
        self._clock = clock
        self._slack_s = slack_s
        self._window_s = window_s
        self._zero_s: float | None = None
        self._history: deque[tuple[float, float]] = deque()

    def wait_s(self, t_ns: int) -> float:
        """Return the seconds until the wall clock reaches the backend's time ``t_ns``; 0 when that is past."""
        now, t_s = self._clock(), t_ns * NS
        if self._zero_s is None or now - self._zero_s - t_s > self._slack_s:
            self._zero_s = now - t_s
        self._note(now, t_s)
        return max(0.0, self._zero_s + t_s - now)

    @property
    def realtime_factor(self) -> float | None:
        """Backend time over wall time in the last ``window_s``; None in the first half second."""
        if len(self._history) < 2:
            return None
        (wall_0, t_0), (wall_1, t_1) = self._history[0], self._history[-1]
        return (t_1 - t_0) / (wall_1 - wall_0) if wall_1 - wall_0 > 0.5 else None

    def _note(self, now: float, t_s: float) -> None:
        if not self._history or now - self._history[-1][0] >= 0.05:
            self._history.append((now, t_s))
        while now - self._history[0][0] > self._window_s:
            self._history.popleft()
