"""The server's end of a live session: starts its processes, keeps them alive, sends commands, passes on reports."""

import threading
from dataclasses import dataclass, field, replace
from time import monotonic

import structlog

from snakeslam.calibration import SensorRig
from snakeslam.claims import Claim, claim_temporary
from snakeslam.errors import SnakeslamError
from snakeslam.messages import MapChunk
from snakeslam.robot.model import snake_model
from snakeslam.runtime.assembly.spec import SessionSpec
from snakeslam.runtime.bus.bus import Bus
from snakeslam.runtime.bus.commands import Command, ControlPlayback, EStop, Shutdown, Stop
from snakeslam.runtime.bus.link import Link, unix_endpoint
from snakeslam.runtime.bus.sender import Sender
from snakeslam.runtime.bus.shapes import hello_sizes
from snakeslam.runtime.bus.topics import (
    CHUNKS,
    COMMANDS,
    ESTOP,
    FEATURES,
    HELLO,
    JPEG_IMAGES,
    ROBOT_EVENTS,
    ROBOT_STATE,
    SERVER_HEARTBEAT,
    SLAM_EVENTS,
    SLAM_STATE,
    Ended,
    Event,
    Report,
    Restarting,
    RobotState,
    Silence,
    SlamState,
)
from snakeslam.runtime.bus.wire import Heartbeat, Hello
from snakeslam.runtime.nodes.robot import run_robot
from snakeslam.runtime.nodes.slam import run_slam
from snakeslam.runtime.process.clock import RobotClock
from snakeslam.runtime.process.log_limit import LogLimit, error_words
from snakeslam.runtime.process.node import Child, spawn
from snakeslam.runtime.process.supervisor import Supervisor
from snakeslam.runtime.session import compose
from snakeslam.runtime.session.estop import EStopMemory
from snakeslam.runtime.session.pipe_host import Host, PipeHost, Put

HEARTBEAT_S = 0.05
END_S = 2.0
SILENT_S = 1.0
"""A node is shown as silent when its last state is older than this."""
SLOWEST_PULSE_S = 1.0
"""No heartbeat is sent when the server's event loop made no iteration for longer than this."""

_log = structlog.get_logger("host")
SILENT_ROBOT = "the robot node is silent: nothing is known of the robot"
BACK = "the robot node sends its state again"


def host_for(spec: SessionSpec, estop: EStopMemory) -> Host:
    """Return the host of a session: one process for a recording, else nodes on a bus that begin with ``estop``."""
    return PipeHost(spec) if spec.recording is not None else NodesHost(spec, estop, spec.link)


@dataclass(slots=True)
class _Known:
    """What has been received of the robot node that is there."""

    hello: Hello | None = None
    robot: RobotState | None = None
    robot_s: float = 0.0
    silent: bool = False
    slam: SlamState | None = None
    slam_s: float = 0.0
    started: bool = False
    """Whether ``Started`` has been reported."""
    chunks: list[MapChunk] = field(default_factory=list)
    """What slam sent before that."""


