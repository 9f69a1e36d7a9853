"""A node as a process: how it starts, how long it lives, and its last word."""

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

from snakeslam.errors import SnakeslamError
from snakeslam.runtime.logs import log_to_stderr
from snakeslam.runtime.priority import go_along
from snakeslam.threads import use_one_thread

POLL_S = 0.05
JOIN_S = 2.5


class Life:
    """Whether a node shall go on: until its parent tells it to end or is gone, or it gets SIGTERM or SIGINT."""

    def __init__(self, pipe: "Connection[Any, Any] | None" = None) -> None:
        self._over = threading.Event()
        if pipe is not None:
            threading.Thread(target=self._watch, args=(pipe,), name="parent", daemon=True).start()

    @property
    def over(self) -> bool:
        """Whether it is time to end."""
        return self._over.is_set()

    def end(self) -> None:
        """End."""
        self._over.set()

    def wait(self, timeout_s: float) -> bool:
        """Wait for the end; whether it has come."""
        return self._over.wait(timeout_s)

    def _watch(self, pipe: "Connection[Any, Any]") -> None:
        """Any word from the parent, and its pipe's end too, means to end."""
        with contextlib.suppress(EOFError, OSError):
            pipe.recv()
        self._over.set()


@dataclass(frozen=True, slots=True)
class Child:
    """A node's process, and the pipe over which it says why it ended; closing the pipe ends it."""

    process: BaseProcess
    pipe: "Connection[None, str]"

    def stop(self) -> None:
        """Ask it to end, then insist."""
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


def _run_child(run: Callable[..., None], arguments: tuple[Any, ...], pipe: "Connection[str, None]") -> None:
    # Ctrl-C reaches the whole terminal group; the parent decides when its nodes end.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    go_along()
    log_to_stderr()
    _show_name()
    life = Life(pipe)
    try:
        run(*arguments, life)
    except SnakeslamError as error:
        _last_word(pipe, str(error))
    except BaseException as error:
        _last_word(pipe, " ".join(f"{type(error).__name__}: {error}".split()))
        raise


def _show_name() -> None:
    """Let ``ps`` and ``top`` tell the nodes apart."""
    with contextlib.suppress(OSError):
        Path("/proc/self/comm").write_text(multiprocessing.current_process().name)


def _last_word(pipe: "Connection[str, None]", reason: str) -> None:
    try:
        pipe.send(reason)
    except OSError:
        return  # The parent is gone.


def end_at_signals(life: Life) -> None:
    """Have SIGINT and SIGTERM end ``life``; for a node that was started by itself."""

    def end(number: int, frame: object) -> None:
        del number, frame
        life.end()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
