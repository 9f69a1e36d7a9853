"""The robot node: the robot controller in real time, on the bus; a simulator's camera is a process beside it."""

from collections import deque
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import replace
from functools import partial
from time import monotonic, monotonic_ns
from uuid import uuid4

import structlog

from snakeslam.backends.base import Backend
from snakeslam.errors import InputError
from snakeslam.garbage import collect_seldom
from snakeslam.messages import CameraFrame, ImuSample, JointState
from snakeslam.runtime.assembly.build import build_backend, build_control, has_camera_node
from snakeslam.runtime.assembly.spec import SessionSpec
from snakeslam.runtime.bus.bus import Bus
from snakeslam.runtime.bus.commands import EStop
from snakeslam.runtime.bus.link import Link
from snakeslam.runtime.bus.shapes import robot_sizes
from snakeslam.runtime.bus.topics import EXPOSURES, FRAMES, HELLO, ROBOT_EVENTS, ROBOT_STATE, SENSORS, Event
from snakeslam.runtime.bus.wire import Exposure, Heartbeat, Hello, Sensors, SentCommand
from snakeslam.runtime.nodes.camera import camera_process
from snakeslam.runtime.process.log_limit import LogLimit
from snakeslam.runtime.process.node import Life
from snakeslam.runtime.process.priority import set_control_priority
from snakeslam.runtime.process.supervisor import Supervisor
from snakeslam.runtime.robot.controller import RobotController, Step
from snakeslam.runtime.robot.inbox import Inbox, drain
from snakeslam.runtime.robot.safety import SLAM
from snakeslam.runtime.robot.target_guard import STEP_S
from snakeslam.runtime.robot.time import RobotTime

STATE_S, HELLO_S = 0.05, 0.2
LAST_HOLD_S = 0.4
"""The time that a hold takes: the node ends after it, and so does a backend that has failed for so long."""
LAG_NS = 300_000_000
"""A simulator that is this far ahead of the frames that slam has processed waits for slam."""
PATIENCE_S, FIRST_PATIENCE_S = 1.0, 20.0
"""It waits no longer than this for a slam that makes no progress, or at the beginning for slam and camera to start."""
RETRY_S = 0.005
_log = structlog.get_logger("robot")


