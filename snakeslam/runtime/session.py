"""The live session: one child process that runs the paced loop of a simulator or a recording.

The host starts it with a ``SessionSpec`` and talks to it over a pipe (``topics``). It ends with its host.
"""

import multiprocessing
import signal
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from time import monotonic

import numpy as np

from snakeslam.backends.base import Backend
from snakeslam.config import Config
from snakeslam.errors import InputError, SnakeslamError
from snakeslam.estimation.settings import Mode
from snakeslam.gaits.advance import advance_notice
from snakeslam.gaits.catalogue import resolve
from snakeslam.gaits.command import commanded_gait
from snakeslam.messages import GaitCommand, HeadCommand
from snakeslam.runtime.assembly import build_backend, build_control, build_governor, build_slam, mode_for
from snakeslam.runtime.live import LiveSink
from snakeslam.runtime.lockstep import Loop
from snakeslam.runtime.outbox import Outbox
from snakeslam.runtime.pacing import Pacer
from snakeslam.runtime.safety import Guard, GuardedBackend
from snakeslam.runtime.topics import (
    Command,
    Drive,
    Ended,
    EStop,
    Event,
    Refusal,
    Report,
    ResetEStop,
    RobotShape,
    SetGait,
    SetHead,
    Shutdown,
    Start,
    Started,
    Stop,
)
from snakeslam.runtime.words import head_words
from snakeslam.threads import use_one_thread

REFUSALS_KEPT = 8
DRIVE_FOR_S = 0.3
"""A robot that is driven by hand stops when the hand has been silent for so long."""


@dataclass(frozen=True, slots=True)
class SessionSpec:
    """What a session runs: the simulator of ``config``, or the ``recording`` when there is one.

    ``estimator_mode`` None takes the configured one, for a recording the one that its sensors allow. ``estop_reason``:
    start latched; ``autostart``: set the gait going after ``run.rest_s``. ``build`` makes the backend, in the child.
    """

    config: Config
    recording: Path | None = None
    estimator_mode: Mode | None = None
    estop_reason: str | None = None
    autostart: bool = False
    build: "Callable[[SessionSpec], Backend] | None" = None


