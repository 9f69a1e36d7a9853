"""Which commands are admitted: recent, in order and finite. A command that can only stop the robot always is."""

import math
from dataclasses import fields, is_dataclass
from typing import Any

from msgspec import Struct
from msgspec.structs import astuple

from snakeslam.runtime.bus.commands import Drive, EStop, Stop
from snakeslam.runtime.bus.wire import SentCommand
from snakeslam.runtime.robot.answers import OVERTAKEN
from snakeslam.runtime.robot.deadman import DEADMAN_NS

FUTURE_NS = 50_000_000
"""How far a stamp may be ahead: a sender reads the robot's clock over the network, with an error."""
NOT_FINITE = "it has a value that is not a finite number"
MS = 1e-6
SENDERS_KEPT = 64


class Admission:
    """Checks commands by the robot's clock; pure, with the time given."""

    def __init__(self) -> None:
        self._newest_number: dict[str, int] = {}

    def refusal(self, sent: SentCommand, now_ns: int) -> str | None:
        """Return why ``sent`` is dropped; None when it is admitted.

        A command is dropped when it is older than the deadman limit, from the future, overtaken by a later command of
        its sender, or not finite. An E-stop, a stop and a release are admitted however late they arrive.
        """
        command = sent.command
        overtaken = sent.number <= self._newest_number.get(sent.sender, 0)
        self._note_number(sent)
        if isinstance(command, EStop | Stop):
            return None
        if not is_finite(command):
            return NOT_FINITE
        if isinstance(command, Drive) and command.drive == 0.0:
            return None
        if overtaken:
            return OVERTAKEN
        return stamp_error(sent.stamp_ns, now_ns)

    def _note_number(self, sent: SentCommand) -> None:
        # Taken out and added again, so that the senders that were silent longest are forgotten first.
        newest = max(sent.number, self._newest_number.pop(sent.sender, 0))
        self._newest_number[sent.sender] = newest
        while len(self._newest_number) > SENDERS_KEPT:
            del self._newest_number[next(iter(self._newest_number))]


def stamp_error(stamp_ns: int, now_ns: int) -> str | None:
    """Return what is wrong with the stamp of a message that arrives at ``now_ns``; None when it is recent."""
    age_ns = now_ns - stamp_ns
    if age_ns > DEADMAN_NS:
        return f"it was {age_ns * MS:.0f} ms old"
    if age_ns < -FUTURE_NS:
        return f"it came {-age_ns * MS:.0f} ms from the future"
    return None


def is_finite(command: Any) -> bool:
    """Return whether every float in ``command``, also in what it contains, is finite."""
    if isinstance(command, float):
        return math.isfinite(command)
    if isinstance(command, dict):
        return all(map(is_finite, command.values()))
    if isinstance(command, Struct):
        return all(map(is_finite, astuple(command)))
    if is_dataclass(command):
        return all(is_finite(getattr(command, field.name)) for field in fields(command))
    return True
