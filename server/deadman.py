"""The deadman input of one operator: which samples count, and when there were none for too long. Time is given."""

from collections import deque
from dataclasses import dataclass

from snakeslam.runtime.robot.deadman import DEADMAN_S

SILENT_S = DEADMAN_S + 0.1
"""A robot whose input is silent for so long gets a stop; by the deadman limit it has held itself before."""
OFFSETS_KEPT = 20
STEPS = 20
"""Drive and turn count in steps of 1/20: the noise of a stick is no change."""


@dataclass(frozen=True, slots=True)
class DriveSample:
    """What the operator holds down: ``drive`` and ``turn`` in [-1, 1], stamped by the sender's own clock."""

    seq: int
    t_s: float
    drive: float
    turn: float


class Deadman:
    """Judges the input of one sender, whose clock is only known through its messages.

    The least difference of the clocks over the last pings is taken as no delay: age = now - t - min(now_k - t_k).
    A press begins with the first drive after a zero, or with the first of all unless the drive is known to be
    ``pressed`` already; whether it may move the robot is decided by the robot node
    (``snakeslam.runtime.robot.deadman``).
    """

    def __init__(self, pressed: bool = False) -> None:
        self.pressed = pressed
        """Whether the sender holds the drive down, as far as it has said."""
        self._begins = False
        self._offsets_s: deque[float] = deque(maxlen=OFFSETS_KEPT)
        self._seq = -1
        self.received_s = 0.0
        self.drive = 0.0
        self.turn = 0.0

    @property
    def driving(self) -> bool:
        """Whether it moves the robot."""
        return self.drive != 0.0

    def synchronise(self, t_s: float, now_s: float) -> None:
        """Note the offset of the sender's clock from a ping."""
        self._offsets_s.append(now_s - t_s)

    def age_s(self, t_s: float, now_s: float) -> float:
        """How much older than the quickest ping a message is."""
        return now_s - t_s - min(self._offsets_s, default=now_s - t_s)

    def add(self, given: DriveSample, now_s: float) -> str | None:
        """Take input, or return why it does not count."""
        if given.seq <= self._seq:
            return "out of order"
        if not self._offsets_s:
            return "before any ping"
        drive, age_s = _stepped(given.drive), self.age_s(given.t_s, now_s)
        # A zero can only stop, and counts however late it comes. A press that comes late must not begin any more.
        if drive != 0.0 and abs(age_s) > DEADMAN_S:
            self.pressed = True
            return "stale" if age_s > 0.0 else "from the future"
        self._begins = drive != 0.0 and (self._begins or not self.pressed)
        self.pressed = drive != 0.0
        self._seq, self.received_s = given.seq, now_s
        self.drive, self.turn = drive, _stepped(given.turn)
        return None

    def pop_begins(self) -> bool:
        """Return whether a press has begun since the last call."""
        begins, self._begins = self._begins, False
        return begins

    def silent(self, now_s: float) -> bool:
        """Whether it drives the robot but has said nothing for too long."""
        return self.driving and now_s - self.received_s > SILENT_S

    def release(self) -> None:
        """Stop driving on the sender's behalf: its press is over for the robot, though it may hold the drive down."""
        self.drive = self.turn = 0.0
        self._begins = False


def _stepped(value: float) -> float:
    return round(value * STEPS) / STEPS
