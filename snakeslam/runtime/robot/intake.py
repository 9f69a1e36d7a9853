"""Which commands the robot takes: fresh, in order, and made of numbers. What can only stop it is always taken."""

import math
from dataclasses import fields, is_dataclass
from typing import Any

from msgspec import Struct
from msgspec.structs import astuple

from snakeslam.runtime.bus.commands import Drive, EStop, Stop
from snakeslam.runtime.bus.wire import Order

STALE_NS = 300_000_000
FUTURE_NS = 50_000_000
"""Room for the sender's error in reading the robot's clock."""
MS = 1e-6
SENDERS_KEPT = 64


class Intake:
    """Judges orders by the robot's own clock; pure, with the time told."""

    def __init__(self) -> None:
        self._last: dict[str, int] = {}

    def judge(self, order: Order, now_ns: int) -> str | None:
        """Return why ``order`` is dropped, None when it is to be obeyed.

        An order that is late, early, overtaken by a later one of its sender, or not finite is dropped. An E-stop, a
        stop and a drive that is let go are obeyed however late they come.
        """
        command = order.command
        overtaken = order.number <= self._last.get(order.sender, 0)
        self._note(order)
        if isinstance(command, EStop | Stop):
            return None
        if not is_finite(command):
            return "it has a value that is no number"
        if isinstance(command, Drive) and command.drive == 0.0:
            return None
        if overtaken:
            return "a later command was there before it"
        return when_wrong(order.stamp_ns, now_ns)

    def _note(self, order: Order) -> None:
        newest = max(order.number, self._last.pop(order.sender, 0))
        self._last[order.sender] = newest
        while len(self._last) > SENDERS_KEPT:
            del self._last[next(iter(self._last))]


def when_wrong(stamp_ns: int, now_ns: int) -> str | None:
    """Return what is wrong with the time of a message, None when it is fresh."""
    age_ns = now_ns - stamp_ns
    if age_ns > STALE_NS:
        return f"it was {age_ns * MS:.0f} ms old"
    if age_ns < -FUTURE_NS:
        return f"it came {-age_ns * MS:.0f} ms from the future"
    return None


def is_finite(command: Any) -> bool:
    """Whether every number in ``command`` is one."""
    if isinstance(command, float):
        return math.isfinite(command)
    if isinstance(command, dict):
        return all(map(is_finite, command.values()))
    if isinstance(command, Struct):
        return all(map(is_finite, astuple(command)))
    if is_dataclass(command):
        return all(is_finite(getattr(command, field.name)) for field in fields(command))
    return True
