"""The session of a recording: one child process that plays it, at real time or as the operator asks (``playback``).

A recording needs no safety and misses no frame: the loop is that of a scripted run. The host starts it with a
``SessionSpec``, exchanges commands and reports with it over a pipe, and ends it. At the end of the recording it stays,
so that frames can be shown again. A live robot runs in `nodes.robot` and `nodes.slam` instead.
"""

import multiprocessing
import signal
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from time import monotonic

from snakeslam.backends.base import Backend
from snakeslam.config import Config
from snakeslam.errors import SnakeslamError
from snakeslam.messages import CameraFrame, Float, JointState, JointTarget, Packet
from snakeslam.runtime.assembly.build import build_backend, mode_for, with_recording
from snakeslam.runtime.assembly.spec import SessionSpec
from snakeslam.runtime.bus.commands import Command, ControlPlayback, Shutdown
from snakeslam.runtime.bus.topics import Answer, Ended, Event, Features, Report, RobotState
from snakeslam.runtime.process.priority import set_normal_priority
from snakeslam.runtime.session import compose
from snakeslam.runtime.session.lockstep import build_loop
from snakeslam.runtime.session.outbox import Outbox
from snakeslam.runtime.session.playback import MOMENTS_KEPT, Moment, Player
from snakeslam.runtime.slam.sensor_watch import SensorWatch
from snakeslam.runtime.view.jpeg import jpeg_of
from snakeslam.runtime.view.live import PERIOD_S, LiveSink
from snakeslam.threads import use_one_thread

IDLE_S = 0.25
"""How often the state is reported while the recording is paused or at its end."""


class _Sink(LiveSink):
    """Keeps the newest frame, and the newest joint angles, which live are reported by the robot node."""

    q_measured_rad: Float | None = None
    frame: CameraFrame | None = None
    watch: SensorWatch

    def on_packet(self, packet: Packet) -> None:
        super().on_packet(packet)
        self.watch.add_packet(packet)
        if isinstance(packet, JointState):
            self.q_measured_rad = packet.q_rad
        elif isinstance(packet, CameraFrame):
            self.frame = packet

    def on_target(self, target: JointTarget) -> None:
        raise AssertionError(f"a recording takes no target: {target}")


