"""A limit on how often one kind of event is logged: a thousand a second must not fill the disk."""

from collections.abc import Callable
from time import monotonic

PERIOD_S = 5.0
KINDS_KEPT = 256


class LogLimit:
    """Admits one line of each kind every ``period_s`` and counts the lines that are left out between them."""

    def __init__(self, period_s: float = PERIOD_S, clock: Callable[[], float] = monotonic) -> None:
        self._period_s, self._clock = period_s, clock
        self._kinds: dict[str, tuple[float, int]] = {}

    def due(self, kind: str) -> int | None:
        """Return how many lines of ``kind`` were left out since the last one; None to leave this one out too."""
        now_s = self._clock()
        last_s, left_out = self._kinds.get(kind, (-float("inf"), 0))
        if now_s - last_s < self._period_s:
            self._kinds[kind] = (last_s, left_out + 1)
            return None
        if kind not in self._kinds and len(self._kinds) >= KINDS_KEPT:
            del self._kinds[next(iter(self._kinds))]
        self._kinds[kind] = (now_s, 0)
        return left_out


def error_words(error: BaseException) -> str:
    """Return an error, with its type, as one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())
