"""A node as a process: how it starts, when it ends, and the reason that it reports for its end."""

import contextlib
import multiprocessing
import signal
import threading
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import structlog

from snakeslam.errors import InputError, SnakeslamError
from snakeslam.runtime.process.log_limit import LogLimit, error_words
from snakeslam.runtime.process.logs import log_to_stderr
from snakeslam.runtime.process.priority import set_normal_priority
from snakeslam.threads import use_one_thread

POLL_S = 0.05
_log = structlog.get_logger("node")
JOIN_S = 2.5


@dataclass(frozen=True, slots=True)
class EndReason:
    """Why a node ended; ``final`` when another start with the same settings would end in the same way."""

    reason: str
    final: bool


class Life:
    """How long a node runs: until its parent ends it or is gone, or until SIGTERM or SIGINT."""

    def __init__(self, pipe: "Connection[Any, Any] | None" = None) -> None:
        self._over = threading.Event()
        if pipe is not None:
            threading.Thread(target=self._watch, args=(pipe,), name="parent", daemon=True).start()

    @property
    def over(self) -> bool:
        """Whether the node is to end."""
        return self._over.is_set()

    def end(self) -> None:
        """Have the node end."""
        self._over.set()

    def wait(self, timeout_s: float) -> bool:
        """Wait for the end for ``timeout_s`` at most; return whether it has come."""
        return self._over.wait(timeout_s)

    def _watch(self, pipe: "Connection[Any, Any]") -> None:
        """End at any message from the parent, and at the end of its pipe too."""
        with contextlib.suppress(EOFError, OSError):
            pipe.recv()
        self._over.set()


def run_beside(name: str, life: Life, do: Callable[[], None]) -> threading.Thread:
    """Call ``do``, which waits by itself, repeatedly in a thread until the life ends; an error is logged."""

    def run() -> None:
        limit = LogLimit()
        while not life.over:
            try:
                do()
            except Exception as error:  # noqa: BLE001  (nobody would notice a thread that ended silently)
                if (left_out := limit.due(name)) is not None:
                    _log.error(
                        "thread failed", thread=name, reason=error_words(error), left_out=left_out, exc_info=error
                    )
                life.wait(POLL_S)

    thread = threading.Thread(target=run, name=name, daemon=True)
    thread.start()
    return thread


@dataclass(frozen=True, slots=True)
class Child:
    """A node's process, and the pipe over which it reports why it ended; closing the pipe ends it."""

    process: BaseProcess
    pipe: "Connection[None, EndReason]"

    def stop(self) -> None:
        """Ask the process to end, and kill it if it does not."""
        self.pipe.close()
        self.process.join(JOIN_S)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()


def spawn(name: str, run: Callable[..., None], *arguments: Any) -> Child:
    """Start ``run(*arguments, life)`` in a process of its own that ends with this one."""
    use_one_thread()
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_run_child, args=(run, arguments, theirs), name=name, daemon=False)
    process.start()
    theirs.close()
    return Child(process, ours)


def _run_child(run: Callable[..., None], arguments: tuple[Any, ...], pipe: "Connection[EndReason, None]") -> None:
    # Ctrl-C reaches the whole terminal group; the parent decides when its nodes end.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    set_normal_priority()
    log_to_stderr()
    _show_name()
    life = Life(pipe)
    try:
        run(*arguments, life)
    except InputError as error:
        _send(pipe, EndReason(str(error), final=True))
    except SnakeslamError as error:
        _send(pipe, EndReason(str(error), final=False))
    except BaseException as error:
        _send(pipe, EndReason(error_words(error), final=False))
        raise


def _show_name() -> None:
    """Set the name that ``ps`` and ``top`` show."""
    with contextlib.suppress(OSError):
        Path("/proc/self/comm").write_text(multiprocessing.current_process().name)


def _send(pipe: "Connection[EndReason, None]", reason: EndReason) -> None:
    try:
        pipe.send(reason)
    except OSError:
        return  # The parent is gone.


def end_at_signals(life: Life) -> None:
    """Have SIGINT and SIGTERM end ``life``; for a node that has no parent."""

    def end(number: int, frame: object) -> None:
        del number, frame
        life.end()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
