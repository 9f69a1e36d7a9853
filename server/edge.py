"""The limits of connections: how many there are, and how long one may be idle.

uvicorn accepts every connection and waits for its headers without end. Here their number is bounded and idle ones are
closed: first those of strangers, last those of operators.
"""

import asyncio
import resource
from collections.abc import Iterator
from dataclasses import dataclass, field
from time import monotonic

from uvicorn.protocols.http.h11_impl import H11Protocol

from server.sessions import Role

HEADER_S, IDLE_S, STALL_S = 10.0, 20.0, 20.0
"""Time for a request's head; between requests of those who are signed in; for a reader to take anything at all."""
POLL_S = 1.0
MOST_CONNECTIONS, LEAST_CONNECTIONS = 512, 32
MOST_EACH = 64
"""Connections with one credential that wait for a next request."""
OWN_DESCRIPTORS, BACKLOG = 192, 64
"""Descriptors that are left for files, the viewer's sockets, and connections that are just being closed."""


def most_connections() -> int:
    """Raise the limit of open files as far as the system lets us; return how many connections that leaves."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft < hard:
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
        soft = hard
    free = MOST_CONNECTIONS if soft == resource.RLIM_INFINITY else soft - OWN_DESCRIPTORS - BACKLOG
    return max(min(MOST_CONNECTIONS, free), LEAST_CONNECTIONS)


@dataclass(slots=True, eq=False)
class ConnectionState:
    """What is known of one connection; ``role`` and ``identity`` are those of its last request that was signed in."""

    connection: "EdgeProtocol"
    waits_s: float
    """Since when it has asked for nothing."""
    busy: bool = False
    role: Role | None = None
    identity: str = ""
    stalled_s: float | None = None


@dataclass(slots=True)
class Connections:
    """All connections, those that have waited longest first among those that wait."""

    most: int
    all: dict[int, ConnectionState] = field(default_factory=dict)

    def add(self, state: ConnectionState) -> None:
        """Add a new connection; where there are too many, one that is idle is closed."""
        if len(self.all) >= self.most:
            self._evict()
        self.all[id(state.connection)] = state

    def signed_in(self, state: ConnectionState, role: Role, identity: str) -> None:
        """Note who uses a connection; with too many of one credential its oldest is closed."""
        if state.identity == identity:
            return
        state.role, state.identity = role, identity
        own = [other for other in self.all.values() if other.identity == identity]
        if len(own) > MOST_EACH:
            self._drop(next((other for other in own if not other.busy), None))

    def close_idle(self, now_s: float) -> None:
        """Close the connections that have been idle for too long, or that receive nothing of what is sent."""
        for state in list(self.all.values()):
            patience_s = HEADER_S if state.role is None else IDLE_S
            waited = not state.busy and now_s - state.waits_s > patience_s
            if waited or (state.stalled_s is not None and now_s - state.stalled_s > STALL_S):
                self._drop(state)

    def _evict(self) -> None:
        """Close the connection that has been idle longest: a stranger's, else a viewer's, else any."""
        for role in (None, "viewer", "operator"):
            waiting = (state for state in self.all.values() if state.role == role and not state.busy)
            if (state := _oldest(waiting)) is not None:
                break
        else:
            # Strangers whose requests are answered slowly on purpose.
            state = _oldest(state for state in self.all.values() if state.role is None)
        self._drop(state)

    def _drop(self, state: ConnectionState | None) -> None:
        """Close a connection; it no longer counts from now on, though its last event comes later."""
        if state is not None:
            self.all.pop(id(state.connection), None)
            state.connection.transport.abort()


def _oldest(connections: Iterator[ConnectionState]) -> ConnectionState | None:
    return min(connections, key=lambda state: state.waits_s, default=None)


def protocol_with(connections: Connections) -> type["EdgeProtocol"]:
    """Return the protocol class whose connections are among ``connections``."""
    return type("BoundedProtocol", (EdgeProtocol,), {"known": connections})


class EdgeProtocol(H11Protocol):
    """uvicorn's HTTP protocol, each connection known to ``Connections``."""

    known: Connections
    """All connections of the server; the name must not be one that uvicorn's protocol has."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Add the connection."""
        super().connection_made(transport)
        self.edge = ConnectionState(self, monotonic())
        self.app_state = {**self.app_state, "edge": self.edge}
        self.known.add(self.edge)

    def connection_lost(self, exc: Exception | None) -> None:
        """Remove the connection."""
        self.known.all.pop(id(self), None)
        super().connection_lost(exc)

    def handle_events(self) -> None:
        """Note that a request has come."""
        before = self.cycle
        super().handle_events()
        if self.cycle is not before:
            self.edge.busy = not self.cycle.response_complete

    def handle_websocket_upgrade(self, event: object) -> None:
        """Websockets have limits of their own."""
        self.known.all.pop(id(self), None)
        super().handle_websocket_upgrade(event)  # type: ignore[arg-type]

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        self.edge.busy, self.edge.waits_s = False, monotonic()
        super().on_response_complete()

    def pause_writing(self) -> None:
        """Note that the other side receives nothing."""
        self.edge.stalled_s = monotonic()
        super().pause_writing()

    def resume_writing(self) -> None:
        """Note that the other side receives again."""
        self.edge.stalled_s = None
        super().resume_writing()
