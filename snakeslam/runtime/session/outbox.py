"""Sends a session's reports over its pipe without ever blocking the loop."""

import threading
from collections import deque
from multiprocessing.connection import Connection

import structlog

from snakeslam.runtime.bus.topics import Event, Features, JpegImage, Report, Tick
from snakeslam.runtime.process.log_limit import error_words

MAX_EVENTS = 500
_log = structlog.get_logger("session")


class Outbox:
    """A thread that sends the newest tick, image and features, every map chunk, and the last events."""

    def __init__(self, pipe: "Connection[Report, object]") -> None:
        self._pipe = pipe
        self._changed = threading.Condition()
        self._lossless: deque[Report] = deque()
        self._events: deque[Event] = deque(maxlen=MAX_EVENTS)
        self._newest: dict[type, Report] = {}
        self._closing = False
        self._thread = threading.Thread(target=self._send_all, name="outbox", daemon=True)
        self._thread.start()

    @property
    def broken(self) -> bool:
        """Whether the reader is gone."""
        return not self._thread.is_alive()

    def put(self, report: Report) -> None:
        """Queue a report; returns at once."""
        with self._changed:
            if isinstance(report, Tick | JpegImage | Features):
                self._newest[type(report)] = report
            elif isinstance(report, Event):
                self._events.append(report)
            else:
                self._lossless.append(report)
            self._changed.notify()

    def close(self, timeout_s: float = 2.0) -> None:
        """Send what is left, as far as the reader accepts it within ``timeout_s``."""
        with self._changed:
            self._closing = True
            self._changed.notify()
        self._thread.join(timeout_s)

    def _send_all(self) -> None:
        while (batch := self._next()) is not None:
            for report in batch:
                try:
                    self._pipe.send(report)
                except OSError:
                    return  # The reader is gone: the loop sees it by `broken`.
                except Exception as error:  # noqa: BLE001  (one report that cannot be sent must not end the others)
                    _log.error("report not sent", kind=type(report).__name__, reason=error_words(error))

    def _next(self) -> list[Report] | None:
        """Wait for reports; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._lossless or self._events or self._newest or self._closing)
            if not (self._lossless or self._events or self._newest):
                return None
            # An `Ended` must stay the last report.
            batch = [*self._events, *self._newest.values(), *self._lossless]
            self._lossless.clear()
            self._events.clear()
            self._newest.clear()
            return batch
