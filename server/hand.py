"""The operator's hand on the drive: which input counts, and when it was silent for too long. Time is given."""

from collections import deque
from dataclasses import dataclass

STALE_S = 0.3
"""Input older than this does not count."""
SILENT_S = 0.4
"""A robot that is driven by nothing newer is told to stop; by itself it has come to a hold before."""
OFFSETS_KEPT = 20
STEPS = 20
"""Drive and turn count in steps of 1/20: a trembling stick is no change."""


@dataclass(frozen=True, slots=True)
class Input:
    """What the hand wants: ``drive`` and ``turn`` in [-1, 1], stamped by the sender's own clock."""

    seq: int
    t_s: float
    drive: float
    turn: float


class Hand:
    """Judges the input of one sender, whose clock is only known through its messages.

    The least difference of the clocks over the last pings is taken as no delay: age = now - t - min(now_k - t_k).
    """

    def __init__(self) -> None:
        self._offsets_s: deque[float] = deque(maxlen=OFFSETS_KEPT)
        self._seq = -1
        self._taken_s = 0.0
        self.drive = 0.0
        self.turn = 0.0

    @property
    def driving(self) -> bool:
        """Whether it moves the robot."""
        return self.drive != 0.0

    def synchronise(self, t_s: float, now_s: float) -> None:
        """Learn of the sender's clock from a ping."""
        self._offsets_s.append(now_s - t_s)

    def age_s(self, t_s: float, now_s: float) -> float:
        """How much older than the quickest ping a message is."""
        return now_s - t_s - min(self._offsets_s, default=now_s - t_s)

    def take(self, given: Input, now_s: float) -> str | None:
        """Take input, or return why it does not count."""
        if given.seq <= self._seq:
            return "out of order"
        if not self._offsets_s:
            return "before any ping"
        age_s = self.age_s(given.t_s, now_s)
        if age_s > STALE_S:
            return "stale"
        if age_s < -STALE_S:
            return "from the future"
        self._seq, self._taken_s = given.seq, now_s
        self.drive, self.turn = _stepped(given.drive), _stepped(given.turn)
        return None

    def silent(self, now_s: float) -> bool:
        """Whether it drives the robot but has said nothing for too long."""
        return self.driving and now_s - self._taken_s > SILENT_S

    def release(self) -> None:
        """Let go."""
        self.drive = self.turn = 0.0


def _stepped(value: float) -> float:
    return round(value * STEPS) / STEPS
