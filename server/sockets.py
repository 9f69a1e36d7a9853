"""The open websockets: how many each credential may have of each kind, and that they end with their session."""

import asyncio
import contextlib
import ctypes
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from itertools import count
from typing import Literal

from starlette.websockets import WebSocket

from server.auth import Caller
from server.metrics import Metrics

Kind = Literal["telemetry", "viewer", "teleop"]
TOO_MANY, SIGNED_OUT = 1013, 4401
CLOSE_S, GIVE_BACK_S = 1.0, 3.0


@dataclass(frozen=True, slots=True)
class Limit:
    """How many sockets of a kind may be open: with one credential, by all viewers, and in total."""

    each: int
    viewers: int
    total: int


LIMITS: dict[Kind, Limit] = {
    "telemetry": Limit(each=24, viewers=28, total=32),
    "viewer": Limit(each=12, viewers=20, total=24),
    "teleop": Limit(each=4, viewers=0, total=8),
}


@dataclass(frozen=True, slots=True, eq=False)
class _Open:
    """One open socket; ``end`` gets the code and the words with which it is to be closed."""

    kind: Kind
    caller: Caller
    number: int
    end: "asyncio.Future[tuple[int, str]]"

    def close(self, code: int, why: str) -> None:
        if not self.end.done():
            self.end.set_result((code, why))


class Sockets:
    """Admits websockets; an operator is always admitted; where it is full, the oldest viewer's is closed."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics
        self._open: dict[int, _Open] = {}
        self._numbers = count()
        self._giving_back = False

    async def serve(
        self, kind: Kind, socket: WebSocket, caller: Caller, handler: Callable[[WebSocket], Awaitable[None]]
    ) -> None:
        """Run ``handler`` until it ends, or until the socket has to go."""
        refusal = self._refusal(kind, caller)
        if refusal is not None:
            self._metrics.limited.labels(kind).inc()
            await _accept(socket)  # A close code only reaches a client whose handshake was accepted.
            await socket.close(TOO_MANY, refusal)
            return
        number = next(self._numbers)
        entry = self._open[number] = _Open(kind, caller, number, asyncio.get_running_loop().create_future())
        handling = asyncio.ensure_future(handler(socket))
        try:
            await asyncio.wait({handling, entry.end}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            del self._open[number]
            await _finish(handling)
            if kind == "viewer":
                self._give_back_soon()
        if entry.end.done():
            await _close(socket, *entry.end.result())

    def end_session(self, identity: str) -> None:
        """Close every socket of a credential that is no longer good."""
        for entry in self._open.values():
            if entry.caller.identity == identity:
                entry.close(SIGNED_OUT, "signed out")

    def _give_back_soon(self) -> None:
        """Return the memory of closed views to the system, once for all that close at about the same time."""
        if not self._giving_back:
            self._giving_back = True
            asyncio.get_running_loop().call_later(GIVE_BACK_S, self._give_back)

    def _give_back(self) -> None:
        self._giving_back = False
        asyncio.get_running_loop().run_in_executor(None, _trim_heap)

    def _refusal(self, kind: Kind, caller: Caller) -> str | None:
        """Return why one more socket is too many; an operator's replaces another one."""
        limit = LIMITS[kind]
        same = [entry for entry in self._open.values() if entry.kind == kind and not entry.end.done()]
        own = [entry for entry in same if entry.caller.identity == caller.identity]
        watching = [entry for entry in same if entry.caller.role == "viewer"]
        if caller.role == "viewer":
            if len(own) >= limit.each:
                return f"you have {limit.each} of these open already"
            full = len(watching) >= limit.viewers or len(same) >= limit.total
            return "too many are watching" if full else None
        if len(own) < limit.each and len(same) < limit.total:
            return None
        replaced = own if len(own) >= limit.each else watching or own
        if not replaced:
            return "too many operators"
        replaced[0].close(TOO_MANY, "an operator's took its place")
        return None


def _trim_heap() -> None:
    """Return freed memory to the system, which glibc keeps otherwise; other C libraries have no such function."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


async def _accept(socket: WebSocket) -> None:
    offered: list[str] = socket.scope.get("subprotocols", [])
    await socket.accept(next(iter(offered), None))


async def _finish(handling: "asyncio.Future[None]") -> None:
    """Let a handler clean up; what went wrong in it goes on, except its own cancellation."""
    if not handling.done():
        handling.cancel()
        await asyncio.wait({handling})
    if not handling.cancelled():
        handling.result()


async def _close(socket: WebSocket, code: int, why: str) -> None:
    """Close a socket, whatever its other side does."""
    with contextlib.suppress(RuntimeError, TimeoutError):  # closed already, or nobody reads it
        async with asyncio.timeout(CLOSE_S):
            await socket.close(code, why)
