"""The bus between the live nodes, on Zenoh: typed topics, each with a policy; publishing never blocks.

One node listens and forwards the messages of the others, which connect to it. On one machine it listens on a Unix
socket that only its user may open; across machines on TLS, with certificates on both sides.
"""

import contextlib
import json
import os
import threading
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from time import monotonic, sleep
from typing import Any, Generic, TypeVar

import structlog
import zenoh

from snakeslam.errors import SnakeslamError
from snakeslam.runtime.bus.codec import WireError, decode, encode
from snakeslam.runtime.bus.link import UNIX, Link
from snakeslam.runtime.bus.socket_path import claimed
from snakeslam.runtime.bus.topics import Topic
from snakeslam.runtime.process.log_limit import LogLimit, error_words

T = TypeVar("T")
PREFIX = "snakeslam"
RETRY_S = 0.05
KEPT = 4000
"""The most lossless messages that wait for a link; then the oldest are dropped, and their number is logged."""
CLOSE_S = 0.5
MODE = 0o177
_log = structlog.get_logger("bus")


class BusError(SnakeslamError):
    """The bus cannot be opened."""


class _Outlet(Generic[T]):
    """Sends one topic from a thread of its own, so that a frozen subscriber of one topic does not delay the others."""

    def __init__(self, session: Any, topic: Topic[T]) -> None:
        control, priority = zenoh.CongestionControl, zenoh.Priority
        drops = topic.policy == "newest" and not topic.bulky
        urgent = topic.policy == "urgent"
        self._topic = topic
        self._publisher = session.declare_publisher(
            f"{PREFIX}/{topic.name}",
            congestion_control=control.DROP if drops else control.BLOCK,
            priority=priority.REAL_TIME if urgent else priority.DATA_LOW if topic.bulky else priority.DATA,
            express=urgent,
        )
        self._changed = threading.Condition()
        self._waiting: deque[T] = deque(maxlen=1 if topic.policy == "newest" else KEPT)
        self._lost = 0
        self._limit = LogLimit()
        self._closing = False
        self._thread = threading.Thread(target=self._send_all, name=f"bus {topic.name}", daemon=True)
        self._thread.start()

    def put(self, message: T) -> None:
        with self._changed:
            self._lost += self._topic.policy != "newest" and len(self._waiting) == KEPT
            self._waiting.append(message)
            self._changed.notify()

    def close(self) -> None:
        """Send what is left, as far as the link accepts it within CLOSE_S."""
        with self._changed:
            self._closing = True
            self._changed.notify()
        self._thread.join(CLOSE_S)

    def _send_all(self) -> None:
        while (batch := self._next()) is not None:
            for message in batch:
                try:
                    self._publisher.put(encode(message))
                except Exception as error:  # noqa: BLE001  (one message that cannot be sent must not end the topic)
                    if self._closing:
                        return
                    self._log_unsent(error)

    def _log_unsent(self, error: Exception) -> None:
        left_out = self._limit.due("not sent")
        if left_out is not None:
            reason = _first_line(error) if isinstance(error, zenoh.ZError) else error_words(error)
            _log.warning("message not sent", topic=self._topic.name, reason=reason, left_out=left_out)

    def _next(self) -> list[T] | None:
        """Wait for something to send; None at the end."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting or self._closing)
            if not self._waiting:
                return None
            if self._lost and self._limit.due("lost") is not None:
                _log.warning("messages lost, the link is too slow", topic=self._topic.name, messages=self._lost)
                self._lost = 0
            batch = list(self._waiting)
            self._waiting.clear()
            return batch


class Bus:
    """A node's end of the bus; BusError when no node answers within ``timeout_s``, or once it is not ``wanted``.

    Messages are sent from threads of the bus, in order within a topic. Subscribers are called in the bus's threads, so
    they must return soon. A link that is lost is opened again by itself.
    """

    def __init__(self, link: Link, timeout_s: float = 60.0, wanted: Callable[[], bool] = lambda: True) -> None:
        self._session = _open(link, timeout_s, wanted)
        self._opening = threading.Lock()
        self._outlets: dict[str, _Outlet[Any]] = {}
        self._subscribers: list[Any] = []
        self._sizes: dict[str, int] = {}

    def expect(self, sizes: Mapping[str, int]) -> None:
        """Drop from now on messages with arrays of other sizes than these, by their names in ``shapes``."""
        self._sizes = dict(sizes)

    def publish(self, topic: Topic[T], message: T) -> None:
        """Send ``message``; returns at once."""
        outlet = self._outlets.get(topic.name)
        if outlet is None:
            with self._opening:
                if topic.name not in self._outlets:
                    self._outlets[topic.name] = _Outlet(self._session, topic)
                outlet = self._outlets[topic.name]
        outlet.put(message)

    def subscribe(self, topic: Topic[T], on_message: Callable[[T], None]) -> None:
        """Call ``on_message`` with every message of ``topic`` from now on; anything else is dropped and logged."""
        limit = LogLimit()

        def on_sample(sample: Any) -> None:
            try:
                if len(sample.payload) > topic.most_bytes:
                    raise WireError(f"a message of {len(sample.payload)} bytes, at most {topic.most_bytes} are allowed")
                on_message(decode(topic.type, sample.payload.to_bytes(), self._sizes))
            except WireError as error:
                if (left_out := limit.due("dropped")) is not None:
                    _log.warning("message dropped", topic=topic.name, reason=str(error), left_out=left_out)
            except Exception as error:  # noqa: BLE001  (the bus's thread serves other topics too)
                if (left_out := limit.due("failed")) is not None:
                    reason = error_words(error)
                    _log.error(
                        "message not handled", topic=topic.name, reason=reason, left_out=left_out, exc_info=error
                    )

        self._subscribers.append(self._session.declare_subscriber(f"{PREFIX}/{topic.name}", on_sample))

    def close(self) -> None:
        """Send what is left and close the session; safe to call twice."""
        for outlet in self._outlets.values():
            outlet.close()
        for subscriber in self._subscribers:
            subscriber.undeclare()
        self._subscribers.clear()
        # Zenoh raises an error where the link is gone already.
        with contextlib.suppress(zenoh.ZError):
            self._session.close()
        # Now the threads that waited for a lost link return: none may be inside Zenoh when Python ends.
        for outlet in self._outlets.values():
            outlet.close()


def _open(link: Link, timeout_s: float, wanted: Callable[[], bool]) -> Any:
    """Open Zenoh; try to connect until it succeeds, is not ``wanted`` any more, or ``timeout_s`` is over."""
    until = monotonic() + timeout_s
    while True:
        try:
            return _opened(link)
        except zenoh.ZError as error:
            if link.listens:
                raise BusError(f"the bus cannot listen at {link.endpoint}: {_first_line(error)}") from error
            if monotonic() > until or not wanted():
                raise BusError(f"no node answers at {link.endpoint}") from error
        sleep(RETRY_S)


def _opened(link: Link) -> Any:
    config = _config(link)
    if not (link.listens and link.endpoint.startswith(UNIX)):
        return zenoh.open(config)
    path = Path(link.endpoint.removeprefix(UNIX))
    with claimed(path):
        before = os.umask(MODE)
        try:
            session = zenoh.open(config)
        finally:
            os.umask(before)
        path.chmod(0o600)
    return session


def _config(link: Link) -> Any:
    """Return Zenoh's configuration: no discovery, and no other open endpoint."""
    settings: dict[str, Any] = {
        "mode": "router" if link.listens else "client",
        "listen/endpoints": [link.endpoint] if link.listens else [],
        "connect/endpoints": [] if link.listens else [link.endpoint],
        "connect/timeout_ms": 0,
        "connect/exit_on_failure": True,
        "connect/retry": {"period_init_ms": 50, "period_max_ms": 500, "period_increase_factor": 1.5},
        # Without discovery there is nothing to wait for.
        "scouting/delay": 0,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
    }
    if link.certificates is not None:
        side = "listen" if link.listens else "connect"
        settings["transport/link/tls"] = {
            "root_ca_certificate": str(link.certificates.authority),
            f"{side}_certificate": str(link.certificates.certificate),
            f"{side}_private_key": str(link.certificates.key),
            "enable_mtls": True,
            "verify_name_on_connect": True,
        }
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0]
