"""Structured logs on standard error, because standard output carries results: JSON, or plain text on a terminal."""

import logging
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from threading import Lock
from time import monotonic
from typing import TextIO, cast

import structlog
from structlog.typing import EventDict, Processor

VARIABLE = "SNAKESLAM_LOG"
BURST, PER_S, MOST_KEPT = 20.0, 5.0, 256
"""Lines of one kind that are written at once, then per second; kinds that are kept."""


class StandardError:
    """Standard error, looked up at each line; a line that cannot be written is dropped.

    A terminal that was closed, or a full disk, must not end the work that logs.
    """

    def write(self, text: str) -> int:
        """Write ``text``, if that is possible."""
        with suppress(OSError, ValueError):
            return sys.stderr.write(text)
        return len(text)

    def flush(self) -> None:
        """Flush, if that is possible."""
        with suppress(OSError, ValueError):
            sys.stderr.flush()


class Repeats:
    """Leaves out lines of a kind that is too frequent; the next line that is written says how many were left out.

    A kind is an event with its ``who`` and ``status``. A structlog processor, and a filter for the libraries' logs.
    """

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self._kinds: dict[tuple[object, ...], list[float]] = {}
        self._lock = Lock()

    def __call__(self, logger: object, name: str, event: EventDict) -> EventDict:
        """Return the line, or drop it."""
        del logger
        left_out = self.count((event.get("event"), event.get("who"), event.get("status"), name))
        if left_out is None:
            raise structlog.DropEvent
        return {**event, "left_out": left_out} if left_out else event

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a library's line is to be written."""
        left_out = self.count((record.name, record.msg))
        if left_out:
            record.msg = f"{record.msg} ({left_out} such lines were left out)"
        return left_out is not None

    def count(self, kind: tuple[object, ...]) -> int | None:
        """Return how many of a kind were left out before this one; None to leave it out too."""
        with self._lock:
            now_s = self._clock()
            if len(self._kinds) >= MOST_KEPT and kind not in self._kinds:
                self._kinds.pop(next(iter(self._kinds)))
            tokens, at_s, left_out = self._kinds.get(kind, [BURST, now_s, 0.0])
            tokens = min(BURST, tokens + (now_s - at_s) * PER_S)
            written = tokens >= 1.0
            self._kinds[kind] = [tokens - 1.0, now_s, 0.0] if written else [tokens, now_s, left_out + 1.0]
            return int(left_out) if written else None


def log_to_stderr() -> tuple[list[Processor], Processor]:
    """Send structlog's events to standard error; return the processors that others share, and the renderer."""
    as_json = os.environ.get(VARIABLE, "text" if sys.stderr.isatty() else "json") == "json"
    shared: list[Processor] = [
        structlog.stdlib.add_log_level,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        structlog.processors.format_exc_info,
    ]
    renderer: Processor = structlog.processors.JSONRenderer() if as_json else structlog.dev.ConsoleRenderer()
    structlog.configure(
        processors=[Repeats(), *shared, renderer],
        wrapper_class=structlog.make_filtering_bound_logger(logging.INFO),
        logger_factory=structlog.PrintLoggerFactory(cast(TextIO, StandardError())),
    )
    return shared, renderer
