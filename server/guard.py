"""What every request meets first: Host, Origin, sign-in, role, rate and body size, before anything else sees it."""

import asyncio
from http import HTTPStatus

from starlette.requests import HTTPConnection
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.auth import TOKEN_VARIABLE, Auth, Caller, HostRule, same_origin
from server.limits import Limiter
from server.metrics import Metrics
from server.problem import problem_response

MAX_BODY_BYTES = 64 * 1024
LATE_S, BODY_S = 0.1, 10.0
HOST_REFUSED = "this server does not answer to that Host name; --set server.hosts=[NAME] allows one"
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
PROTECTED = ("/api/", "/viewer", "/metrics")
SIGN_IN = "/api/v1/session"
LOGIN = "/login"
ESTOP = "/api/v1/estop"
TELEOP = "/api/v1/teleop"
VIEWERS_MAY = (ESTOP, SIGN_IN)
PAGE_POLICY = (
    "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; object-src 'none'; "
    "base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)


class Guard:
    """ASGI middleware; leaves the caller in ``scope["state"]``."""

    def __init__(self, app: ASGIApp, auth: Auth, hosts: HostRule, limiter: Limiter, metrics: Metrics) -> None:
        self._app, self._auth, self._hosts = app, auth, hosts
        self._limiter, self._metrics = limiter, metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        caller = self._auth.caller(connection)
        edge = connection.scope.get("state", {}).get("edge")
        if edge is not None and caller is not None and scope["type"] == "http":
            edge.connection.known.signed_in(edge, caller.role, caller.identity)
        if scope["type"] == "http":
            send = _with_security_headers(send)
        refusal = self._refusal(connection, caller)
        if refusal is not None:
            await _refuse(refusal, scope, receive, send)
            return
        if scope["type"] == "http":
            if caller is not None and connection.url.path == ESTOP and not self._limiter.allows("estop", _who(caller)):
                send = _late(send)
            try:
                async with asyncio.timeout(BODY_S):
                    body = await _capped_body(receive) if scope["method"] not in SAFE_METHODS else b""
            except TimeoutError:
                late = problem_response(HTTPStatus.REQUEST_TIMEOUT, "the body did not come", {"Connection": "close"})
                await late(scope, receive, send)
                return
            if body is None:
                too_large = problem_response(413, f"the body is larger than {MAX_BODY_BYTES} bytes")
                await too_large(scope, receive, send)
                return
            if scope["method"] not in SAFE_METHODS:
                receive = _replay(body, receive)
        await self._app(scope, receive, send)

    def _refusal(self, connection: HTTPConnection, caller: Caller | None) -> Response | None:
        path, write = connection.url.path, _writes(connection)
        connection.scope.setdefault("state", {})["caller"] = caller
        if not self._hosts.allows(connection.headers.get("host", "")):
            return problem_response(HTTPStatus.MISDIRECTED_REQUEST, HOST_REFUSED)
        if (write or connection.scope["type"] == "websocket") and not same_origin(connection.headers):
            return problem_response(HTTPStatus.FORBIDDEN, "requests from other origins are refused")
        if not self._within_rate(connection, caller, write):
            wait = {"Retry-After": "1"}
            return problem_response(HTTPStatus.TOO_MANY_REQUESTS, "too many requests; wait a second", wait)
        signing_in = path == SIGN_IN and connection.scope.get("method") == "POST"
        if path.startswith(PROTECTED) and not signing_in and caller is None:
            detail = f"sign in with the printed URL, or send Authorization: Bearer and the token (${TOKEN_VARIABLE})"
            return problem_response(HTTPStatus.UNAUTHORIZED, detail, {"WWW-Authenticate": "Bearer"})
        if caller is not None and caller.role == "viewer" and (write or path == TELEOP) and path not in VIEWERS_MAY:
            return problem_response(HTTPStatus.FORBIDDEN, "you may watch and press the E-stop, nothing else")
        return None

    def _within_rate(self, connection: HTTPConnection, caller: Caller | None, write: bool) -> bool:
        path = connection.url.path
        if path == ESTOP and caller is not None:
            return True
        if path == LOGIN or (path == SIGN_IN and write):
            return True  # Only wrong ones count, and are counted where that is known.
        kind = "write" if write else "read"
        host = connection.client.host if connection.client is not None else ""
        watching = caller is not None and caller.role == "viewer"
        if self._limiter.allows(kind, caller.identity if caller is not None else host) and (
            not watching or self._limiter.allows("viewers", "")
        ):
            return True
        self._metrics.limited.labels(kind).inc()
        return False


def _who(caller: Caller) -> str:
    """Return the name under which presses are counted: an operator's own, or one for all viewers."""
    return caller.role if caller.role == "viewer" else caller.identity


def _writes(connection: HTTPConnection) -> bool:
    return connection.scope["type"] == "http" and connection.scope["method"] not in SAFE_METHODS


async def _refuse(refusal: Response, scope: Scope, receive: Receive, send: Send) -> None:
    """Answer instead of the application; a websocket's handshake gets the same as an HTTP answer.

    Who asks too often is answered late: a program that waits for each answer is slowed down by it.
    """
    if refusal.status_code == HTTPStatus.TOO_MANY_REQUESTS:
        await asyncio.sleep(LATE_S)
    if scope["type"] == "http":
        await refusal(scope, receive, send)
        return
    start: Message = {"status": refusal.status_code, "headers": _secured(refusal.raw_headers)}
    await send({"type": "websocket.http.response.start", **start})
    await send({"type": "websocket.http.response.body", "body": bytes(refusal.body)})


async def _capped_body(receive: Receive) -> bytes | None:
    """Return the whole body; None when it is too large."""
    parts: list[bytes] = []
    size, more = 0, True
    while more:
        message = await receive()
        parts.append(message.get("body", b""))
        size += len(parts[-1])
        more = message.get("more_body", False)
        if size > MAX_BODY_BYTES:
            return None
    return b"".join(parts)


def _replay(body: bytes, receive: Receive) -> Receive:
    """Return a ``receive`` that gives the body that was read already."""
    given = False

    async def receive_body() -> Message:
        nonlocal given
        if given:
            return await receive()
        given = True
        return {"type": "http.request", "body": body, "more_body": False}

    return receive_body


def _late(send: Send) -> Send:
    """Return a ``send`` that waits before it answers; what was asked for has been done by then."""

    async def send_late(message: Message) -> None:
        if message["type"] == "http.response.start":
            await asyncio.sleep(LATE_S)
        await send(message)

    return send_late


def _with_security_headers(send: Send) -> Send:
    """Return a ``send`` that adds what every answer carries, unless the answer says otherwise."""

    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = _secured(list(message.get("headers", [])))
        await send(message)

    return send_with_headers


def _secured(headers: list[tuple[bytes, bytes]]) -> list[tuple[bytes, bytes]]:
    """Return the headers of an answer with those that every answer carries."""
    have = {name.lower() for name, _ in headers}
    wanted = {
        b"content-security-policy": PAGE_POLICY.encode(),
        b"x-content-type-options": b"nosniff",
        b"referrer-policy": b"no-referrer",
        b"cross-origin-resource-policy": b"same-origin",
        b"cache-control": b"no-store",
    }
    return headers + [(name, value) for name, value in wanted.items() if name not in have]
