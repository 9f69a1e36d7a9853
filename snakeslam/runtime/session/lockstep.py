"""The loop: packets -> slam -> control -> backend, as fast as it can in a scripted run, paced in the live view."""

from collections.abc import Sequence
from time import perf_counter
from typing import Protocol

import cv2

from snakeslam.backends.base import Backend
from snakeslam.control import Control
from snakeslam.messages import (
    CameraFrame,
    GroundTruth,
    ImuSample,
    JointState,
    JointTarget,
    Packet,
    PoseEstimate,
    SlamUpdate,
)
from snakeslam.runtime.robot.governor import Governor
from snakeslam.slam import Slam


class Sink(Protocol):
    """Takes what a run gives: the recorder of a scripted run, the live view."""

    def on_target(self, target: JointTarget) -> None:
        """Take what control commanded for the step that follows."""
        ...

    def on_packet(self, packet: Packet) -> None:
        """Take a packet, before slam has it."""
        ...

    def on_update(self, update: SlamUpdate, frame: CameraFrame, slam_ms: float) -> None:
        """Take slam's word on a frame, and the time it took over it and the packets since the frame before."""
        ...

    def on_truth(self, truth: Sequence[GroundTruth]) -> None:
        """Take the truth of the step."""
        ...


class Loop:
    """One backend, its control (None for a recording) and slam (None: no estimate), in deterministic lockstep.

    A ``governor`` throttles control by what slam says of itself.
    """

    def __init__(
        self,
        backend: Backend,
        control: Control | None,
        slam: Slam | None,
        sink: Sink,
        governor: Governor | None = None,
    ) -> None:
        # The same picture must give the same features in every run, on any number of cores.
        cv2.setNumThreads(1)
        cv2.setRNGSeed(0)
        self.backend, self.control, self.slam, self.sink = backend, control, slam, sink
        self.governor = governor
        self.pose: PoseEstimate | None = None
        self._joints: JointState | None = None
        self._imu: ImuSample | None = None
        self._slam_ms = 0.0

    def step(self) -> bool:
        """Advance one control period (a recording: one packet); return False at the end."""
        packets = self.backend.step(self._target())
        for packet in packets or ():
            self._take(packet)
        truth = self.backend.take_ground_truth()
        if truth:
            self.sink.on_truth(truth)
        return packets is not None

    def _target(self) -> JointTarget | None:
        if self.control is None:
            return None
        target = self.control.step(self.backend.t_ns, self._joints, self.pose, self._imu)
        if self.slam is not None:
            self.slam.expect(target)
        self.sink.on_target(target)
        return target

    def _take(self, packet: Packet) -> None:
        if isinstance(packet, JointState):
            self._joints = packet
        elif isinstance(packet, ImuSample):
            self._imu = packet
        self.sink.on_packet(packet)
        if self.slam is None:
            return
        started = perf_counter()
        update = self.slam.process(packet)
        self._slam_ms += (perf_counter() - started) * 1e3
        if update is not None and isinstance(packet, CameraFrame):
            self.pose = update.pose
            if self.governor is not None and self.control is not None:
                self.control.throttle = self.governor.step(update.t_ns, update.health).pace
            self.sink.on_update(update, packet, self._slam_ms)
            self._slam_ms = 0.0
