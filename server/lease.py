"""Who may move the robot: one lease at a time, renewed by its holder, taken over only by an explicit act."""

import secrets
from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus
from time import monotonic

from server.problem import Problem

RENEWED_S = 10.0
"""A lease that its holder renews lapses this long after the last renewal."""
GONE_S = 2.0
"""The lease of a page lapses this long after its socket has closed, unless it is opened again."""
UNASKED_S = 60.0
"""A script that commands without having taken a lease holds a free one for this long after each command."""
LONGEST_S = 3600.0


@dataclass(frozen=True, slots=True)
class Lease:
    """The right to move the robot; ``key`` is its holder's secret, ``id`` and ``holder`` are shown to all."""

    id: int
    key: str
    holder: str
    seconds: float
    identity: str = ""
    """The credential with which it was taken."""


class Desk:
    """Grants the lease; ``on_change`` is called for every new holder, and when there is none."""

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self._lease: Lease | None = None
        self._until_s = 0.0
        self._count = 0
        self._listeners: list[Callable[[], None]] = []

    def subscribe(self, on_change: Callable[[], None]) -> None:
        """Call ``on_change`` after every change of the holder."""
        self._listeners.append(on_change)

    @property
    def lease(self) -> Lease | None:
        """The lease in force."""
        return self._lease if self._clock() < self._until_s else None

    @property
    def left_s(self) -> float:
        """Seconds until the lease lapses."""
        return max(self._until_s - self._clock(), 0.0) if self._lease is not None else 0.0

    def holds(self, key: str | None) -> bool:
        """Whether ``key`` is that of the lease in force."""
        lease = self.lease
        return lease is not None and key is not None and secrets.compare_digest(lease.key.encode(), key.encode())

    def grant(self, holder: str, seconds: float = RENEWED_S, *, over: bool = False, identity: str = "") -> Lease:
        """Return a new lease; Problem while another has it, unless it is taken ``over``.

        What a script of this ``identity`` holds unasked is its own.
        """
        lease = self.lease
        if lease is not None and not over and lease.key != identity:
            raise Problem(HTTPStatus.CONFLICT, f"{lease.holder} has control; take it over or wait until it is free")
        return self._give(secrets.token_urlsafe(18), holder, seconds, identity)

    def renew(self, key: str | None) -> Lease:
        """Renew the lease; Problem when ``key`` no longer holds it."""
        lease = self._need_own(key)
        self._until_s = self._clock() + lease.seconds
        return lease

    def release(self, key: str | None) -> Lease:
        """End the lease; Problem when ``key`` no longer holds it."""
        lease = self._need_own(key)
        self._end()
        return lease

    def revoke(self, identity: str) -> Lease | None:
        """Take the lease from a credential that is no longer good; return it if it was theirs."""
        lease = self.lease
        if lease is None or lease.identity != identity:
            return None
        self._end()
        return lease

    def hurry(self, key: str | None) -> None:
        """Let a page's lease lapse soon: its socket has closed."""
        if self._lease is not None and self.holds(key) and self._lease.seconds <= RENEWED_S:
            self._until_s = min(self._until_s, self._clock() + GONE_S)

    def need(self, key: str | None, identity: str) -> None:
        """Raise a Problem unless this caller may move the robot; who has no key gets a lease that is free."""
        if key is not None:
            self.renew(key)
        elif self.lease is None:
            self._give(identity, "a script", UNASKED_S, identity)
        elif self.holds(identity):
            self.renew(identity)
        else:
            assert self._lease is not None
            raise Problem(HTTPStatus.CONFLICT, f"{self._lease.holder} has control; take it over first")

    def lapse(self) -> Lease | None:
        """End a lease that was not renewed in time and return it."""
        lease = self._lease
        if lease is None or self._clock() < self._until_s:
            return None
        self._end()
        return lease

    def _need_own(self, key: str | None) -> Lease:
        lease = self.lease
        if lease is None or not self.holds(key):
            whose = "nobody has it" if lease is None else f"{lease.holder} has it"
            raise Problem(HTTPStatus.CONFLICT, f"you do not have control; {whose}")
        return lease

    def _give(self, key: str, holder: str, seconds: float, identity: str) -> Lease:
        self._count += 1
        self._lease = lease = Lease(self._count, key, holder, seconds, identity)
        self._until_s = self._clock() + seconds
        self._publish()
        return lease

    def _end(self) -> None:
        self._lease = None
        self._publish()

    def _publish(self) -> None:
        for listener in self._listeners:
            listener()
