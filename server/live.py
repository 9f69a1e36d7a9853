"""The live session as the server sees it: its processes, their newest reports, and commands to them."""

import asyncio
import contextlib
import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from http import HTTPStatus
from time import monotonic
from typing import Literal

import numpy as np
import structlog

from server.background import attempt, keep_on
from server.problem import Problem
from snakeslam.config import Config
from snakeslam.gaits.command import configured_gait
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import Float, GaitCommand, MapChunk
from snakeslam.runtime.assembly.spec import SessionSpec
from snakeslam.runtime.bus.commands import BackUp, Command, ControlPlayback, EStop, ResetEStop, Start
from snakeslam.runtime.bus.topics import Ended, Event, Opening, Report, Restarting, Silence, Started, Tick
from snakeslam.runtime.session.estop import EStopMemory
from snakeslam.runtime.session.host import host_for
from snakeslam.runtime.session.pipe_host import Host

NS = 1e-9
CONFIRM_S, ESTOP_CONFIRM_S = 2.0, 0.5
REPEAT_S = 0.05
"""An E-stop that is pressed again and again is handed on so often."""
PULSE_S = 0.1
FROZEN_S, AWAKE_S = 1.0, 0.5
"""After a freeze of the first, starts are refused for the second: they may have waited in the socket."""
MAX_PATH = 20_000
REST_M = 5e-4
"""A robot whose head moves less between two rows of its path rests."""
Phase = Literal["starting", "running", "ended", "failed"]
_log = structlog.get_logger("live")


@dataclass(slots=True)
class Path3:
    """Positions over time: rows of (t_s, x, y, z), thinned whenever they are too many, at rest before in motion."""

    rows: list[tuple[float, float, float, float]] = field(default_factory=list)
    _texts: list[str] = field(default_factory=list)
    _every: int = 1
    _count: int = 0
    _newest_s: float = -math.inf

    def add(self, t_s: float, T_WI: Float) -> None:
        """Append a position, if it is its turn and newer than those that are known."""
        if t_s <= self._newest_s:
            return  # A recording that is looked at again.
        self._newest_s = t_s
        self._count += 1
        if self._count % self._every:
            return
        x, y, z = T_WI[:3, 3].tolist()
        self.rows.append((round(t_s, 4), x, y, z))
        self._texts.append(json.dumps(self.rows[-1], separators=(",", ":")))
        if len(self.rows) > MAX_PATH:
            self._thin()

    def _thin(self) -> None:
        """Drop every second row of those at rest; of all, where a robot in motion takes most of the room."""
        steps_m = np.linalg.norm(np.diff([row[1:] for row in self.rows], axis=0), axis=1)
        resting = np.r_[steps_m < REST_M, False] & np.r_[False, steps_m < REST_M]
        if MAX_PATH // 4 < resting.sum() < len(self.rows) - 2:
            kept = ~(resting & (resting.cumsum() % 2 == 0))
        else:
            kept = np.arange(len(self.rows)) % 2 == 0
            self._every *= 2
        self.rows = [self.rows[k] for k in np.flatnonzero(kept)]
        self._texts = [self._texts[k] for k in np.flatnonzero(kept)]

    def text(self) -> str:
        """The rows as JSON, without the brackets around them; each was written when it came."""
        return ",".join(self._texts)


