"""Keeps what a scripted run gives until it is written."""

import csv
from collections.abc import Sequence
from pathlib import Path

from snakeslam.messages import (
    CameraFrame,
    GroundTruth,
    JointState,
    JointTarget,
    MapChunk,
    Packet,
    SlamUpdate,
)
from snakeslam.recording.tum_writer import TumWriter


class Recorder:
    """The sink of a scripted run: updates, truth, times, the newest revision of each chunk, joint rows.

    ``sensors`` gets every packet, where the sensors are to be recorded.
    """

    def __init__(self, sensors: TumWriter | None = None) -> None:
        self.sensors = sensors
        self.updates: list[SlamUpdate] = []
        self.truth: list[GroundTruth] = []
        self.frame_ms: list[float] = []
        self.chunks: dict[int, MapChunk] = {}
        self.first_ns: int | None = None
        self.last_ns = 0
        self._target: JointTarget | None = None
        self._joints: list[tuple[JointTarget, JointState]] = []

    def on_target(self, target: JointTarget) -> None:
        """Keep the command that the next joint state answers."""
        self._target = target

    def on_packet(self, packet: Packet) -> None:
        """Note the time; keep joint states beside their commands; record the sensors."""
        if self.sensors is not None:
            self.sensors.add(packet)
        self.first_ns = packet.t_ns if self.first_ns is None else self.first_ns
        self.last_ns = packet.t_ns
        if isinstance(packet, JointState) and self._target is not None:
            self._joints.append((self._target, packet))

    def on_update(self, update: SlamUpdate, frame: CameraFrame, slam_ms: float) -> None:
        """Keep a frame's result."""
        del frame
        self.updates.append(update)
        self.frame_ms.append(slam_ms)
        for chunk in update.chunks:
            if chunk.key not in self.chunks or self.chunks[chunk.key].revision <= chunk.revision:
                self.chunks[chunk.key] = chunk

    def on_truth(self, truth: Sequence[GroundTruth]) -> None:
        """Keep the truth."""
        self.truth.extend(truth)

    @property
    def duration_s(self) -> float:
        """Time from the first packet to the last."""
        return 0.0 if self.first_ns is None else (self.last_ns - self.first_ns) / 1e9

    def write_joints(self, path: Path) -> None:
        """Write t_ns and, for each joint from tail to head, commanded and measured angles in rad; nothing without."""
        if not self._joints:
            return
        count = len(self._joints[0][0].q_rad)
        with path.open("w", newline="", encoding="ascii") as file:
            rows = csv.writer(file)
            names = [f"{kind}_{n}_rad" for kind in ("q_target", "q_measured") for n in range(1, count + 1)]
            rows.writerow(["t_ns", *names])
            for target, state in self._joints:
                rows.writerow([state.t_ns, *(f"{q:.6f}" for q in (*target.q_rad, *state.q_rad))])
