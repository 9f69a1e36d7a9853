"""The edge of the server: connections that wait for nothing, and for nobody's sake keep others out.

uvicorn accepts whatever comes and waits for headers for ever; here connections are bounded, and who keeps one without
asking loses it: strangers first, an operator last.
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
LOOK_S = 1.0
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
class Place:
    """What is known of one connection; ``role`` and ``identity`` are those of its last request that was signed in."""

    connection: "EdgeProtocol"
    waits_s: float
    """Since when it has asked for nothing."""
    busy: bool = False
    role: Role | None = None
    identity: str = ""
    stalled_s: float | None = None


@dataclass(slots=True)
class Places:
    """All connections, those that have waited longest first among those that wait."""

    most: int
    all: dict[int, Place] = field(default_factory=dict)

    def add(self, place: Place) -> None:
        """Have a new connection; one that only waits has to go where there are too many."""
        if len(self.all) >= self.most:
            self._evict()
        self.all[id(place.connection)] = place

    def signed_in(self, place: Place, role: Role, identity: str) -> None:
        """Note who asks over a connection; too many of one credential cost its oldest."""
        if place.identity == identity:
            return
        place.role, place.identity = role, identity
        own = [other for other in self.all.values() if other.identity == identity]
        if len(own) > MOST_EACH:
            self._drop(next((other for other in own if not other.busy), None))

    def look(self, now_s: float) -> None:
        """Drop whoever has waited too long, or takes nothing of what is sent."""
        for place in list(self.all.values()):
            patience_s = HEADER_S if place.role is None else IDLE_S
            waited = not place.busy and now_s - place.waits_s > patience_s
            if waited or (place.stalled_s is not None and now_s - place.stalled_s > STALL_S):
                self._drop(place)

    def _evict(self) -> None:
        """Drop the connection that has waited longest: a stranger's, else that of one who watches, else any."""
        for role in (None, "viewer", "operator"):
            waiting = (place for place in self.all.values() if place.role == role and not place.busy)
            if (place := _oldest(waiting)) is not None:
                break
        else:
            # Strangers whose requests are answered slowly on purpose.
            place = _oldest(place for place in self.all.values() if place.role is None)
        self._drop(place)

    def _drop(self, place: Place | None) -> None:
        """Close a connection; its place is free at once, though its last event comes later."""
        if place is not None:
            self.all.pop(id(place.connection), None)
            place.connection.transport.abort()


def _oldest(places: Iterator[Place]) -> Place | None:
    return min(places, key=lambda place: place.waits_s, default=None)


def protocol_with(places: Places) -> type["EdgeProtocol"]:
    """Return the protocol class whose connections have these ``places``."""
    return type("BoundedProtocol", (EdgeProtocol,), {"places": places})


class EdgeProtocol(H11Protocol):
    """uvicorn's HTTP protocol with a place among ``Places``."""

    places: Places

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take a place."""
        super().connection_made(transport)
        self.place = Place(self, monotonic())
        self.app_state = {**self.app_state, "place": self.place}
        self.places.add(self.place)

    def connection_lost(self, exc: Exception | None) -> None:
        """Give the place back."""
        self.places.all.pop(id(self), None)
        super().connection_lost(exc)

    def handle_events(self) -> None:
        """Note that a request has come."""
        before = self.cycle
        super().handle_events()
        if self.cycle is not before:
            self.place.busy = not self.cycle.response_complete

    def handle_websocket_upgrade(self, event: object) -> None:
        """Websockets have limits of their own."""
        self.places.all.pop(id(self), None)
        super().handle_websocket_upgrade(event)  # type: ignore[arg-type]

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        self.place.busy, self.place.waits_s = False, monotonic()
        super().on_response_complete()

    def pause_writing(self) -> None:
        """Note that the other side takes nothing."""
        self.place.stalled_s = monotonic()
        super().pause_writing()

    def resume_writing(self) -> None:
        """Note that it does again."""
        self.place.stalled_s = None
        super().resume_writing()
