"""A run in lockstep: each packet goes to slam, each target through safety, everything to the sink, in order."""

from collections.abc import Sequence

import cv2
import numpy as np
import pytest

from snakeslam.config import Config, GovernorSettings
from snakeslam.control import Control
from snakeslam.errors import BackendError
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
from snakeslam.robot.model import PRESETS, RobotSettings, snake_model
from snakeslam.runtime.robot.controller import RobotController
from snakeslam.runtime.robot.target_guard import NOT_FINITE
from snakeslam.runtime.session.lockstep import Loop, build_loop
from snakeslam.studies.experiment import run_loop
from snakeslam.studies.recorder import Recorder
from tests.server.still_robot import StillRobot

MODEL = PRESETS["orthogonal24"]
N = MODEL.joint_count
CONFIG = Config(robot=RobotSettings(model="orthogonal24"))
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
        self.model = MODEL
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

    def read_ground_truth(self) -> Sequence[GroundTruth]:
        truth, self._truth = self._truth, []
        return truth


class FakeSlam:
    """Knows the pose of every frame but the second."""

    def __init__(self, verdict: Verdict = Verdict.GOOD) -> None:
        self.health = Health(verdict)
        self.packets: list[Packet] = []
        self.expected: list[JointTarget] = []

    def expect(self, target: JointTarget) -> None:
        self.expected.append(target)

    def process(self, packet: Packet) -> SlamUpdate | None:
        self.packets.append(packet)
        if not isinstance(packet, CameraFrame):
            return None
        health = self.health
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


class SpyControl(Control):
    """The configured control; keeps what each step was given, and what it returned."""

    def __init__(self, config: Config = CONFIG) -> None:
        super().__init__(snake_model(config.robot), config.gait, config.head)
        self.given: list[tuple[int, JointState | None, PoseEstimate | None, ImuSample | None]] = []
        self.targets: list[JointTarget] = []

    def step(
        self, t_ns: int, joints: JointState | None, pose: PoseEstimate | None, imu: ImuSample | None
    ) -> JointTarget:
        self.given.append((t_ns, joints, pose, imu))
        self.targets.append(super().step(t_ns, joints, pose, imu))
        return self.targets[-1]


def build(control: Control | None) -> tuple[Loop, FakeBackend, FakeSlam, FakeSink]:
    backend, slam, sink = FakeBackend(), FakeSlam(), FakeSink()
    robot = None
    if control is not None:
        robot = RobotController(CONFIG, backend, control, lambda _: None, required={})  # type: ignore[arg-type]
    return Loop(backend, robot, slam, sink), backend, slam, sink  # type: ignore[arg-type]


def run(loop: Loop) -> int:
    steps = 0
    while loop.step():
        steps += 1
    return steps


def test_one_step_in_order() -> None:
    loop, _, _, sink = build(SpyControl())
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
    control = SpyControl()
    loop, backend, _, _ = build(control)
    assert run(loop) == 6
    assert control.given[0] == (0, None, None, None)
    for k, (t_ns, state, pose, sample) in enumerate(control.given[1:], start=1):
        assert state is not None
        assert sample is not None
        assert (t_ns, state.t_ns, sample.t_ns) == (k * PERIOD_NS,) * 3
        assert (pose is None) == (k in (1, 4, 5))
    assert [target.t_ns for target in backend.targets if target] == [k * PERIOD_NS for k in range(7)]


def test_a_recording_needs_no_control() -> None:
    loop, backend, slam, sink = build(None)
    assert run(loop) == 6
    assert backend.targets == [None] * 7
    assert len(slam.packets) == 6 * 3 + 3
    assert not any(kind == "target" for kind, _ in sink.seen)


def test_slam_is_timed_over_the_packets_of_a_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each call takes a second on this clock: two periods of three packets and the frame."""
    ticks = iter(np.arange(0.0, 1000.0))
    monkeypatch.setattr("snakeslam.runtime.slam.runner.perf_counter", lambda: float(next(ticks)))
    loop, _, _, sink = build(None)
    run(loop)
    assert sink.slam_ms == [7000.0, 7000.0, 7000.0]


def test_opencv_is_made_deterministic() -> None:
    cv2.setNumThreads(2)
    build(None)
    assert cv2.getNumThreads() == 1


def build_stationary(config: Config) -> tuple[Loop, SpyControl, StillRobot]:
    backend, control = StillRobot(frame_every=10**9), SpyControl(config)
    return build_loop(config, backend, Recorder(), slam=False, control=control, autostart=True), control, backend


@pytest.mark.parametrize("gait", ["serpentine", "sidewinding", "arc_rolling", "helix_rolling", "pedal"])
@pytest.mark.parametrize("head", ["none", "predictive"])
def test_safety_passes_the_targets_of_a_scripted_run_bit_for_bit(gait: str, head: str) -> None:
    """The same safety as live, and the bytes of every estimate stay what they were without it."""
    config = CONFIG.model_copy(
        update={
            "gait": CONFIG.gait.model_validate({"name": gait}),
            "head": CONFIG.head.model_copy(update={"controller": head}),
        }
    )
    loop, control, backend = build_stationary(config)
    run_loop(loop, 10_000_000_000, lambda _: None)
    wanted, sent = (np.array([target.q_rad for target in targets]) for targets in (control.targets, backend.targets))
    assert np.ptp(wanted, axis=0).max() > 0.1
    assert np.array_equal(wanted, sent)


def test_a_scripted_run_that_safety_holds_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    loop, _, backend = build_stationary(CONFIG)
    run_loop(loop, 1_000_000_000, lambda _: None)
    monkeypatch.setattr(Control, "step", lambda *_: JointTarget(0, np.full(N, np.nan)))
    with pytest.raises(BackendError, match=NOT_FINITE):
        run_loop(loop, 2_000_000_000, lambda _: None)
    assert np.all(np.isfinite(backend.targets[-1].q_rad))


def test_a_blind_scripted_run_goes_on_and_the_governor_slows_it() -> None:
    """No operator could start it again; the governor of the live robot is wired in the same place."""
    config = CONFIG.model_copy(update={"governor": GovernorSettings(enabled=True)})
    control, slam = SpyControl(config), FakeSlam(Verdict.BLIND)
    loop = build_loop(config, StillRobot(), Recorder(), slam=False, control=control, autostart=True)
    loop._runner._slam = slam  # type: ignore[assignment]
    run_loop(loop, 12_000_000_000, lambda _: None)
    assert control.throttle == pytest.approx(config.governor.least_pace)
    assert np.ptp([target.q_rad for target in control.targets[-100:]], axis=0).max() > 0.01
