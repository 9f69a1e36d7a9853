"""The loop hands each packet to slam, each step to control, and everything to the sink, in order."""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import pytest

from snakeslam.messages import (
    CameraFrame,
    GroundTruth,
    Health,
    ImuSample,
    JointState,
    JointTarget,
    Packet,
    PoseEstimate,
    SlamUpdate,
    Verdict,
)
from snakeslam.runtime.session.lockstep import Loop

N = 3
PERIOD_NS = 10_000_000


def imu(t_ns: int) -> ImuSample:
    return ImuSample(t_ns, np.zeros(3), np.zeros(3))


def joints(t_ns: int) -> JointState:
    return JointState(t_ns, *[np.full(N, t_ns / 1e9)] * 4)


def frame(t_ns: int) -> CameraFrame:
    return CameraFrame(t_ns, t_ns // PERIOD_NS, np.zeros((2, 2), np.uint8))


class FakeBackend:
    """Two IMU samples and a joint state each period, a frame every other one, for six periods."""

    def __init__(self) -> None:
        self.t_ns = 0
        self.targets: list[JointTarget | None] = []
        self._truth: list[GroundTruth] = []

    def step(self, target: JointTarget | None) -> Sequence[Packet] | None:
        self.targets.append(target)
        if self.t_ns >= 6 * PERIOD_NS:
            return None
        start, self.t_ns = self.t_ns, self.t_ns + PERIOD_NS
        self._truth.append(GroundTruth(self.t_ns, np.eye(4)))
        packets: list[Packet] = [imu(start + PERIOD_NS // 2), imu(self.t_ns), joints(self.t_ns)]
        return [*packets, frame(self.t_ns)] if self.t_ns // PERIOD_NS % 2 == 0 else packets

    def take_ground_truth(self) -> Sequence[GroundTruth]:
        truth, self._truth = self._truth, []
        return truth


class FakeControl:
    def __init__(self) -> None:
        self.calls: list[tuple[Any, ...]] = []

    def step(self, t_ns: int, *seen: Any) -> JointTarget:
        self.calls.append((t_ns, *seen))
        return JointTarget(t_ns, np.zeros(N))


class FakeSlam:
    """Knows the pose of every frame but the second."""

    def __init__(self) -> None:
        self.packets: list[Packet] = []
        self.expected: list[JointTarget] = []

    def expect(self, target: JointTarget) -> None:
        self.expected.append(target)

    def process(self, packet: Packet) -> SlamUpdate | None:
        self.packets.append(packet)
        if not isinstance(packet, CameraFrame):
            return None
        health = Health(Verdict.GOOD)
        pose = PoseEstimate(packet.t_ns, np.eye(4), np.zeros(3), np.eye(9), health)
        lost = packet.seq == 4
        empty = np.zeros((0, 2)), np.zeros(0), np.zeros(0)
        return SlamUpdate(packet.t_ns, packet.seq, None if lost else pose, health, *empty)


class FakeSink:
    def __init__(self) -> None:
        self.seen: list[tuple[str, int]] = []
        self.slam_ms: list[float] = []

    def on_target(self, target: JointTarget) -> None:
        self.seen.append(("target", target.t_ns))

    def on_packet(self, packet: Packet) -> None:
        self.seen.append((type(packet).__name__, packet.t_ns))

    def on_update(self, update: SlamUpdate, frame: CameraFrame, slam_ms: float) -> None:
        assert update.t_ns == frame.t_ns
        self.seen.append(("update", update.t_ns))
        self.slam_ms.append(slam_ms)

    def on_truth(self, truth: Sequence[GroundTruth]) -> None:
        self.seen += [("truth", sample.t_ns) for sample in truth]


def build(control: FakeControl | None) -> tuple[Loop, FakeBackend, FakeSlam, FakeSink]:
    backend, slam, sink = FakeBackend(), FakeSlam(), FakeSink()
    return Loop(backend, control, slam, sink), backend, slam, sink  # type: ignore[arg-type]


def turn(loop: Loop) -> int:
    steps = 0
    while loop.step():
        steps += 1
    return steps


def test_one_step_in_order() -> None:
    loop, _, _, sink = build(FakeControl())
    loop.step()
    loop.step()
    assert sink.seen[5:] == [
        ("target", PERIOD_NS),
        ("ImuSample", PERIOD_NS + PERIOD_NS // 2),
        ("ImuSample", 2 * PERIOD_NS),
        ("JointState", 2 * PERIOD_NS),
        ("CameraFrame", 2 * PERIOD_NS),
        ("update", 2 * PERIOD_NS),
        ("truth", 2 * PERIOD_NS),
    ]


def test_control_sees_the_newest_of_everything_and_no_pose_when_it_is_lost() -> None:
    control = FakeControl()
    loop, backend, _, _ = build(control)
    assert turn(loop) == 6
    assert control.calls[0] == (0, None, None, None)
    for k, (t_ns, state, pose, sample) in enumerate(control.calls[1:], start=1):
        assert (t_ns, state.t_ns, sample.t_ns) == (k * PERIOD_NS,) * 3
        assert (pose is None) == (k in (1, 4, 5))
    assert [target.t_ns for target in backend.targets if target] == [k * PERIOD_NS for k in range(7)]


def test_a_recording_needs_no_control() -> None:
    loop, backend, slam, sink = build(None)
    assert turn(loop) == 6
    assert backend.targets == [None] * 7
    assert len(slam.packets) == 6 * 3 + 3
    assert not any(kind == "target" for kind, _ in sink.seen)


def test_slam_is_timed_over_the_packets_of_a_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each call takes a second on this clock: two periods of three packets and the frame."""
    ticks = iter(np.arange(0.0, 1000.0))
    monkeypatch.setattr("snakeslam.runtime.session.lockstep.perf_counter", lambda: float(next(ticks)))
    loop, _, _, sink = build(None)
    turn(loop)
    assert sink.slam_ms == [7000.0, 7000.0, 7000.0]


def test_opencv_is_made_deterministic() -> None:
    cv2.setNumThreads(2)
    build(None)
    assert cv2.getNumThreads() == 1
