"""Numbers and stamps the commands of one sender."""

from uuid import uuid4

from snakeslam.runtime.bus.commands import RobotCommand
from snakeslam.runtime.bus.wire import SentCommand


class Sender:
    """One sender of commands, under a name of its own; its commands are numbered from 1 on."""

    def __init__(self) -> None:
        self.name = uuid4().hex[:16]
        self._number = 0

    def stamped(self, command: RobotCommand, stamp_ns: int) -> SentCommand:
        """Return ``command`` as it is sent: with the next number, stamped ``stamp_ns`` of the robot's time."""
        self._number += 1
        return SentCommand(self.name, self._number, stamp_ns, command)