@dataclass(slots=True)
class View:
    """All that is known of the session that runs, or ran last."""

    kind: Literal["sim", "recording"]
    name: str
    config: Config
    number: int = 0
    """Counts the sessions of this server: another number, another session."""
    phase: Phase = "starting"
    message: str | None = None
    started: Started | None = None
    tick: Tick | None = None
    chunks: dict[int, MapChunk] = field(default_factory=dict)
    map_revision: int = 0
    """Grows with every change of ``chunks``."""
    estimate: Path3 = field(default_factory=Path3)
    truth: Path3 = field(default_factory=Path3)
    new_map: Path3 = field(default_factory=Path3)
    """The part of the estimate that lies in a map which is not connected to the first one; empty once it is."""

    def t_s(self, t_ns: int) -> float:
        """Seconds since the session's start."""
        return 0.0 if self.started is None else (t_ns - self.started.t_start_ns) * NS

    def take(self, report: Report) -> None:
        """Keep what a report says."""
        if isinstance(report, Started):
            self._begin(report)
        elif isinstance(report, Restarting):
            self.phase, self.message, self.tick = "starting", report.reason, None
        elif isinstance(report, Silence):
            self.message = report.reason
        elif isinstance(report, Tick):
            self._take_tick(report)
        elif isinstance(report, MapChunk):
            known = self.chunks.get(report.key)
            if known is None or known.revision <= report.revision:
                self.chunks[report.key] = report
                self.map_revision += 1
        elif isinstance(report, Ended):
            self.phase, self.message = ("ended", None) if report.error is None else ("failed", report.error)

    def _begin(self, started: Started) -> None:
        """Begin, or begin anew: a robot node that was started again has a time and a world of its own."""
        self.phase, self.message = "running", None
        if self.started is not None:
            self.tick, self.chunks = None, {}
            self.estimate, self.truth, self.new_map = Path3(), Path3(), Path3()
            self.map_revision += 1
        self.started = started

    def _take_tick(self, tick: Tick) -> None:
        for path, T in ((self.estimate, tick.T_WI), (self.truth, tick.T_WI_truth)):
            if T is not None:
                path.add(self.t_s(tick.t_ns), T)
        if tick.playback is None or tick.playback.position_s == tick.playback.computed_s:
            self._take_new_map(tick)  # Not where a recording is looked at again.
        self.tick = tick
        if tick.playback is not None and self.phase in ("running", "ended"):
            self.phase = "ended" if tick.playback.at_end else "running"

    def _take_new_map(self, tick: Tick) -> None:
        """Keep the path in a map that is not connected; once it is, its positions were moved with the map."""
        if tick.health.map_connected and tick.T_WI is not None and self.new_map.rows:
            self.new_map = Path3()
        elif tick.T_WI is not None and not tick.health.map_connected:
            self.new_map.add(self.t_s(tick.t_ns), tick.T_WI)


Listener = Callable[[Report, View], None]


