"""The session of a recording: one child process that plays it at its own pace.

A recording has nothing to protect and nothing to lose: slam waits for every picture. The host starts it with a
``SessionSpec`` and talks to it over a pipe (``topics``); it ends with its host. A robot runs in ``robot_node`` and
``slam_node`` instead.
"""

import multiprocessing
import signal
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from time import monotonic

from snakeslam.backends.base import Backend
from snakeslam.backends.replay.backend import ReplayBackend
from snakeslam.config import Config
from snakeslam.errors import SnakeslamError
from snakeslam.messages import CameraFrame, Float, JointState, JointTarget, Packet
from snakeslam.runtime import compose
from snakeslam.runtime.assembly import build_backend, build_slam, mode_for
from snakeslam.runtime.live import LiveSink
from snakeslam.runtime.lockstep import Loop
from snakeslam.runtime.outbox import Outbox
from snakeslam.runtime.pacing import Pacer
from snakeslam.runtime.pictures import Pictures
from snakeslam.runtime.priority import go_along
from snakeslam.runtime.sensor_watch import SensorWatch
from snakeslam.runtime.spec import SessionSpec
from snakeslam.runtime.topics import Answer, Command, Ended, Event, Report, RobotState, Shutdown
from snakeslam.threads import use_one_thread


class _Sink(LiveSink):
    """Keeps the measured angles too, which otherwise the robot tells of, and shows the pictures."""

    q_measured_rad: Float | None = None
    pictures: Pictures
    watch: SensorWatch

    def on_packet(self, packet: Packet) -> None:
        super().on_packet(packet)
        self.watch.add_packet(packet)
        if isinstance(packet, JointState):
            self.q_measured_rad = packet.q_rad
        elif isinstance(packet, CameraFrame):
            self.pictures.show(packet)

    def on_target(self, target: JointTarget) -> None:
        raise AssertionError(f"a recording takes no target: {target}")


class Session:
    """The loop over a recording, in the child; no process or pipe in sight."""

    def __init__(self, spec: SessionSpec, put: Callable[[Report], None]) -> None:
        self._put = put
        self.backend = spec.build(spec) if spec.build is not None else build_backend(spec.config, spec.recording)
        self._done = 0
        self._pacer = Pacer()
        config = _with_estimator_mode(spec, self.backend)
        self._mode = config.estimator.mode
        # The visual estimator starts level with its camera, however that is held.
        R_IC = self.backend.rig.cam0.T_IC[:3, :3]
        self._sink = _Sink(self.backend.model, put, R_IC, gravity_known=self._mode != "visual")
        self._sink.pictures = Pictures(put)
        self._sink.watch = SensorWatch.of(self.backend.rig, self._mode, joints=self.backend.model is not None)
        self._loop = Loop(self.backend, None, build_slam(config, self.backend), self._sink)
        put(compose.started(self.backend.t_ns, self._mode, self.backend.rig, self.backend.model, None))
        for note in self.backend.notes if isinstance(self.backend, ReplayBackend) else ():
            put(Event(self.backend.t_ns, "warning", note))

    def take(self, command: Command) -> None:
        """Answer a command: there is nothing here that could obey."""
        del command
        self._done += 1
        self.report()

    def step(self) -> float | None:
        """Advance one step; return the seconds to wait for real time, None at the end."""
        if not self._loop.step():
            self.report()
            return None
        if self._sink.due():
            self.report()
        return self._pacer.wait_s(self.backend.t_ns)

    def report(self) -> None:
        """Send a tick now."""
        robot = RobotState(
            boot="",
            stamp_ns=0,
            t_start_ns=0,
            t_ns=self.backend.t_ns,
            moving=False,
            estop_reason=None,
            held_because=None,
            gait=None,
            head_settings=None,
            notice=None,
            period_s=None,
            realtime_factor=self._pacer.realtime_factor,
            q_target_rad=None,
            q_measured_rad=self._sink.q_measured_rad,
            answers=(Answer("", self._done),),
        )
        self._put(compose.tick(robot, self._sink.state("", self._mode, self._sink.watch.faults()), ""))


def _with_estimator_mode(spec: SessionSpec, backend: Backend) -> Config:
    mode = spec.estimator_mode
    if mode is None and spec.recording is not None:
        mode = mode_for(backend)
    if mode is None:
        return spec.config
    return spec.config.model_copy(update={"estimator": spec.config.estimator.model_copy(update={"mode": mode})})


def run_session(spec: SessionSpec, pipe: "Connection[Report, Command]") -> None:
    """Run a session to its end; the child's entry point."""
    # Ctrl-C reaches the whole terminal group; the host decides when the session ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    go_along()
    outbox = Outbox(pipe)
    try:
        _run(spec, pipe, outbox)
    except SnakeslamError as error:
        outbox.put(Ended(str(error)))
    except BaseException as error:
        outbox.put(Ended(" ".join(f"{type(error).__name__}: {error}".split())))
        raise
    finally:
        outbox.close()
        pipe.close()


def _run(spec: SessionSpec, pipe: "Connection[Report, Command]", outbox: Outbox) -> None:
    session = Session(spec, outbox.put)
    wait_s: float | None = 0.0
    try:
        while wait_s is not None and not outbox.broken:
            if not _obey(session, pipe, wait_s):
                break
            wait_s = session.step()
    finally:
        session.backend.close()
    outbox.put(Ended(None))


def _obey(session: Session, pipe: "Connection[Report, Command]", wait_s: float) -> bool:
    """Take commands for ``wait_s``, at least those that are there; False when the session shall end."""
    until = monotonic() + wait_s
    try:
        while pipe.poll(max(0.0, until - monotonic())):
            command = pipe.recv()
            if isinstance(command, Shutdown):
                return False
            session.take(command)
    except (EOFError, OSError):
        return False  # The host is gone.
    return True


def start_session(spec: SessionSpec) -> "tuple[BaseProcess, Connection[Command, Report]]":
    """Start the child; return its process and the host's end of the pipe."""
    use_one_thread()
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=run_session, args=(spec, theirs), name="snakeslam-session", daemon=True)
    process.start()
    theirs.close()
    return process, ours
