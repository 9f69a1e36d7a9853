"""How many requests a caller may make: a bucket of tokens each, filled at a steady rate."""

from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic

MAX_CALLERS = 1024


@dataclass(frozen=True, slots=True)
class Rate:
    """So many at once, and so many a second for ever."""

    burst: float
    per_s: float


@dataclass(frozen=True, slots=True)
class Rates:
    """What the server allows each caller; the E-stop is never limited, only answered late when pressed more often."""

    read: Rate = Rate(300.0, 100.0)
    viewers: Rate = Rate(600.0, 200.0)
    """All requests of viewers together."""
    estop: Rate = Rate(30.0, 10.0)
    write: Rate = Rate(60.0, 30.0)
    sign_in: Rate = Rate(10.0, 0.5)
    teleop: Rate = Rate(300.0, 60.0)
    """What waited in the socket while the server was frozen for some seconds must not disconnect the operator."""


DEFAULT_RATES = Rates()


class Bucket:
    """One caller's tokens."""

    def __init__(self, rate: Rate, now_s: float) -> None:
        self._rate, self._tokens, self._at_s = rate, rate.burst, now_s

    def spend(self, now_s: float) -> bool:
        """Take a token; False when there is none."""
        self._tokens = min(self._rate.burst, self._tokens + (now_s - self._at_s) * self._rate.per_s)
        self._at_s = now_s
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True

    def full(self, now_s: float) -> bool:
        """Whether its owner has been quiet long enough to be forgotten."""
        return self._tokens + (now_s - self._at_s) * self._rate.per_s >= self._rate.burst


class Limiter:
    """Buckets by caller and kind of request, bounded in number."""

    def __init__(self, rates: Rates, clock: Callable[[], float] = monotonic) -> None:
        self._rates, self._clock = rates, clock
        self._buckets: dict[tuple[str, str], Bucket] = {}

    def allows(self, kind: str, caller: str) -> bool:
        """Whether ``caller`` may make one more request of ``kind`` (a field of Rates) now."""
        now_s = self._clock()
        bucket = self._buckets.get((kind, caller))
        if bucket is None:
            self._forget(now_s)
            bucket = self._buckets[kind, caller] = Bucket(getattr(self._rates, kind), now_s)
        return bucket.spend(now_s)

    def _forget(self, now_s: float) -> None:
        """Keep the number of buckets bounded, those in use first."""
        if len(self._buckets) < MAX_CALLERS:
            return
        self._buckets = {key: bucket for key, bucket in self._buckets.items() if not bucket.full(now_s)}
        while len(self._buckets) >= MAX_CALLERS:
            self._buckets.pop(next(iter(self._buckets)))
