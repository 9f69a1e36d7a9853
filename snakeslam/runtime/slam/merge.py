"""Puts what the bus delivers back into the order of time: frames arrive later than the samples around them."""

from collections import deque

from snakeslam.messages import CameraFrame
from snakeslam.runtime.bus.wire import Sensors
from snakeslam.runtime.slam.runner import Item

LONGEST_WAIT_NS = 1_000_000_000
"""Samples wait this long for a frame; a frame that arrives later still is dropped."""


class Merge:
    """Returns targets, samples and frames in the order in which a run in lockstep has them; pure."""

    def __init__(self) -> None:
        self._waiting: deque[Item] = deque()
        self._returned_ns = -1
        self._newest_ns = -1
        self._next_seq: int | None = None
        self.lost = 0
        """How many sensor messages never arrived."""

    def add_sensors(self, sensors: Sensors) -> list[Item]:
        """Add the samples of a control period; return those that waited for a frame for too long."""
        if self._next_seq is not None and sensors.seq > self._next_seq:
            self.lost += sensors.seq - self._next_seq
        self._next_seq = sensors.seq + 1
        if sensors.target is not None:
            self._waiting.append(sensors.target)
        self._waiting.extend(sensors.imu)
        if sensors.joints is not None:
            self._waiting.append(sensors.joints)
        self._newest_ns = max(self._newest_ns, *(item.t_ns for item in self._waiting), -1)
        return self._until(self._newest_ns - LONGEST_WAIT_NS)

    def ready(self, frame: CameraFrame) -> bool:
        """Return whether every sample up to ``frame`` has arrived."""
        return self._newest_ns >= frame.t_ns

    def add_frame(self, frame: CameraFrame) -> list[Item]:
        """Return the samples up to a frame that is ``ready``, and the frame; nothing when it arrived too late."""
        if frame.t_ns < self._returned_ns:
            return []
        return [*self._until(frame.t_ns), frame]

    def _until(self, t_ns: int) -> list[Item]:
        items: list[Item] = []
        while self._waiting and self._waiting[0].t_ns <= t_ns:
            items.append(self._waiting.popleft())
        if items:
            self._returned_ns = items[-1].t_ns
        return items
