"""The robot node: the robot's loop in real time, on the bus; the simulator's camera is a process beside it."""

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
from snakeslam.runtime.assembly.build import build_backend, build_control, build_simulator
from snakeslam.runtime.assembly.spec import SessionSpec
from snakeslam.runtime.bus.bus import Bus
from snakeslam.runtime.bus.commands import EStop
from snakeslam.runtime.bus.link import Link
from snakeslam.runtime.bus.shapes import robot_sizes
from snakeslam.runtime.bus.topics import EXPOSURES, FRAMES, HELLO, ROBOT_EVENTS, ROBOT_STATE, SENSORS, Event
from snakeslam.runtime.bus.wire import Beat, Exposure, Hello, Order
from snakeslam.runtime.nodes.camera import camera_process
from snakeslam.runtime.process.log_limit import LogLimit
from snakeslam.runtime.process.node import Life
from snakeslam.runtime.process.priority import go_first
from snakeslam.runtime.process.supervisor import Supervisor
from snakeslam.runtime.robot.controller import Robot, Step
from snakeslam.runtime.robot.inbox import Inbox, drain
from snakeslam.runtime.robot.safety import SLAM
from snakeslam.runtime.robot.time import RobotTime

STATE_S, HELLO_S, LAST_HOLD_S = 0.05, 0.2, 0.4
LAG_NS, PATIENCE_S, FIRST_PATIENCE_S = 300_000_000, 1.0, 20.0
"""A simulator that is this far ahead of slam's pictures waits, as long as slam gets on within PATIENCE_S; for slam and
its camera to be there at all, and for the first picture, it waits FIRST_PATIENCE_S."""
STEP_S = 0.01
_log = structlog.get_logger("robot")


class RobotNode:
    """One robot on one bus; ``turn`` does what is due.

    Whatever fails on the way (a message, control, publishing) holds the robot and is reported, and the loop goes on:
    the brake ramp is made by it. Only a backend that fails for as long as a hold takes ends it.

    With a ``camera`` in a process of its own the simulator does not begin before it: it would miss the first pictures.
    """

    def __init__(
        self, robot: Robot, bus: Bus, hello: Hello, camera: bool = False, deaths: deque[str] | None = None
    ) -> None:
        self._robot, self._bus, self._hello = robot, bus, hello
        self._inbox, self._time = Inbox(), RobotTime(simulated=hello.simulated)
        self._inbox.subscribe(bus)
        self._limit = LogLimit()
        self._failing_since_s: float | None = None
        self._camera, self._slam_there = camera, False
        self._deaths = deque[str]() if deaths is None else deaths
        self._due_s = self._state_s = self._hello_s = monotonic()
        self._t_slam_ns: int | None = None
        self._patient_until_s = monotonic() + FIRST_PATIENCE_S

    def turn(self) -> bool:
        """Wait for commands until the next control period, then do it; False at the backend's end."""
        self._inbox.wake.wait(max(0.0, self._due_s - monotonic()))
        self._inbox.wake.clear()
        self._latch()
        self._guarded("the clock", self._note_time)
        self._take()
        self._guarded("publishing", self._tell_deaths)
        now_s = monotonic()
        if now_s >= self._due_s and not self._slam_lags(now_s):
            self._due_s = now_s + STEP_S
            if not self._step():
                return False
        elif now_s >= self._due_s:
            self._due_s = now_s + 0.005
        if now_s >= self._state_s:
            self.report()
        if now_s >= self._hello_s:
            self._hello_s = now_s + HELLO_S
            self._guarded("publishing", lambda: self._bus.publish(HELLO, self._newest_hello()))
        return True

    def report(self) -> None:
        """Publish the state now."""
        self._state_s = monotonic() + STATE_S
        self._guarded("publishing", lambda: self._bus.publish(ROBOT_STATE, self._robot.state(monotonic_ns())))

    def _guarded(self, what: str, do: Callable[[], None]) -> None:
        """Do it; an error holds the robot instead of ending the loop."""
        try:
            do()
        except Exception as error:  # noqa: BLE001
            self._robot.fault(what, error)

    def _note_time(self) -> None:
        clock_ns = monotonic_ns()
        self._time.turn(clock_ns, self._robot.backend.t_ns)
        self._robot.safety.turn(clock_ns, self._time.at(clock_ns))

    def _newest_hello(self) -> Hello:
        robot = self._robot
        return replace(
            self._hello,
            stamp_ns=monotonic_ns(),
            t_ns=robot.backend.t_ns,
            last_pose=robot.last_pose,
            last_pose_holds=robot.last_pose_holds,
        )

    def _latch(self) -> None:
        """Handle the E-stops that have come: all are latched before anything else is done with the first."""
        orders = drain(self._inbox.urgent)
        for order in orders:
            if isinstance(order.command, EStop):
                self._robot.safety.latch(order.command.reason)
        for order in orders:
            if isinstance(order.command, EStop):
                self._guarded("an E-stop", partial(self._obey, order))
            else:
                self._drop(f"{type(order.command).__name__} is no E-stop")
        if orders:
            self.report()

    def _take(self) -> None:
        """Handle what has come, each message by itself; an E-stop that comes meanwhile goes first."""
        for name, beat in drain(self._inbox.beats):
            self._guarded("a heartbeat", partial(self._on_beat, name, beat))
        orders = drain(self._inbox.orders)
        for order in orders:
            if self._inbox.urgent:
                self._latch()
            self._guarded("a command", partial(self._obey, order))
        for estimate in drain(self._inbox.estimates):
            self._guarded("an estimate", partial(self._robot.hear, estimate))
        if orders:
            self.report()

    def _on_beat(self, name: str, beat: Beat) -> None:
        clock_ns = monotonic_ns()
        stamp_ns = self._time.of_stamp(beat.stamp_ns, clock_ns)
        self._robot.safety.beat(name, stamp_ns, self._time.at(clock_ns))
        if name == SLAM:
            self._robot.safety.report_missing(SLAM, beat.missing)
            self._note_progress(beat)

    def _obey(self, order: Order) -> None:
        clock_ns = monotonic_ns()
        order = replace(order, stamp_ns=self._time.of_stamp(order.stamp_ns, clock_ns))
        self._robot.obey(order, self._time.at(clock_ns))

    def _drop(self, reason: str) -> None:
        left_out = self._limit.due("dropped")
        if left_out is not None:
            _log.warning("dropped", reason=reason, left_out=left_out)

    def _step(self) -> bool:
        """Do one control period; False at the backend's end. A backend that fails is braked for as long as it takes."""
        clock_ns = monotonic_ns()
        try:
            step = self._robot.step(self._time.at(clock_ns), clock_ns)
        except Exception as error:
            self._robot.fault("the robot", error)
            self._failing_since_s = self._failing_since_s or monotonic()
            if monotonic() - self._failing_since_s > LAST_HOLD_S:
                raise
            return True
        self._failing_since_s = None
        if step is None:
            return False
        self._guarded("publishing", partial(self._publish, step))
        self._due_s = monotonic() + self._robot.pacer.wait_s(self._robot.backend.t_ns)
        return True

    def _publish(self, step: Step) -> None:
        self._bus.publish(SENSORS, step.sensors)
        for frame in step.frames:
            self._bus.publish(FRAMES, frame)
        take_shots = getattr(self._robot.backend, "take_shots", None)
        for shot in take_shots() if take_shots is not None else ():
            self._bus.publish(EXPOSURES, Exposure(self._robot.boot, shot))

    def _note_progress(self, beat: Beat) -> None:
        self._slam_there = True
        if beat.t_frame_ns is not None and beat.t_frame_ns != self._t_slam_ns:
            self._t_slam_ns, self._patient_until_s = beat.t_frame_ns, monotonic() + PATIENCE_S

    def _tell_deaths(self) -> None:
        """Tell of the camera's deaths; simulated time does not wait for the pictures of a camera that has died."""
        while self._deaths:
            text = f"the camera's process: {self._deaths.popleft()}; it is started again"
            self._bus.publish(ROBOT_EVENTS, Event(self._robot.backend.t_ns, "error", text))
            if self._inbox.camera.is_set():
                self._patient_until_s = monotonic()

    def _slam_lags(self, now_s: float) -> bool:
        """Whether simulated time has to wait for the estimator; a real robot's never does, nor for a frozen one."""
        if not self._hello.simulated or now_s > self._patient_until_s:
            return False
        if not self._slam_there or (self._camera and not self._inbox.camera.is_set()):
            return True
        reached_ns = self._robot.t_start_ns if self._t_slam_ns is None else self._t_slam_ns
        return self._robot.backend.t_ns - reached_ns > LAG_NS


