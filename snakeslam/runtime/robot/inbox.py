"""What the robot node has received from the bus and not handled yet."""

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from snakeslam.runtime.bus.bus import Bus
from snakeslam.runtime.bus.topics import CAMERA_READY, COMMANDS, ESTIMATES, ESTOP, SERVER_HEARTBEAT, SLAM_HEARTBEAT
from snakeslam.runtime.bus.wire import Estimate, Heartbeat, SentCommand
from snakeslam.runtime.robot.safety import SERVER, SLAM

T = TypeVar("T")
KEPT = 256


@dataclass(slots=True)
class Inbox:
    """Filled by the bus's threads and emptied by the robot node's loop; a full queue drops its oldest message.

    ``wake`` is set when a command arrives, ``camera_ready`` once the simulator's camera is there.
    """

    wake: threading.Event = field(default_factory=threading.Event)
    estops: deque[SentCommand] = field(default_factory=lambda: deque[SentCommand](maxlen=KEPT))
    commands: deque[SentCommand] = field(default_factory=lambda: deque[SentCommand](maxlen=KEPT))
    heartbeats: deque[tuple[str, Heartbeat]] = field(default_factory=lambda: deque[tuple[str, Heartbeat]](maxlen=KEPT))
    estimates: deque[Estimate] = field(default_factory=lambda: deque[Estimate](maxlen=1))
    camera_ready: threading.Event = field(default_factory=threading.Event)

    def subscribe(self, bus: Bus) -> None:
        """Receive from ``bus`` from now on."""
        bus.subscribe(ESTOP, self._add_and_wake(self.estops))
        bus.subscribe(COMMANDS, self._add_and_wake(self.commands))
        bus.subscribe(SERVER_HEARTBEAT, lambda heartbeat: self.heartbeats.append((SERVER, heartbeat)))
        bus.subscribe(SLAM_HEARTBEAT, lambda heartbeat: self.heartbeats.append((SLAM, heartbeat)))
        bus.subscribe(ESTIMATES, self.estimates.append)
        bus.subscribe(CAMERA_READY, lambda _: self.camera_ready.set())

    def _add_and_wake(self, queue: "deque[SentCommand]") -> Callable[[SentCommand], None]:
        def add(sent: SentCommand) -> None:
            queue.append(sent)
            self.wake.set()

        return add


def drain(queue: "deque[T]") -> list[T]:
    """Remove and return what is in ``queue`` now; what is added meanwhile stays for the next call."""
    return [queue.popleft() for _ in range(len(queue))]
