"""Every request counted, timed and, where it changes something or is refused, logged."""

from http import HTTPMethod
from time import monotonic

import structlog
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.guard import SAFE_METHODS
from server.metrics import Metrics
from server.routes import PREFIX

MOST_CHARS = 200
METHODS = frozenset(HTTPMethod)
"""What else a stranger invents is counted as one."""
_log = structlog.get_logger("http")


class Observe:
    """ASGI middleware around everything else; a path is counted by its route, so that there are few of them."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self._app, self._metrics = app, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on and watch its answer."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        started, status = monotonic(), 500

        async def watch(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        try:
            await self._app(scope, receive, watch)
        finally:
            self._note(scope, status, monotonic() - started)

    def _note(self, scope: Scope, status: int, seconds: float) -> None:
        path = _template(scope)
        method = scope["method"] if scope["method"] in METHODS else "other"
        self._metrics.requests.labels(method, path, str(status)).inc()
        self._metrics.request_s.labels(method, path).observe(seconds)
        if scope["method"] in SAFE_METHODS and status < 400:
            return
        caller = scope.get("state", {}).get("caller")
        who = "stranger" if caller is None else f"{caller.role} {caller.identity}"
        asked = {"method": scope["method"][:MOST_CHARS], "path": scope["path"][:MOST_CHARS]}
        entry = {**asked, "status": status, "ms": round(seconds * 1e3, 1)}
        (_log.info if status < 500 else _log.error)("request", who=who, **entry)


def _template(scope: Scope) -> str:
    """Return the route's path with its parameters' names; an included router's routes leave out the API's prefix."""
    path = getattr(scope.get("route"), "path", "other")
    inside = scope["path"].startswith(PREFIX) and path.startswith("/") and not path.startswith(PREFIX)
    return f"{PREFIX}{path}" if inside else path
