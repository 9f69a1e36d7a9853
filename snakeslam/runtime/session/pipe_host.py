"""The server's end of a session that is one process: a recording."""

import contextlib
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from queue import SimpleQueue
from typing import Any, Protocol

from snakeslam.runtime.assembly.spec import SessionSpec
from snakeslam.runtime.bus.commands import Command, Shutdown
from snakeslam.runtime.bus.topics import Ended, Report
from snakeslam.runtime.process.log_limit import error_words
from snakeslam.runtime.session.recording import start_session

END_S = 2.0
Put = Callable[[Report], None]


class Host(Protocol):
    """A session's processes as the server sees them; ``put`` of ``start`` is called from threads of the host."""

    def start(self, put: Put) -> None:
        """Start everything; blocks while the processes are created."""
        ...

    def send(self, command: Command, made_s: float | None = None) -> int:
        """Send a command made at ``made_s`` (monotonic, None: now); OSError when it cannot be sent.

        Return the number that ``Tick.commands_done`` reaches when it is obeyed.
        """
        ...

    def pulse(self) -> None:
        """Note an iteration of the server's event loop: without them the robot gets no heartbeat of the server."""
        ...

    def stop(self) -> None:
        """End everything, after the robot was brought to a hold."""
        ...


class PipeHost:
    """One process, its pipe, and the threads on it; ``start_process`` creates process and pipe."""

    def __init__(self, spec: SessionSpec, start_process: Callable[[SessionSpec], Any] = start_session) -> None:
        self._spec, self._start_process = spec, start_process
        self._sending = threading.Lock()
        self._waiting: SimpleQueue[Command | None] = SimpleQueue()
        self._process: Any = None
        self._pipe: Connection[Command, Report] | None = None
        self._reader: threading.Thread | None = None
        self._sent = 0

    def start(self, put: Put) -> None:
        """Start the process and read it."""
        self._process, self._pipe = self._start_process(self._spec)
        self._reader = threading.Thread(target=self._read, args=(self._pipe, put), name="session-reader", daemon=True)
        self._reader.start()
        threading.Thread(target=self._write, args=(self._pipe,), name="session-writer", daemon=True).start()

    def send(self, command: Command, made_s: float | None = None) -> int:
        """Queue a command, whatever its age; never waits, although the process may be frozen and its pipe full."""
        del made_s
        with self._sending:
            if self._pipe is None or self._pipe.closed:
                raise BrokenPipeError
            self._sent += 1
            self._waiting.put(command)
            return self._sent

    def pulse(self) -> None:
        """Nothing here moves."""

    def stop(self) -> None:
        """Ask the process to end, and kill it if it does not."""
        if self._process is None:
            return
        with contextlib.suppress(OSError):
            self.send(Shutdown())
        self._waiting.put(None)
        self._process.join(END_S)
        for end in ("terminate", "kill"):
            if self._process.is_alive():
                getattr(self._process, end)()
                self._process.join(END_S)
        if self._reader is not None:
            self._reader.join(END_S)
        self._process.close()

    def _write(self, pipe: "Connection[Command, Report]") -> None:
        """Write what was sent; the end of the process is reported by the reader."""
        with contextlib.suppress(OSError):
            while (command := self._waiting.get()) is not None:
                pipe.send(command)

    def _read(self, pipe: "Connection[Command, Report]", put: Put) -> None:
        """Pass on every report; a pipe that ends without an ``Ended`` is a crash."""
        ended = False
        try:
            while True:
                report = pipe.recv()
                ended = ended or isinstance(report, Ended)
                put(report)
        except (EOFError, OSError):
            pipe.close()
        except Exception as error:  # noqa: BLE001  (reports that cannot be read end the session with an error)
            pipe.close()
            if not ended:
                put(Ended(f"the session's reports cannot be read: {error_words(error)}"))
            return
        if not ended:
            self._process.join(END_S)
            code = self._process.exitcode
            how = "no exit code" if code is None else f"signal {-code}" if code < 0 else f"exit code {code}"
            put(Ended(f"the session's process ended unexpectedly ({how})"))