class NodesHost:
    """Robot and slam as supervised processes on a bus; with ``link`` they run elsewhere, and the host connects to them.

    A new robot node begins latched while ``estop`` is.
    """

    def __init__(self, spec: SessionSpec, estop: EStopMemory, link: Link | None = None) -> None:
        self._spec, self._link = spec, link
        self._folder: Claim | None = None
        self._bus: Bus | None = None
        self._supervisor: Supervisor | None = None
        self._clock, self._sender = RobotClock(), Sender()
        self._lock = threading.RLock()
        self._known = _Known()
        self._dead_boot: str | None = None
        self._estop = estop
        self._over = threading.Event()
        self._threads: list[threading.Thread] = []
        self._pulse_s = monotonic()
        self._put: Put = lambda _: None

    def start(self, put: Put) -> None:
        """Start the nodes, or connect to them; what goes wrong is reported to ``put``."""
        self._put = put
        link = self.link
        if self._link is None:
            self._supervisor = Supervisor(self._on_death)
            self._supervisor.start("robot", self._start_robot)
            self._supervisor.start("slam", lambda: spawn("snakeslam:slam", run_slam, self._spec.config, link))
        self._threads = [
            threading.Thread(target=self._connect, args=(link,), name="bus-connect", daemon=True),
            threading.Thread(target=self._send_heartbeats, name="server-heartbeat", daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    def send(self, command: Command, made_s: float | None = None) -> int:
        """Send a command to the robot node, stamped with the robot's time at ``made_s`` (monotonic, None: now)."""
        with self._lock:
            bus, now_ns = self._bus, self._clock.now_ns()
            if bus is None or (now_ns is None and not isinstance(command, EStop | Stop)):
                raise BrokenPipeError("no message of the robot has arrived yet")
            age_ns = 0 if made_s is None else round((monotonic() - made_s) * 1e9)
            if isinstance(command, ControlPlayback | Shutdown):
                raise BrokenPipeError(f"a robot has no {type(command).__name__}")
            sent = self._sender.stamped(command, (now_ns or 0) - age_ns)
            bus.publish(ESTOP if isinstance(command, EStop) else COMMANDS, sent)
            return sent.number

    def pulse(self) -> None:
        """Note an iteration of the server's event loop."""
        self._pulse_s = monotonic()

    def stop(self) -> None:
        """End the nodes that were started here."""
        self._over.set()
        for thread in self._threads:
            thread.join(END_S)
        if self._bus is not None:
            self._bus.close()
        if self._supervisor is not None:
            self._supervisor.close()
        if self._folder is not None:
            self._folder.remove()

    @property
    def link(self) -> Link:
        """The endpoint on which the nodes find each other."""
        if self._link is not None:
            return self._link
        if self._folder is None:
            self._folder = claim_temporary("snakeslam-bus-")
        return Link(unix_endpoint(self._folder.path))

    def _start_robot(self) -> Child:
        spec = replace(self._spec, estop_reason=self._estop.reason)
        # A robot node that is started again waits for a start, whatever it was doing.
        self._spec = replace(spec, autostart=False)
        return spawn("snakeslam:robot", run_robot, spec, replace(self.link, listens=True))

    def _connect(self, link: Link) -> None:
        try:
            bus = Bus(link, timeout_s=float("inf"), wanted=lambda: not self._over.is_set())
        except Exception as error:  # noqa: BLE001  (a thread that ends silently would leave the session starting)
            if not self._over.is_set():
                self._put(Ended(str(error) if isinstance(error, SnakeslamError) else error_words(error)))
            return
        bus.subscribe(HELLO, self._on_hello)
        bus.subscribe(ROBOT_STATE, self._on_robot_state)
        bus.subscribe(SLAM_STATE, self._on_slam_state)
        for topic in (JPEG_IMAGES, FEATURES, CHUNKS, ROBOT_EVENTS, SLAM_EVENTS):
            bus.subscribe(topic, self._on_report)
        self._bus = bus

    def _send_heartbeats(self) -> None:
        limit = LogLimit()
        while not self._over.wait(HEARTBEAT_S):
            try:
                self._send_heartbeat()
            except Exception as error:  # noqa: BLE001  (the next heartbeat may succeed)
                if (left_out := limit.due("heartbeat")) is not None:
                    _log.error("heartbeat not sent", reason=error_words(error), left_out=left_out)

    def _send_heartbeat(self) -> None:
        self._report_silence()
        bus, now_ns = self._bus, self._clock.now_ns()
        if bus is not None and now_ns is not None and monotonic() - self._pulse_s < SLOWEST_PULSE_S:
            bus.publish(SERVER_HEARTBEAT, Heartbeat(self._sender.name, now_ns))

    def _report_silence(self) -> None:
        with self._lock:
            known = self._known
            silent = known.started and monotonic() - known.robot_s > SILENT_S
            if silent != known.silent:
                known.silent = silent
                t_ns = 0 if known.robot is None else known.robot.t_ns
                self._put(Event(t_ns, "error" if silent else "info", SILENT_ROBOT if silent else BACK))
                self._put(Silence(SILENT_ROBOT if silent else None))

    def _on_hello(self, hello: Hello) -> None:
        with self._lock:
            if hello.boot == self._dead_boot:
                return
            if self._bus is not None:
                self._bus.expect(hello_sizes(hello))
            if self._known.hello is None or self._known.hello.boot != hello.boot:
                if self._known.started:
                    self._put(Restarting("the robot node was started again"))
                self._known = _Known(hello)
                self._clock.restart()
            self._report_started()

    def _on_robot_state(self, state: RobotState) -> None:
        with self._lock:
            known = self._known
            if known.hello is None or state.boot != known.hello.boot:
                return
            self._clock.add(state.stamp_ns)
            if known.robot is None and self._estop.reason is not None and state.estop_reason is None:
                self.send(EStop(self._estop.reason))  # Latched while this robot node was being made.
            known.robot, known.robot_s = state, monotonic()
            self._report_started()
            if known.started:
                alive = monotonic() - known.slam_s < SILENT_S
                self._put(compose.tick(state, known.slam, self._sender.name, slam_alive=alive))

    def _on_slam_state(self, state: SlamState) -> None:
        with self._lock:
            if self._known.hello is not None and state.boot == self._known.hello.boot:
                self._known.slam, self._known.slam_s = state, monotonic()
                self._report_started()

    def _on_report(self, report: Report) -> None:
        with self._lock:
            if not self._known.started and isinstance(report, MapChunk):
                self._known.chunks.append(report)
            else:
                self._put(report)

    def _report_started(self) -> None:
        """Report that the session runs, once both nodes do."""
        known = self._known
        if known.hello is None or known.robot is None or known.slam is None or known.started:
            return
        known.started = True
        model = None if known.hello.robot is None else snake_model(known.hello.robot)
        rig: SensorRig = known.hello.rig
        self._put(compose.started(known.robot.t_start_ns, known.slam.mode, rig, model, known.robot.gait))
        for chunk in known.chunks:
            self._put(chunk)
        known.chunks.clear()

    def _on_death(self, name: str, reason: str, final: bool) -> None:
        with self._lock:
            t_ns = 0 if self._known.robot is None else self._known.robot.t_ns
            if final:
                self._put(Ended(_end_reason(name, reason)))
                return
            self._put(Event(t_ns, "error", f"{NAMES[name]}: {reason}; it is started again"))
            if name == "robot":
                self._dead_boot = None if self._known.hello is None else self._known.hello.boot
                self._known = _Known()
                self._clock.restart()
                self._put(Restarting(f"{NAMES[name]}: {reason}"))


NAMES = {"robot": "the robot node", "slam": "the slam node"}


def _end_reason(name: str, reason: str) -> str | None:
    """Return why a session ended with the node ``name``; None when that was planned."""
    if not reason:
        return None if name == "robot" else f"{NAMES[name]} has ended"
    return f"{NAMES[name]}: {reason}" if reason.startswith("the process") else reason
