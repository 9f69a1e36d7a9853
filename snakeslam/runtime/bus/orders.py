"""Commands as orders on the bus, and back."""

from dataclasses import replace
from uuid import uuid4

from snakeslam.runtime.bus.codec import WireError
from snakeslam.runtime.bus.topics import BackUp, Command, Drive, EStop, ResetEStop, SetGait, SetHead, Start, Stop
from snakeslam.runtime.bus.wire import Order


class Sender:
    """Numbers one sender's commands."""

    def __init__(self) -> None:
        self.name = uuid4().hex[:16]
        self._number = 0

    def order(self, command: Command, stamp_ns: int) -> Order:
        """Return ``command`` as this sender's next order, stamped with the robot's time."""
        self._number += 1
        plain = Order(self.name, self._number, stamp_ns, type(command).__name__)
        if isinstance(command, SetGait):
            return replace(plain, gait=command.gait)
        if isinstance(command, SetHead):
            return replace(plain, head=command.head)
        if isinstance(command, Drive):
            hand, begins = command.hand, command.begins
            return replace(plain, drive=command.drive, turn=command.turn, hand=hand, begins=begins)
        if isinstance(command, EStop):
            return replace(plain, reason=command.reason)
        return plain


def command_of(order: Order) -> Command:
    """Return the command that ``order`` carries; WireError when there is none."""
    plain = {"Start": Start, "BackUp": BackUp, "Stop": Stop, "ResetEStop": ResetEStop}
    if order.kind in plain:
        return plain[order.kind]()
    if order.kind == "Drive":
        return Drive(order.drive, order.turn, order.hand, order.begins)
    if order.kind == "EStop":
        return EStop(order.reason or "E-stop")
    if order.kind == "SetGait" and order.gait is not None:
        return SetGait(order.gait)
    if order.kind == "SetHead" and order.head is not None:
        return SetHead(order.head)
    raise WireError(f"no command: {order.kind!r}")