class Live:
    """Starts, supervises and commands the session; one at a time. All methods belong to the event loop's thread."""

    def __init__(self, config: Config, host: Callable[[SessionSpec, EStopMemory], Host] = host_for) -> None:
        self._host_for = host
        self._listeners: list[Listener] = []
        self._starting = asyncio.Lock()
        self._child: _Child | None = None
        self._estop = EStopMemory()
        self._resetting = 0
        self.view = View("sim", "simulator", config, phase="ended")

    def listen(self, listener: Listener) -> None:
        """Have every report of every session from now on."""
        self._listeners.append(listener)

    @property
    def estop_reason(self) -> str | None:
        """Why the E-stop is latched; it outlives sessions."""
        return self._estop.reason

    async def start(self, spec: SessionSpec, kind: Literal["sim", "recording"], name: str) -> None:
        """End the session that runs and start another; a latched E-stop stays latched."""
        async with self._starting:
            await self.stop()
            self.view = View(kind, name, spec.config, number=self.view.number + 1)
            self._tell(Opening())
            self._tell(Event(0, "info", f"starting {name}"))
            self._child = _Child(self._host_for(spec, self._estop), self._report)
            await self._child.start()

    async def stop(self) -> None:
        """End the session that runs, if any."""
        child, self._child = self._child, None
        if child is not None:
            await child.stop()

    async def command(self, command: Command, made_s: float | None = None) -> None:
        """Send a command made at ``made_s`` (monotonic, None: now), wait until it is obeyed; Problem when it cannot."""
        child = self._child
        if child is None or self.view.phase in ("ended", "failed"):
            raise Problem(HTTPStatus.CONFLICT, "no session is running; start the simulator first")
        if self.view.phase == "starting":
            raise Problem(HTTPStatus.CONFLICT, "the session is still starting; try again in a moment")
        await self._send(child, command, monotonic() if made_s is None else made_s)

    async def control_playback(self, command: ControlPlayback) -> None:
        """Control how the recording plays, also after its end; Problem where none is open."""
        child = self._child
        if child is None or self.view.kind != "recording" or self.view.phase == "failed":
            raise Problem(HTTPStatus.CONFLICT, "no recording is open; POST /recordings/{id}/play opens one")
        if self.view.phase == "starting":
            raise Problem(HTTPStatus.CONFLICT, "the recording is still being opened; try again in a moment")
        await self._send(child, command)

    async def _send(self, child: "_Child", command: Command, made_s: float | None = None) -> None:
        try:
            # Sending only hands over to the threads of the bus: it never waits, and so needs no thread of its own,
            # for which it would have to queue behind others' work.
            refusal = await child.obeyed(child.host.send(command, made_s))
        except (OSError, TimeoutError) as error:
            raise Problem(HTTPStatus.SERVICE_UNAVAILABLE, "the session did not answer") from error
        if refusal is not None:
            raise Problem(HTTPStatus.CONFLICT, refusal)

    @property
    def latched(self) -> bool:
        """Whether the robot itself has said that its E-stop is latched, and nobody is clearing it."""
        tick = self.view.tick
        told = self.view.phase == "running" and tick is not None and tick.estop_reason is not None
        return told and self._estop.reason is not None and not self._resetting

    async def estop(self, reason: str) -> bool:
        """Latch the E-stop here, for every session to come, and in the one that runs; return whether that confirmed it.

        It is sent before anything is waited for. An E-stop that the robot has confirmed is not waited for again, but
        still sent, REPEAT_S apart.
        """
        self._estop.latch(reason)
        child = self._child
        if child is None or self.view.phase in ("ended", "failed"):
            return True  # Nothing runs that could move.
        if self.latched:
            child.repeat(EStop(reason))
            return True
        try:
            number = child.host.send(EStop(reason))
            # A command sent after it may be there before it: then it has not come yet.
            return await child.obeyed(number, ESTOP_CONFIRM_S) is None or self.latched
        except (OSError, TimeoutError):
            return False  # The host sends it again when the robot is there.

    async def reset_estop(self) -> None:
        """Clear the latch; nothing moves for it.

        The session goes first: a tick that was on its way when it obeyed would latch again. An E-stop pressed meanwhile
        stays.
        """
        latched = self._estop.latched
        self._resetting += 1
        try:
            await self._urgent(ResetEStop())
        finally:
            self._resetting -= 1
        self._estop.clear(latched)

    async def _urgent(self, command: Command) -> None:
        """Send at any time: a session that is still being built takes it before its first step."""
        child = self._child
        if child is None or self.view.phase in ("ended", "failed"):
            return
        if self.view.phase == "running":
            await self._send(child, command)
        else:
            # Not there yet: it hears of it when it is (the host sees to that, or ``start`` does).
            with contextlib.suppress(OSError):
                child.host.send(command)

    async def move(self) -> None:
        """Set the robot going; Problem while the E-stop is latched or there is no robot."""
        self._need_fresh_start()
        await self.command(Start())

    async def back_up(self) -> None:
        """Have the robot play its gait backwards for a while; Problem where a start would be one."""
        self._need_fresh_start()
        await self.command(BackUp())

    def _need_fresh_start(self) -> None:
        """Raise a Problem when nothing may start, or the request may have waited for the end of a freeze."""
        self.need_drive()
        if self._child is not None and self._child.stood_still:
            raise Problem(HTTPStatus.CONFLICT, "the server stood still meanwhile; start again")

    def need_drive(self) -> None:
        """Raise a Problem when nothing may move: the E-stop is latched, or there is no robot."""
        if self._estop.reason is not None:
            raise Problem(HTTPStatus.CONFLICT, "the E-stop is latched; reset it first")
        self.need_robot()

    def need_robot(self) -> None:
        """Raise a Problem when nothing here can move."""
        if self.view.kind == "recording":
            raise Problem(HTTPStatus.CONFLICT, "a recording is playing: there is no robot to command")

    @property
    def moving(self) -> bool:
        """Whether the robot is told to move."""
        return self.view.phase == "running" and self.view.tick is not None and self.view.tick.moving

    def gait(self) -> GaitCommand:
        """The gait that the session has now; the configured one where there is no robot."""
        tick = self.view.tick
        return tick.gait if tick is not None and tick.gait is not None else configured_gait(self.view.config.gait)

    def head(self) -> HeadSettings | None:
        """The head settings that the session has now; None where there is no robot."""
        if self.view.kind == "recording":
            return None
        tick = self.view.tick
        return tick.head_settings if tick is not None and tick.head_settings is not None else self.view.config.head

    def _report(self, child: "_Child", report: Report) -> None:
        if child is not self._child:
            return  # The last words of a session that was replaced.
        self.view.take(report)
        if isinstance(report, Tick):
            self._estop.report(report.estop_reason)
        if isinstance(report, Ended) and report.error is not None:
            _log.error("session failed", reason=report.error)
        self._tell(report)

    def _tell(self, report: Report) -> None:
        for listener in self._listeners:
            attempt("a listener of the session", partial(listener, report, self.view))


