"""Who may talk to the server: one-time sign-in codes, session cookies, the bearer token, and Host and Origin checks."""

import ipaddress
import os
import secrets
import socket
from collections.abc import Callable
from http import HTTPStatus
from time import monotonic
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.problem import problem_response
from snakeslam.errors import InputError

COOKIE = "snakeslam_session"
TOKEN_VARIABLE = "SNAKESLAM_TOKEN"
LEAST_TOKEN_LENGTH = 16
SESSION_S = 12 * 3600.0
MAX_SESSIONS = 64
MAX_BODY_BYTES = 64 * 1024
SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
PROTECTED = ("/api/", "/viewer", "/metrics")
SIGN_IN = "/api/v1/session"
PAGE_POLICY = (
    "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; object-src 'none'; "
    "base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)


def is_loopback(host: str) -> bool:
    """Whether a server bound to ``host`` can be reached from this machine only."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def token_from_environment(host: str) -> str | None:
    """Return the user's token; InputError when one is needed or too short."""
    token = os.environ.get(TOKEN_VARIABLE)
    if token is not None and len(token) < LEAST_TOKEN_LENGTH:
        raise InputError(TOKEN_VARIABLE, "the token is too short", f"{LEAST_TOKEN_LENGTH} characters or more")
    if token is None and not is_loopback(host):
        raise InputError(f"--host {host}", f"needs a token in {TOKEN_VARIABLE}", "127.0.0.1 without one")
    return token


class Auth:
    """Knows the token, the code of the next sign-in URL and the open sessions."""

    def __init__(self, token: str, announce: Callable[[str], None]) -> None:
        self._token = token
        self._announce = announce
        self._sessions: dict[str, float] = {}
        self.code = secrets.token_urlsafe(24)

    def redeem(self, code: str) -> str | None:
        """Return a new session for the one-time ``code`` and make the next code; None for a wrong one."""
        if not _same(code, self.code):
            return None
        self.code = secrets.token_urlsafe(24)
        self._announce(self.code)
        return self._open()

    def sign_in(self, token: str) -> str | None:
        """Return a new session for the token; None for a wrong one."""
        return self._open() if _same(token, self._token) else None

    def allows(self, connection: HTTPConnection) -> bool:
        """Whether a request carries the token or an open session."""
        scheme, _, credentials = connection.headers.get("authorization", "").partition(" ")
        if scheme.lower() == "bearer" and _same(credentials.strip(), self._token):
            return True
        expires = self._sessions.get(connection.cookies.get(COOKIE, ""))
        return expires is not None and monotonic() < expires

    def _open(self) -> str:
        now = monotonic()
        live = sorted(((t, key) for key, t in self._sessions.items() if t > now), reverse=True)
        self._sessions = {key: t for t, key in live[: MAX_SESSIONS - 1]}
        session = secrets.token_urlsafe(32)
        self._sessions[session] = now + SESSION_S
        return session


def _same(given: str, wanted: str) -> bool:
    return secrets.compare_digest(given.encode(), wanted.encode())


def set_cookie(response: Response, session: str) -> None:
    """Give the browser its session."""
    response.set_cookie(COOKIE, session, max_age=round(SESSION_S), httponly=True, samesite="strict", path="/")


def login_response(auth: Auth, code: str) -> Response:
    """Answer /login: into the page with a session, or just to the page, which then asks for the token."""
    response = RedirectResponse("/", HTTPStatus.SEE_OTHER)
    session = auth.redeem(code)
    if session is not None:
        set_cookie(response, session)
    return response


class HostRule:
    """Which Host names are ours, so that no foreign name can be pointed at this address (DNS rebinding)."""

    def __init__(self, bound: str) -> None:
        self._names = {"localhost", bound.lower(), socket.gethostname().lower()}
        self._any_address = not is_loopback(bound)

    def allows(self, host: str) -> bool:
        """Whether a Host header (name or address, with or without a port) is ours."""
        name = _host_name(f"//{host}")
        if name in self._names:
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        return self._any_address or address.is_loopback


def _host_name(url: str) -> str:
    try:
        return (urlsplit(url).hostname or "").lower()
    except ValueError:
        return ""


def same_origin(headers: Headers) -> bool:
    """Whether the page that asks comes from this server; programs send no Origin."""
    origin = headers.get("origin")
    if origin is None:
        return True
    scheme, _, netloc = origin.partition("://")
    return scheme in ("http", "https") and netloc.lower() == headers.get("host", "").lower()


class Guard:
    """ASGI middleware: Host, Origin, sign-in and body size, before anything else sees a request."""

    def __init__(self, app: ASGIApp, auth: Auth, hosts: HostRule) -> None:
        self._app, self._auth, self._hosts = app, auth, hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(HTTPConnection(scope))
        if refusal is not None:
            await _refuse(refusal, scope, receive, send)
            return
        if scope["type"] == "http":
            send = _with_security_headers(send)
            body = await _capped_body(receive) if scope["method"] not in SAFE_METHODS else b""
            if body is None:
                too_large = problem_response(413, f"the body is larger than {MAX_BODY_BYTES} bytes")
                await too_large(scope, receive, send)
                return
            if scope["method"] not in SAFE_METHODS:
                receive = _replay(body, receive)
        await self._app(scope, receive, send)

    def _refusal(self, connection: HTTPConnection) -> Response | None:
        headers, path = connection.headers, connection.url.path
        if not self._hosts.allows(headers.get("host", "")):
            return problem_response(HTTPStatus.MISDIRECTED_REQUEST, "this server does not answer to that Host name")
        unsafe = connection.scope["type"] == "websocket" or connection.scope["method"] not in SAFE_METHODS
        if unsafe and not same_origin(headers):
            return problem_response(HTTPStatus.FORBIDDEN, "requests from other origins are refused")
        if path.startswith(PROTECTED) and path != SIGN_IN and not self._auth.allows(connection):
            detail = f"sign in with the printed URL, or send Authorization: Bearer and the token (${TOKEN_VARIABLE})"
            return problem_response(HTTPStatus.UNAUTHORIZED, detail, {"WWW-Authenticate": "Bearer"})
        return None


async def _refuse(refusal: Response, scope: Scope, receive: Receive, send: Send) -> None:
    """Answer instead of the application; a websocket's handshake gets the same as an HTTP answer."""
    if scope["type"] == "http":
        await refusal(scope, receive, send)
        return
    start: Message = {"status": refusal.status_code, "headers": refusal.raw_headers}
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


def _with_security_headers(send: Send) -> Send:
    """Return a ``send`` that adds what every answer carries, unless the answer says otherwise."""

    async def send_with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers: list[tuple[bytes, bytes]] = list(message.get("headers", []))
            have = {name.lower() for name, _ in headers}
            wanted = {
                b"content-security-policy": PAGE_POLICY.encode(),
                b"x-content-type-options": b"nosniff",
                b"referrer-policy": b"no-referrer",
                b"cross-origin-resource-policy": b"same-origin",
                b"cache-control": b"no-store",
            }
            message["headers"] = headers + [(k, v) for k, v in wanted.items() if k not in have]
        await send(message)

    return send_with_headers