class Session:
    """The loop over a recording; without process or pipe."""

    def __init__(self, spec: SessionSpec, put: Callable[[Report], None]) -> None:
        assert spec.recording is not None
        self._put = put
        self.backend = build_backend(with_recording(spec.config, spec.recording))
        assert self.backend.recorded is not None
        self._recorded = self.backend.recorded
        config = _with_estimator_mode(spec, self.backend)
        self._mode = config.estimator.mode
        # The visual estimator takes its first camera image as level, however the camera was held.
        R_IC = self.backend.rig.cam0.T_IC[:3, :3]
        self._sink = _Sink(self.backend.model, self._on_report, R_IC, gravity_known=self._mode != "visual")
        self._sink.watch = SensorWatch.of(self.backend.rig, self._mode, joints=self.backend.model is not None)
        self._loop = build_loop(config, self.backend, self._sink)
        self._player = Player(self._recorded.frame_stamps_ns)
        self._moments: deque[Moment] = deque(maxlen=MOMENTS_KEPT)
        self._shown: Moment | None = None
        self._features: Features | None = None
        self._done, self._reported_s = 0, 0.0
        self._end_reported = False
        put(compose.started(self.backend.t_ns, self._mode, self.backend.rig, self.backend.model, None))
        for note in self._recorded.notes:
            put(Event(self.backend.t_ns, "warning", note))

    def on_command(self, command: Command) -> None:
        """Control the playback; other commands have no effect on a recording."""
        self._done += 1
        if isinstance(command, ControlPlayback):
            self._player.control(command)
            self._end_reported = self._end_reported and self._player.at_end
        self.report()

    def step(self) -> float:
        """Show the next frame if there is one; return the seconds until the one after it."""
        k = self._player.next()
        if k is None:
            return self._idle()
        if k > self._player.computed:
            frame = self._compute()
        else:
            frame, self._shown = self._recorded.read_frame(k), self._moments[k - self._player.oldest]
        self._player.on_shown(k)
        self._player.oldest = self._player.computed + 1 - len(self._moments)
        # While seeking, and at a high speed, not every frame is shown.
        if self._player.next() is None or monotonic() - self._reported_s >= PERIOD_S:
            self._show(frame)
        return self._player.wait_s()

    def report(self) -> None:
        """Send a tick now."""
        self._reported_s = monotonic()
        shown = self._shown
        robot = RobotState(
            boot="",
            stamp_ns=0,
            t_start_ns=0,
            t_ns=self.backend.t_ns if shown is None else shown.t_ns,
            moving=False,
            estop_reason=None,
            held_because=None,
            gait=None,
            head_settings=None,
            notice=None,
            period_s=None,
            realtime_factor=self._player.pace,
            q_target_rad=None,
            q_measured_rad=None if shown is None else shown.q_measured_rad,
            answers=(Answer("", self._done),),
        )
        slam = None if shown is None else shown.full_state(self.backend.model)
        self._put(replace(compose.tick(robot, slam, ""), playback=self._player.state()))

    def _compute(self) -> CameraFrame:
        """Run the estimator through the packets up to the next frame, and keep its result there."""
        self._sink.frame = None
        while self._sink.frame is None:
            if not self._loop.step():
                raise SnakeslamError("the recording ended before its last frame")
        if self._player.computed + 2 == self._player.count:
            self._loop.step()  # The end of the recording has the ground truth of the last frame.
        assert self._features is not None
        state = self._sink.state("", self._mode, self._sink.watch.faults())
        self._shown = Moment.of(state, self._sink.q_measured_rad, self._features)
        self._moments.append(self._shown)
        return self._sink.frame

    def _show(self, frame: CameraFrame) -> None:
        """Send the frame's image, its features and a tick."""
        assert self._shown is not None
        self._put(jpeg_of(frame))
        self._put(self._shown.features())
        self.report()

    def _idle(self) -> float:
        """Report the unchanged state every IDLE_S, and the end of the recording once."""
        if monotonic() - self._reported_s >= IDLE_S:
            self.report()
        if self._player.at_end and not self._end_reported:
            self._end_reported = True
            self.report()
            self._put(Ended(None))
        return IDLE_S

    def _on_report(self, report: Report) -> None:
        """Pass on a report of the sink; features are kept until their frame is shown."""
        if isinstance(report, Features):
            self._features = report
        else:
            self._put(report)


def _with_estimator_mode(spec: SessionSpec, backend: Backend) -> Config:
    mode = mode_for(backend) if spec.estimator_mode is None else spec.estimator_mode
    return spec.config.model_copy(update={"estimator": spec.config.estimator.model_copy(update={"mode": mode})})


def run_session(spec: SessionSpec, pipe: "Connection[Report, Command]") -> None:
    """Run a session to its end; the child's entry point."""
    # Ctrl-C reaches the whole terminal group; the host decides when the session ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    set_normal_priority()
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
    wait_s = 0.0
    try:
        while not outbox.broken and _handle_commands(session, pipe, wait_s):
            wait_s = session.step()
    finally:
        session.backend.close()
    outbox.put(Ended(None))


def _handle_commands(session: Session, pipe: "Connection[Report, Command]", wait_s: float) -> bool:
    """Handle commands for ``wait_s``, at least those that are there; return False when the session is to end."""
    until = monotonic() + wait_s
    try:
        while pipe.poll(max(0.0, until - monotonic())):
            command = pipe.recv()
            if isinstance(command, Shutdown):
                return False
            session.on_command(command)
            until = monotonic()
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
