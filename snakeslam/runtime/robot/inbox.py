"""What the robot node has received from the bus and not yet handled."""

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
    """Filled in the bus's threads, emptied by the robot node's loop alone; each queue is bounded, the oldest go."""

    wake: threading.Event = field(default_factory=threading.Event)
    urgent: deque[Order] = field(default_factory=lambda: deque[Order](maxlen=KEPT))
    orders: deque[Order] = field(default_factory=lambda: deque[Order](maxlen=KEPT))
    beats: deque[tuple[str, Beat]] = field(default_factory=lambda: deque[tuple[str, Beat]](maxlen=KEPT))
    estimates: deque[Estimate] = field(default_factory=lambda: deque[Estimate](maxlen=1))
    camera: threading.Event = field(default_factory=threading.Event)

    def subscribe(self, bus: Bus) -> None:
        """Receive from ``bus`` from now on."""
        bus.subscribe(ESTOP, self._waking(self.urgent))
        bus.subscribe(ORDERS, self._waking(self.orders))
        bus.subscribe(SERVER_BEAT, lambda beat: self.beats.append((SERVER, beat)))
        bus.subscribe(SLAM_BEAT, lambda beat: self.beats.append((SLAM, beat)))
        bus.subscribe(ESTIMATES, self.estimates.append)
        bus.subscribe(CAMERA_READY, lambda _: self.camera.set())

    def _waking(self, queue: "deque[Order]") -> Callable[[Order], None]:
        def put(order: Order) -> None:
            queue.append(order)
            self.wake.set()

        return put


def drain(queue: "deque[T]") -> list[T]:
    """Remove and return what is in ``queue`` now; what is added meanwhile stays for the next call."""
    return [queue.popleft() for _ in range(len(queue))]
