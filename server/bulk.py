"""Large answers: each made once in threads of their own, sent in pieces, and few at a time.

So a crowd that reads the map, the recordings or the trajectory as fast as it can leaves the event loop, and with it the
emergency stop and the drive, their turn after every piece.
"""

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from http import HTTPStatus
from time import monotonic
from typing import Generic, TypeVar

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from server.auth import Caller
from server.problem import problem_response

T = TypeVar("T")
PIECE_BYTES = 64 * 1024
MOST_EACH, MOST_VIEWERS, MOST = 2, 6, 8
"""The number of answers at a time: to one credential, to all viewers, and to all callers."""
THREADS = 2
WAIT_S, POLL_S = 1.0, 0.02
RETRY_AFTER = {"Retry-After": "1"}


class Bulk:
    """Who is being sent a large answer, and the threads in which they are made."""

    def __init__(self) -> None:
        self._executor = ThreadPoolExecutor(THREADS, "bulk")
        self._running: Counter[str] = Counter()
        self._viewers = 0

    async def make(self, work: Callable[[], T]) -> T:
        """Return what ``work`` returns in a thread for large answers; those before it come first."""
        return await asyncio.get_running_loop().run_in_executor(self._executor, work)

    def close(self) -> None:
        """End the threads."""
        self._executor.shutdown(wait=False, cancel_futures=True)

    def free(self, caller: Caller) -> bool:
        """Whether ``caller`` may have one more large answer now."""
        viewer = caller.role == "viewer"
        return (
            self._running[caller.identity] < MOST_EACH
            and self._running.total() < MOST
            and not (viewer and self._viewers >= MOST_VIEWERS)
        )

    async def wait_free(self, caller: Caller) -> bool:
        """Wait a moment until ``caller`` may have one more; False when that takes too long."""
        until_s = monotonic() + WAIT_S
        while not self.free(caller):
            if monotonic() > until_s:
                return False
            await asyncio.sleep(POLL_S)
        return True

    @contextmanager
    def sending(self, caller: Caller) -> Generator[None]:
        """Count one answer to ``caller`` meanwhile."""
        self._running[caller.identity] += 1
        self._viewers += caller.role == "viewer"
        try:
            yield
        finally:
            self._viewers -= caller.role == "viewer"
            self._running[caller.identity] -= 1
            if not self._running[caller.identity]:
                del self._running[caller.identity]


class Made(Generic[T]):
    """A value that is made again when what it is made from has changed; all who ask meanwhile wait for the same one.

    It is at most ``least_s`` older than its source, so that a source that changes all the time is not followed.
    """

    def __init__(self, bulk: Bulk, make: Callable[[], T], version: Callable[[], object], least_s: float) -> None:
        self._bulk, self._make, self._version, self._least_s = bulk, make, version, least_s
        self._made_of: object = object()
        self._made_s = -least_s
        self._task: asyncio.Task[T] | None = None

    async def get(self) -> T:
        """Return the value; what goes wrong in making it is raised to all who wait for it."""
        if self._task is None or (self._task.done() and self._outdated()):
            self._made_of, self._made_s = self._version(), monotonic()
            self._task = asyncio.create_task(self._bulk.make(self._make))
        return await asyncio.shield(self._task)

    def _outdated(self) -> bool:
        assert self._task is not None
        failed = self._task.cancelled() or self._task.exception() is not None
        return failed or (self._version() != self._made_of and monotonic() - self._made_s >= self._least_s)


class BulkResponse(Response):
    """A large answer to ``caller``; 429 where they have too many of them under way."""

    def __init__(
        self, bulk: Bulk, caller: Caller, content: Callable[[], Awaitable[bytes]], media_type: str, file_name: str = ""
    ) -> None:
        disposition = {"Content-Disposition": f'attachment; filename="{file_name}"'} if file_name else {}
        super().__init__(None, HTTPStatus.OK, disposition, media_type)
        self._bulk, self._who, self._content = bulk, caller, content

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send it."""
        if not await self._bulk.wait_free(self._who):
            detail = "you are being sent as many large answers as there may be at a time; ask again in a second"
            await problem_response(HTTPStatus.TOO_MANY_REQUESTS, detail, RETRY_AFTER)(scope, receive, send)
            return
        with self._bulk.sending(self._who):
            content = memoryview(await self._content())
            self.headers["Content-Length"] = str(len(content))
            await send({"type": "http.response.start", "status": self.status_code, "headers": self.raw_headers})
            await _send_pieces(content, send)


async def _send_pieces(content: memoryview, send: Send) -> None:
    for start in range(0, max(len(content), 1), PIECE_BYTES):
        piece = bytes(content[start : start + PIECE_BYTES])
        more = start + PIECE_BYTES < len(content)
        await send({"type": "http.response.body", "body": piece, "more_body": more})
        # The socket may take all of it without waiting: others must have their turn all the same.
        await asyncio.sleep(0)
