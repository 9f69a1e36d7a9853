"""The server's end of one running session: commands and their answers, reports, and the pulse of the server's loop."""

import asyncio
import contextlib
from collections.abc import Callable
from functools import partial
from time import monotonic

from server.background import attempt, keep_on
from snakeslam.runtime.bus.commands import EStop
from snakeslam.runtime.bus.topics import Report, Tick
from snakeslam.runtime.session.pipe_host import Host

CONFIRM_S = 2.0
REPEAT_S = 0.05
"""An E-stop that is pressed again and again is sent this often."""
PULSE_S = 0.1
FROZEN_S, AWAKE_S = 1.0, 0.5
"""After a freeze of the first, starts are refused for the second: they may have waited in the socket."""


class SessionLink:
    """A session's host, the answers to the commands that were sent to it, and the pulse by which it knows this loop."""

    def __init__(self, host: Host, report: "Callable[[SessionLink, Report], None]") -> None:
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
        await asyncio.to_thread(self.host.start, self._receive)

    async def stop(self) -> None:
        """End them."""
        self._pulse.cancel()
        await asyncio.to_thread(self.host.stop)

    def repeat(self, command: EStop) -> None:
        """Send an E-stop that is latched already: now, or once for all that come within REPEAT_S after the last."""
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
    def was_frozen(self) -> bool:
        """Whether this loop has only just resumed after a freeze: what it reads now may have waited since before it."""
        now_s = monotonic()
        return now_s < self._awake_s or now_s - self._pulsed_s > FROZEN_S

    async def _pulse_on(self) -> None:
        """Show the robot that this loop, and not just the process, is alive."""
        await keep_on("the server's pulse", self._pulse_once)

    async def _pulse_once(self) -> None:
        now_s = monotonic()
        # Judged by the time since the last pulse alone, or each pulse after a freeze would prolong it.
        if now_s - self._pulsed_s > FROZEN_S:
            self._awake_s = now_s + AWAKE_S
        self._pulsed_s = now_s
        self.host.pulse()
        await asyncio.sleep(PULSE_S)

    def _receive(self, report: Report) -> None:
        # A closed loop means that the server has ended: nobody needs the report.
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._on_report, report)

    def _on_report(self, report: Report) -> None:
        if isinstance(report, Tick):
            self._done = report.commands_done
            self._refusals = {refusal.number: refusal.reason for refusal in report.refusals}
            self._progress.set()
        attempt("a report of the session", partial(self._report, self, report))