class RobotNode:
    """One robot on one bus; each ``iterate`` does what is due.

    Whatever fails on the way (a message, control, publishing) holds the robot and is reported, and the loop goes on,
    because it is the loop that brakes the robot. Only a backend that fails for as long as a hold takes ends it.

    With a ``camera`` in a process of its own the simulation does not begin before that is ready, so that no frame is
    missed. ``deaths`` gets the reason each time that process dies.
    """

    def __init__(
        self,
        robot: RobotController,
        bus: Bus,
        hello: Hello,
        camera: bool = False,
        deaths: deque[str] | None = None,
    ) -> None:
        self._robot, self._bus, self._hello = robot, bus, hello
        self._inbox, self._time = Inbox(), RobotTime(simulated=hello.simulated)
        self._inbox.subscribe(bus)
        self._limit = LogLimit()
        self._seq = 0
        self._failing_since_s: float | None = None
        self._camera, self._slam_there = camera, False
        self._deaths = deque[str]() if deaths is None else deaths
        self._due_s = self._state_s = self._hello_s = monotonic()
        self._t_slam_ns: int | None = None
        self._patient_until_s = monotonic() + FIRST_PATIENCE_S

    def iterate(self) -> bool:
        """Wait for commands until the next control period, then do it; return False at the backend's end."""
        self._inbox.wake.wait(max(0.0, self._due_s - monotonic()))
        self._inbox.wake.clear()
        self._handle_estops()
        self._guarded("the clock", self._note_iteration)
        self._handle_messages()
        self._guarded("publishing", self._report_deaths)
        now_s = monotonic()
        if now_s >= self._due_s and not self._slam_lags(now_s):
            self._due_s = now_s + STEP_S
            if not self._step():
                return False
        elif now_s >= self._due_s:
            self._due_s = now_s + RETRY_S
        if now_s >= self._state_s:
            self.publish_state()
        if now_s >= self._hello_s:
            self._hello_s = now_s + HELLO_S
            self._guarded("publishing", lambda: self._bus.publish(HELLO, self._newest_hello()))
        return True

    def publish_state(self) -> None:
        """Publish the state now."""
        self._state_s = monotonic() + STATE_S
        self._guarded("publishing", lambda: self._bus.publish(ROBOT_STATE, self._robot.state(monotonic_ns())))

    def _guarded(self, what: str, do: Callable[[], None]) -> None:
        """Call ``do``; an error in it holds the robot instead of ending the loop."""
        try:
            do()
        except Exception as error:  # noqa: BLE001
            self._robot.fault(what, error)

    def _note_iteration(self) -> None:
        clock_ns = monotonic_ns()
        self._time.add(clock_ns, self._robot.backend.t_ns)
        self._robot.safety.on_iteration(clock_ns, self._time.at(clock_ns))

    def _newest_hello(self) -> Hello:
        robot = self._robot
        return replace(
            self._hello,
            stamp_ns=monotonic_ns(),
            t_ns=robot.backend.t_ns,
            last_pose=robot.last_pose,
            last_pose_holds=robot.last_pose_holds,
        )

    def _handle_estops(self) -> None:
        """Handle the E-stops that have arrived; all are latched before anything else is done for the first."""
        commands = drain(self._inbox.estops)
        for sent in commands:
            if isinstance(sent.command, EStop):
                self._robot.safety.latch(sent.command.reason)
        for sent in commands:
            if isinstance(sent.command, EStop):
                self._guarded("an E-stop", partial(self._on_command, sent))
            else:
                self._log_dropped(f"{type(sent.command).__name__} is no E-stop")
        if commands:
            self.publish_state()

    def _handle_messages(self) -> None:
        """Handle what has arrived, each message by itself; an E-stop that arrives meanwhile is handled first."""
        for name, heartbeat in drain(self._inbox.heartbeats):
            self._guarded("a heartbeat", partial(self._on_heartbeat, name, heartbeat))
        commands = drain(self._inbox.commands)
        for sent in commands:
            if self._inbox.estops:
                self._handle_estops()
            self._guarded("a command", partial(self._on_command, sent))
        for estimate in drain(self._inbox.estimates):
            self._guarded("an estimate", partial(self._robot.on_estimate, estimate))
        if commands:
            self.publish_state()

    def _on_heartbeat(self, name: str, heartbeat: Heartbeat) -> None:
        clock_ns = monotonic_ns()
        stamp_ns = self._time.of_stamp(heartbeat.stamp_ns, clock_ns)
        self._robot.safety.on_heartbeat(name, stamp_ns, self._time.at(clock_ns))
        if name == SLAM:
            self._robot.safety.set_missing(SLAM, heartbeat.missing)
            self._note_progress(heartbeat)

    def _on_command(self, sent: SentCommand) -> None:
        clock_ns = monotonic_ns()
        sent = replace(sent, stamp_ns=self._time.of_stamp(sent.stamp_ns, clock_ns))
        self._robot.on_command(sent, self._time.at(clock_ns))

    def _log_dropped(self, reason: str) -> None:
        left_out = self._limit.due("dropped")
        if left_out is not None:
            _log.warning("dropped", reason=reason, left_out=left_out)

    def _step(self) -> bool:
        """Do one control period; return False at the backend's end. Raises when the backend goes on failing."""
        clock_ns = monotonic_ns()
        try:
            step = self._robot.step(self._time.at(clock_ns))
        except Exception as error:
            self._robot.fault("the robot", error)
            self._failing_since_s = self._failing_since_s or monotonic()
            if monotonic() - self._failing_since_s > LAST_HOLD_S:
                raise
            return True
        self._failing_since_s = None
        if step is None:
            return False
        self._guarded("publishing", partial(self._publish, step, clock_ns))
        self._due_s = monotonic() + self._robot.pacer.wait_s(self._robot.backend.t_ns)
        return True

    def _publish(self, step: Step, stamp_ns: int) -> None:
        imu = tuple(packet for packet in step.packets if isinstance(packet, ImuSample))
        joints = [packet for packet in step.packets if isinstance(packet, JointState)]
        boot, newest_joints = self._robot.boot, joints[-1] if joints else None
        sensors = Sensors(boot, self._seq, stamp_ns, imu, newest_joints, step.target, tuple(step.truth))
        self._seq += 1
        self._bus.publish(SENSORS, sensors)
        for packet in step.packets:
            if isinstance(packet, CameraFrame):
                self._bus.publish(FRAMES, packet)
        camera = self._robot.backend.remote_camera
        for exposure in camera.read_exposures() if camera is not None else ():
            self._bus.publish(EXPOSURES, Exposure(boot, exposure))

    def _note_progress(self, heartbeat: Heartbeat) -> None:
        self._slam_there = True
        if heartbeat.t_frame_ns is not None and heartbeat.t_frame_ns != self._t_slam_ns:
            self._t_slam_ns, self._patient_until_s = heartbeat.t_frame_ns, monotonic() + PATIENCE_S

    def _report_deaths(self) -> None:
        """Report each death of the camera's process; simulated time does not wait for the frames of a dead camera."""
        while self._deaths:
            text = f"the camera's process: {self._deaths.popleft()}; it is started again"
            self._bus.publish(ROBOT_EVENTS, Event(self._robot.backend.t_ns, "error", text))
            if self._inbox.camera_ready.is_set():
                self._patient_until_s = monotonic()

    def _slam_lags(self, now_s: float) -> bool:
        """Return whether simulated time has to wait for slam; a real robot's time never does, nor for a frozen slam."""
        if not self._hello.simulated or now_s > self._patient_until_s:
            return False
        if not self._slam_there or (self._camera and not self._inbox.camera_ready.is_set()):
            return True
        reached_ns = self._robot.t_start_ns if self._t_slam_ns is None else self._t_slam_ns
        return self._robot.backend.t_ns - reached_ns > LAG_NS


