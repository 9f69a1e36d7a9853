"""What the robot node has received from the bus and not handled yet."""

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from snakeslam.runtime.bus.bus import Bus
from snakeslam.runtime.bus.topics import CAMERA_READY, ESTIMATES, ESTOP, ORDERS, SERVER_BEAT, SLAM_BEAT
from snakeslam.runtime.bus.wire import Beat, Estimate, Order
from snakeslam.runtime.robot.safety import SERVER, SLAM

T = TypeVar("T")
KEPT = 256


@dataclass(slots=True)
class Inbox:
    """Filled by the bus's threads and emptied by the robot node's loop; a full queue drops its oldest message.

    ``wake`` is set when a command arrives, ``camera_ready`` once the simulator's camera is there.
    """

    wake: threading.Event = field(default_factory=threading.Event)
    estops: deque[Order] = field(default_factory=lambda: deque[Order](maxlen=KEPT))
    commands: deque[Order] = field(default_factory=lambda: deque[Order](maxlen=KEPT))
    heartbeats: deque[tuple[str, Beat]] = field(default_factory=lambda: deque[tuple[str, Beat]](maxlen=KEPT))
    estimates: deque[Estimate] = field(default_factory=lambda: deque[Estimate](maxlen=1))
    camera_ready: threading.Event = field(default_factory=threading.Event)

    def subscribe(self, bus: Bus) -> None:
        """Receive from ``bus`` from now on."""
        bus.subscribe(ESTOP, self._add_and_wake(self.estops))
        bus.subscribe(ORDERS, self._add_and_wake(self.commands))
        bus.subscribe(SERVER_BEAT, lambda heartbeat: self.heartbeats.append((SERVER, heartbeat)))
        bus.subscribe(SLAM_BEAT, lambda heartbeat: self.heartbeats.append((SLAM, heartbeat)))
        bus.subscribe(ESTIMATES, self.estimates.append)
        bus.subscribe(CAMERA_READY, lambda _: self.camera_ready.set())

    def _add_and_wake(self, queue: "deque[Order]") -> Callable[[Order], None]:
        def add(order: Order) -> None:
            queue.append(order)
            self.wake.set()

        return add


def drain(queue: "deque[T]") -> list[T]:
    """Remove and return what is in ``queue`` now; what is added meanwhile stays for the next call."""
    return [queue.popleft() for _ in range(len(queue))]
