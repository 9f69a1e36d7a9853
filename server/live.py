"""The live session: starts and ends its processes, commands them, and passes their reports on. One at a time."""

import asyncio
import contextlib
from collections.abc import Callable
from functools import partial
from http import HTTPStatus
from time import monotonic

import structlog

from server.background import attempt
from server.models import SourceKind
from server.problem import Problem
from server.session_link import SessionLink
from server.view import View
from snakeslam.config import Config
from snakeslam.gaits.command import configured_gait
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import GaitCommand
from snakeslam.runtime.assembly.spec import SessionSpec
from snakeslam.runtime.bus.commands import BackUp, Command, ControlPlayback, EStop, ResetEStop, Start
from snakeslam.runtime.bus.topics import Ended, Event, Opening, Report, Tick
from snakeslam.runtime.session.estop import EStopMemory
from snakeslam.runtime.session.host import host_for
from snakeslam.runtime.session.pipe_host import Host

ESTOP_CONFIRM_S = 0.5
_log = structlog.get_logger("live")
Listener = Callable[[Report, View], None]


class Live:
    """Starts, supervises and commands the session; one at a time. All methods belong to the event loop's thread."""

    def __init__(self, config: Config, host: Callable[[SessionSpec, EStopMemory], Host] = host_for) -> None:
        self._host_for = host
        self._listeners: list[Listener] = []
        self._starting = asyncio.Lock()
        self._link: SessionLink | None = None
        self._estop = EStopMemory()
        self._resetting = 0
        self.view = View("sim", "simulator", config, phase="ended")

    def subscribe(self, listener: Listener) -> None:
        """Call ``listener`` with every report of every session from now on."""
        self._listeners.append(listener)

    @property
    def estop_reason(self) -> str | None:
        """Why the E-stop is latched; it outlives sessions."""
        return self._estop.reason

    async def start(self, spec: SessionSpec, kind: SourceKind, name: str) -> None:
        """End the session that runs and start another; a latched E-stop stays latched."""
        async with self._starting:
            await self.stop()
            self.view = View(kind, name, spec.config, number=self.view.number + 1)
            self._publish(Opening())
            self._publish(Event(0, "info", f"starting {name}"))
            self._link = SessionLink(self._host_for(spec, self._estop), self._report)
            await self._link.start()

    async def stop(self) -> None:
        """End the session that runs, if any."""
        link, self._link = self._link, None
        if link is not None:
            await link.stop()

    async def command(self, command: Command, made_s: float | None = None) -> None:
        """Send a command made at ``made_s`` (monotonic, None: now), wait until it is obeyed; Problem when it cannot."""
        link = self._link
        if link is None or self.view.phase in ("ended", "failed"):
            raise Problem(HTTPStatus.CONFLICT, "no session is running; start the simulator first")
        if self.view.phase == "starting":
            raise Problem(HTTPStatus.CONFLICT, "the session is still starting; try again in a moment")
        await self._send(link, command, monotonic() if made_s is None else made_s)

    async def control_playback(self, command: ControlPlayback) -> None:
        """Control how the recording plays, also after its end; Problem where none is open."""
        link = self._link
        if link is None or self.view.kind != "recording" or self.view.phase == "failed":
            raise Problem(HTTPStatus.CONFLICT, "no recording is open; POST /recordings/{id}/play opens one")
        if self.view.phase == "starting":
            raise Problem(HTTPStatus.CONFLICT, "the recording is still being opened; try again in a moment")
        await self._send(link, command)

    async def _send(self, link: SessionLink, command: Command, made_s: float | None = None) -> None:
        try:
            # Sending only hands over to the threads of the bus: it never waits, and so needs no thread of its own,
            # for which it would have to queue behind others' work.
            refusal = await link.obeyed(link.host.send(command, made_s))
        except (OSError, TimeoutError) as error:
            raise Problem(HTTPStatus.SERVICE_UNAVAILABLE, "the session did not answer") from error
        if refusal is not None:
            raise Problem(HTTPStatus.CONFLICT, refusal)

    @property
    def latched(self) -> bool:
        """Whether the robot itself has said that its E-stop is latched, and nobody is clearing it."""
        tick = self.view.tick
        reported = self.view.phase == "running" and tick is not None and tick.estop_reason is not None
        return reported and self._estop.reason is not None and not self._resetting

    async def estop(self, reason: str) -> bool:
        """Latch the E-stop here, for every session to come, and in the one that runs; return whether that confirmed it.

        It is sent before anything is waited for. An E-stop that the robot has confirmed is not waited for again, but
        still sent, REPEAT_S apart.
        """
        self._estop.latch(reason)
        link = self._link
        if link is None or self.view.phase in ("ended", "failed"):
            return True  # Nothing runs that could move.
        if self.latched:
            link.repeat(EStop(reason))
            return True
        try:
            number = link.host.send(EStop(reason))
            # A command sent after it may be there before it: then it has not come yet.
            return await link.obeyed(number, ESTOP_CONFIRM_S) is None or self.latched
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
        link = self._link
        if link is None or self.view.phase in ("ended", "failed"):
            return
        if self.view.phase == "running":
            await self._send(link, command)
        else:
            # Not there yet: it gets the command when it is (from the host, or from ``start``).
            with contextlib.suppress(OSError):
                link.host.send(command)

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
        if self._link is not None and self._link.was_frozen:
            raise Problem(HTTPStatus.CONFLICT, "the server was frozen meanwhile; start again")

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
        """Whether the robot is commanded to move."""
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

    def _report(self, link: SessionLink, report: Report) -> None:
        if link is not self._link:
            return  # The last words of a session that was replaced.
        self.view.on_report(report)
        if isinstance(report, Tick):
            self._estop.report(report.estop_reason)
        if isinstance(report, Ended) and report.error is not None:
            _log.error("session failed", reason=report.error)
        self._publish(report)

    def _publish(self, report: Report) -> None:
        for listener in self._listeners:
            attempt("a listener of the session", partial(listener, report, self.view))