def run_robot(spec: SessionSpec, link: Link, life: Life) -> None:
    """Run the robot node until its life ends; it leaves the robot in a hold."""
    set_control_priority()
    deaths = deque[str]()

    def on_death(name: str, reason: str, final: bool) -> None:
        _log.error("a part of the robot node ended", part=name, reason=reason, final=final)
        if not final:
            deaths.append(reason)

    # Endless, because a robot without a camera is held anyway: giving the camera up would gain nothing.
    parts = Supervisor(on_death, endless=True)
    camera_apart = spec.build is None and has_camera_node(spec.config)
    try:
        if camera_apart:
            # It takes as long to build as the simulator itself: both at the same time.
            parts.start("camera", lambda: camera_process(spec.config, replace(link, listens=False)))
        with closing(_build(spec)) as backend, closing(Bus(link, wanted=lambda: not life.over)) as bus:
            robot = _controller(spec, backend, bus)
            bus.expect(robot_sizes(robot.joint_count))
            collect_seldom()
            _run(RobotNode(robot, bus, _hello(spec, robot), camera_apart, deaths), robot, life)
    finally:
        parts.close()


def _controller(spec: SessionSpec, backend: Backend, bus: Bus) -> RobotController:
    control = build_control(spec.config, backend)
    if control is None:
        raise InputError("the robot node", "a recording has no robot", "a simulator or a real robot")
    return RobotController(
        spec.config,
        backend,
        control,
        lambda event: bus.publish(ROBOT_EVENTS, event),
        boot=uuid4().hex[:16],
        estop_reason=spec.estop_reason,
        autostart=spec.autostart,
    )


def _hello(spec: SessionSpec, robot: RobotController) -> Hello:
    backend, config = robot.backend, spec.config
    return Hello(robot.boot, 0, backend.t_ns, backend.rig, config.robot, config.run.seed, backend.simulated)


def _run(node: RobotNode, robot: RobotController, life: Life) -> None:
    """Run until the life is over, then brake the robot to a hold; after an error too."""
    try:
        while not life.over:
            if not node.iterate():
                return
    except Exception:
        with suppress(Exception):  # the first error is the one to report
            _brake(node, robot)
        raise
    _brake(node, robot)


def _brake(node: RobotNode, robot: RobotController) -> None:
    robot.hold("the robot node ends")
    end_s = monotonic() + LAST_HOLD_S
    while monotonic() < end_s and node.iterate():
        pass


def _build(spec: SessionSpec) -> Backend:
    if spec.build is not None:
        return spec.build(spec)
    return build_backend(spec.config, "elsewhere")
