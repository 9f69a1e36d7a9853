"""Several estimators fed by the same run: that of the loop, and others beside it."""

from collections.abc import Mapping
from time import perf_counter

from snakeslam.estimation.settings import Mode
from snakeslam.messages import CameraFrame, JointTarget, Packet, SlamUpdate
from snakeslam.slam import Slam
from snakeslam.studies.recorder import Recorder


class Listener:
    """Slam that gets the packets of the loop's slam, its update for each frame and the time that it took."""

    def __init__(self, slam: Slam) -> None:
        self._slam = slam
        self._slam_ms = 0.0
        self.updates: list[SlamUpdate] = []
        self.frame_ms: list[float] = []

    def expect(self, target: JointTarget) -> None:
        """Take what control commanded."""
        self._slam.expect(target)

    def add(self, packet: Packet) -> None:
        """Take a packet; keep what is said of a frame, with the time over it and the packets since the one before."""
        started = perf_counter()
        update = self._slam.process(packet)
        self._slam_ms += (perf_counter() - started) * 1e3
        if update is not None and isinstance(packet, CameraFrame):
            self.updates.append(update)
            self.frame_ms.append(self._slam_ms)
            self._slam_ms = 0.0


class Broadcast(Recorder):
    """The recorder of a run that hands targets and packets on to listeners; nothing comes back from them."""

    def __init__(self, listeners: Mapping[Mode, Listener]) -> None:
        super().__init__()
        self.listeners = listeners

    def on_target(self, target: JointTarget) -> None:
        """Keep and hand on a command."""
        super().on_target(target)
        for listener in self.listeners.values():
            listener.expect(target)

    def on_packet(self, packet: Packet) -> None:
        """Keep and hand on a packet."""
        super().on_packet(packet)
        for listener in self.listeners.values():
            listener.add(packet)
