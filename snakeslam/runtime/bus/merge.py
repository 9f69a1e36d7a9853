"""Brings what the bus delivers back into the order of time: pictures come later than the samples around them."""

from collections import deque

from snakeslam.messages import CameraFrame, JointTarget, Packet
from snakeslam.runtime.bus.wire import Sensors

LONGEST_WAIT_NS = 1_000_000_000
"""Samples wait this long for a picture; one that comes later still is dropped."""

Item = Packet | JointTarget


class Merge:
    """Returns targets, samples and pictures in the order in which a lockstep run would have them; pure."""

    def __init__(self) -> None:
        self._waiting: deque[Item] = deque()
        self._given_ns = -1
        self._newest_ns = -1
        self._next_seq: int | None = None
        self.lost = 0
        """Sensor messages that never came."""

    def sensors(self, sensors: Sensors) -> list[Item]:
        """Take a control period's samples; return what cannot wait for a picture any longer."""
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
        """Whether every sample up to the picture is there."""
        return self._newest_ns >= frame.t_ns

    def frame(self, frame: CameraFrame) -> list[Item]:
        """Return the samples up to a picture that is ``ready``, and the picture; nothing when it comes too late."""
        if frame.t_ns < self._given_ns:
            return []
        return [*self._until(frame.t_ns), frame]

    def _until(self, t_ns: int) -> list[Item]:
        given: list[Item] = []
        while self._waiting and self._waiting[0].t_ns <= t_ns:
            given.append(self._waiting.popleft())
        if given:
            self._given_ns = given[-1].t_ns
        return given