def run_robot(spec: SessionSpec, link: Link, life: Life) -> None:
    """Run the robot node until its life ends; it leaves the robot in a hold."""
    go_first()
    deaths = deque[str]()

    def note_death(name: str, reason: str, final: bool) -> None:
        _log.error("a part of the robot node ended", part=name, reason=reason, final=final)
        if not final:
            deaths.append(reason)

    # Without pictures the robot is held, so that nothing is gained by giving the camera up.
    parts = Supervisor(note_death, endless=True)
    apart = spec.build is None and spec.recording is None
    try:
        if apart:
            # It takes as long to build as the simulator itself: both at the same time.
            parts.start("camera", lambda: camera_process(spec.config, replace(link, listens=False)))
        with closing(_build(spec)) as backend, closing(Bus(link, wanted=lambda: not life.over)) as bus:
            robot = _robot(spec, backend, bus)
            bus.expect(robot_sizes(robot.joint_count))
            collect_seldom()
            _go_on(RobotNode(robot, bus, _hello(spec, robot), apart, deaths), robot, life)
    finally:
        parts.close()


def _robot(spec: SessionSpec, backend: Backend, bus: Bus) -> Robot:
    control = build_control(spec.config, backend)
    if control is None:
        raise InputError("the robot node", "a recording has no robot", "a simulator or a real robot")

    def say(event: Event) -> None:
        bus.publish(ROBOT_EVENTS, event)

    boot, latched, autostart = uuid4().hex[:16], spec.estop_reason, spec.autostart
    return Robot(spec.config, backend, control, say, boot=boot, estop_reason=latched, autostart=autostart)


def _hello(spec: SessionSpec, robot: Robot) -> Hello:
    backend, config = robot.backend, spec.config
    simulated = hasattr(backend, "take_shots")
    return Hello(robot.boot, 0, backend.t_ns, backend.rig, config.robot, config.run.seed, simulated)


def _go_on(node: RobotNode, robot: Robot, life: Life) -> None:
    """Run until the life is over, and a little longer to come to rest, after an error too."""
    try:
        while not life.over:
            if not node.turn():
                return
    except Exception:
        with suppress(Exception):  # the first error is the one to report
            _come_to_rest(node, robot)
        raise
    _come_to_rest(node, robot)


def _come_to_rest(node: RobotNode, robot: Robot) -> None:
    robot.stop_now("the robot node ends")
    end_s = monotonic() + LAST_HOLD_S
    while monotonic() < end_s and node.turn():
        pass


def _build(spec: SessionSpec) -> Backend:
    if spec.build is not None:
        return spec.build(spec)
    if spec.recording is not None:
        return build_backend(spec.config, spec.recording)
    return build_simulator(spec.config, "elsewhere")