class _Child:
    """A session's host, and the numbers of the commands that were sent to it."""

    def __init__(self, host: Host, report: "Callable[[_Child, Report], None]") -> None:
        self.host, self._report = host, report
        self._loop = asyncio.get_running_loop()
        self._done = 0
        self._refusals: dict[int, str] = {}
        self._progress = asyncio.Event()
        self._repeat_s, self._repeating = 0.0, False
        self._pulsed_s, self._awake_s = monotonic(), 0.0
        self._pulse = asyncio.create_task(self._pulse_on())

    async def start(self) -> None:
        """Start the session's processes."""
        await asyncio.to_thread(self.host.start, self._hand_over)

    async def stop(self) -> None:
        """End them."""
        self._pulse.cancel()
        await asyncio.to_thread(self.host.stop)

    def repeat(self, command: EStop) -> None:
        """Send an E-stop that is latched already: now, or with others that come within REPEAT_S after the last."""
        wait_s = self._repeat_s + REPEAT_S - self._loop.time()
        if wait_s <= 0.0:
            self._send_again(command)
        elif not self._repeating:
            self._repeating = True
            self._loop.call_later(wait_s, self._send_again, command)

    def _send_again(self, command: EStop) -> None:
        self._repeat_s, self._repeating = self._loop.time(), False
        with contextlib.suppress(OSError):  # a session that has ended meanwhile
            self.host.send(command)

    async def obeyed(self, number: int, timeout_s: float = CONFIRM_S) -> str | None:
        """Wait for the session's answer and return why it refused, None when it obeyed; TimeoutError without answer."""
        async with asyncio.timeout(timeout_s):
            while self._done < number:
                self._progress.clear()
                await self._progress.wait()
        return self._refusals.get(number)

    @property
    def stood_still(self) -> bool:
        """Whether this loop has only just gone on after a freeze: what it reads now may have waited all the while."""
        now_s = monotonic()
        return now_s < self._awake_s or now_s - self._pulsed_s > FROZEN_S

    async def _pulse_on(self) -> None:
        """Tell the robot that this loop, and not just the process, is alive."""
        await keep_on("the server's pulse", self._pulse_once)

    async def _pulse_once(self) -> None:
        now_s = monotonic()
        # By the time since the last pulse alone, or the time after a freeze would be prolonged by itself for ever.
        if now_s - self._pulsed_s > FROZEN_S:
            self._awake_s = now_s + AWAKE_S
        self._pulsed_s = now_s
        self.host.pulse()
        await asyncio.sleep(PULSE_S)

    def _hand_over(self, report: Report) -> None:
        # A closed loop means that the server has ended; nobody listens any more.
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._take, report)

    def _take(self, report: Report) -> None:
        if isinstance(report, Tick):
            self._done = report.commands_done
            self._refusals = {refusal.number: refusal.reason for refusal in report.refusals}
            self._progress.set()
        attempt("a report of the session", partial(self._report, self, report))
