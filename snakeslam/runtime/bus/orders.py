"""Commands as orders on the bus."""

from uuid import uuid4

from snakeslam.runtime.bus.commands import RobotCommand
from snakeslam.runtime.bus.wire import Order


class Sender:
    """Numbers one sender's commands."""

    def __init__(self) -> None:
        self.name = uuid4().hex[:16]
        self._number = 0

    def order(self, command: RobotCommand, stamp_ns: int) -> Order:
        """Return ``command`` as this sender's next order, stamped with the robot's time."""
        self._number += 1
        return Order(self.name, self._number, stamp_ns, command)
