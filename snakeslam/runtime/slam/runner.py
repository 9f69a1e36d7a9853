"""The one runner of slam: targets and packets in time order go in, each frame's update comes out; live and scripted."""

from collections.abc import Callable, Sequence
from time import perf_counter
from typing import Protocol

import cv2

from snakeslam.messages import CameraFrame, GroundTruth, JointTarget, Packet, SlamUpdate, check_packet
from snakeslam.slam import Slam

Item = Packet | JointTarget


class Sink(Protocol):
    """Receives what a run gives: the recorder of a scripted run, the view of a live one."""

    def on_target(self, target: JointTarget) -> None:
        """Handle what the servos got for the control period that follows."""
        ...

    def on_packet(self, packet: Packet) -> None:
        """Handle a packet, before slam processes it."""
        ...

    def on_update(self, update: SlamUpdate, frame: CameraFrame, slam_ms: float) -> None:
        """Handle slam's update at a frame; ``slam_ms`` is its time over the packets since the frame before."""
        ...

    def on_truth(self, truth: Sequence[GroundTruth]) -> None:
        """Handle the ground truth of a control period."""
        ...


class SlamRunner:
    """Runs ``slam`` (None: only the sink) over targets and packets in time order, and times it.

    ``in_world`` moves each update into the world that the sink knows (None: the same one).
    """

    def __init__(
        self, slam: Slam | None, sink: Sink, in_world: Callable[[SlamUpdate], SlamUpdate] | None = None
    ) -> None:
        # The same image must give the same features in every run, on any number of cores.
        cv2.setNumThreads(1)
        cv2.setRNGSeed(0)
        self._slam, self._sink, self._in_world = slam, sink, in_world
        self._slam_ms = 0.0

    def add(self, item: Item) -> SlamUpdate | None:
        """Process ``item`` and pass it to the sink; return the update if it is a frame.

        BackendError for a packet of an unknown type.
        """
        if isinstance(item, JointTarget):
            if self._slam is not None:
                self._slam.expect(item)
            self._sink.on_target(item)
            return None
        check_packet(item)
        self._sink.on_packet(item)
        if self._slam is None:
            return None
        started_s = perf_counter()
        update = self._slam.process(item)
        self._slam_ms += (perf_counter() - started_s) * 1e3
        if update is None or not isinstance(item, CameraFrame):
            return None
        if self._in_world is not None:
            update = self._in_world(update)
        self._sink.on_update(update, item, self._slam_ms)
        self._slam_ms = 0.0
        return update

    def on_truth(self, truth: Sequence[GroundTruth]) -> None:
        """Pass on the ground truth of a control period, if there is any."""
        if truth:
            self._sink.on_truth(truth)