class Session:
    """The loop with its commands, in the child; no process or pipe in sight."""

    def __init__(self, spec: SessionSpec, put: Callable[[Report], None]) -> None:
        self._put = put
        backend = spec.build(spec) if spec.build is not None else build_backend(spec.config, spec.recording)
        self._model = backend.model
        self._guard: Guard | None = None
        self._control = build_control(spec.config, backend)
        if self._control is not None and backend.model is not None:
            self._guard = Guard(backend.model.limits, spec.estop_reason)
            backend = GuardedBackend(backend, self._guard)
        self.backend = backend
        self._gait = configured_gait(spec.config) if self._control else None
        self._moving = False
        self._driven_s: float | None = None
        self._notice: str | None = None
        self._done = 0
        self._refusals: deque[Refusal] = deque(maxlen=REFUSALS_KEPT)
        self._pacer = Pacer()
        config = _with_estimator_mode(spec, backend)
        # The visual estimator starts level with its camera, however that is held.
        self._sink = LiveSink(
            backend.model, put, backend.rig.cam0.T_IC[:3, :3], gravity_known=config.estimator.mode != "visual"
        )
        slam, self._governor = build_slam(config, backend), build_governor(config)
        self._loop = Loop(backend, self._control, slam, self._sink, self._governor)
        self._configured = spec.config.gait
        self._judge_gait()
        self._autostart_ns = backend.t_ns + round(config.run.rest_s * 1e9) if spec.autostart else None
        put(_started(backend, config.estimator.mode, self._gait))

    def take(self, command: Command) -> None:
        """Obey a command at once; the next joint target already does.

        What cannot be done changes nothing and is told.
        """
        try:
            self._do(command)
        except InputError as error:
            self._refusals.append(Refusal(self._done + 1, str(error)))
            self._say("error", str(error))
        self._done += 1
        self.report()

    def _do(self, command: Command) -> None:
        if isinstance(command, EStop):
            self._estop(command.reason)
        elif isinstance(command, ResetEStop):
            self._reset()
        elif isinstance(command, SetGait):
            self._command(0.0 if self._gait is None else self._gait.drive, command.gait)
        elif isinstance(command, SetHead):
            self._set_head(command.head)
        elif isinstance(command, Start):
            self._start()
        elif isinstance(command, Drive):
            self._drive(command)
        elif isinstance(command, Stop):
            self._autostart_ns = None
            self._command(0.0)

    def step(self) -> float | None:
        """Advance one step; return the seconds to wait for real time, None at the end."""
        if self._autostart_ns is not None and self.backend.t_ns >= self._autostart_ns:
            self._start()
        if self._driven_s is not None and monotonic() - self._driven_s > DRIVE_FOR_S:
            self._say("warning", "the drive input fell silent")
            self._command(0.0)
        if not self._loop.step():
            self.report()
            return None
        if self._sink.due():
            self.report()
        return self._pacer.wait_s(self.backend.t_ns)

    def report(self) -> None:
        """Send a tick now."""
        self._sink.tick(
            t_ns=self.backend.t_ns,
            commands_done=self._done,
            moving=self._moving,
            estop_reason=None if self._guard is None else self._guard.reason,
            gait=self._gait,
            head_settings=None if self._control is None else self._control.head,
            notice=self._notice,
            refusals=tuple(self._refusals),
            governed=None if self._governor is None or self._control is None else self._governor.now,
            realtime_factor=self._pacer.realtime_factor,
        )

    def _estop(self, reason: str) -> None:
        self._autostart_ns = None
        if self._guard is None or self._guard.reason is not None:
            return
        self._guard.latch(reason)
        self._command(0.0)
        self._say("error", f"E-stop: {reason}")

    def _reset(self) -> None:
        if self._guard is None or self._guard.reason is None:
            return
        self._guard.reset()
        self._say("info", "E-stop cleared; start to move again")

    def _start(self) -> None:
        self._autostart_ns = None
        if self._guard is None or self._guard.reason is not None:
            return
        self._guard.resume()
        self._driven_s = None
        self._command(1.0)

    def _drive(self, command: Drive) -> None:
        """Move as the operator's hand says, for DRIVE_FOR_S; nothing while latched."""
        if self._guard is None or self._gait is None or self._guard.reason is not None:
            return
        self._autostart_ns = None
        if command.drive != 0.0:
            self._guard.resume()
        if (command.drive, command.turn) != (self._gait.drive, self._gait.turn):
            self._command(command.drive, replace(self._gait, turn=command.turn))
        self._driven_s = monotonic() if command.drive != 0.0 else None

    def _command(self, drive: float, gait: GaitCommand | None = None) -> None:
        """Command ``gait`` (else the one there is); InputError, and no change, where it cannot be done."""
        gait = gait or self._gait
        if self._control is None or gait is None:
            return
        gait, moving = replace(gait, t_ns=self.backend.t_ns, drive=drive), drive != 0.0
        self._control.command(gait)
        if not moving:
            self._driven_s = None
        if moving != self._moving:
            self._say("info", f"start {gait.gait}" if moving else "stop")
        self._moving, self._gait = moving, gait
        self._judge_gait()

    def _judge_gait(self) -> None:
        """Take the gait's period and what the operator should know of it."""
        if self._model is None or self._gait is None:
            return
        gait = resolve(commanded_gait(self._gait, self._configured), self._model)
        self._notice = advance_notice(gait)
        self._sink.set_period(2.0 * np.pi / gait.omega)

    def _set_head(self, command: HeadCommand) -> None:
        if self._control is None:
            return
        before = self._control.head
        self._control.command_head(replace(command, t_ns=self.backend.t_ns))
        for text in head_words(before, self._control.head, command):
            self._say("info", text)

    def _say(self, level: str, text: str) -> None:
        self._put(Event(self.backend.t_ns, level, text))


def configured_gait(config: Config) -> GaitCommand:
    """Return the configured gait at rest."""
    gait = config.gait
    return GaitCommand(
        t_ns=0,
        gait=gait.name,
        drive=0.0,
        alpha_pi=gait.alpha_pi,
        wavelength_joints=gait.wavelength_joints,
        period_s=gait.period_s,
        amplitude_deg=gait.amplitude_deg,
    )


def _with_estimator_mode(spec: SessionSpec, backend: Backend) -> Config:
    mode = spec.estimator_mode
    if mode is None and spec.recording is not None:
        mode = mode_for(backend)
    if mode is None:
        return spec.config
    return spec.config.model_copy(update={"estimator": spec.config.estimator.model_copy(update={"mode": mode})})


def _started(backend: Backend, mode: str, gait: GaitCommand | None) -> Started:
    camera, model = backend.rig.cam0, backend.model
    width, height = camera.resolution
    shape = None
    if model is not None:
        shape = RobotShape(model.name, model.joint_count, model.joint_length_m, model.radius_m)
    fov_y_rad = 2.0 * float(np.arctan2(height / 2.0, camera.intrinsics[1]))
    return Started(backend.t_ns, mode, shape, camera.T_IC, fov_y_rad, width / height, gait)


def run_session(spec: SessionSpec, pipe: "Connection[Report, Command]") -> None:
    """Run a session to its end; the child's entry point."""
    # Ctrl-C reaches the whole terminal group; the host decides when the session ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
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
