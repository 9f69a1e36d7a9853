"""Who may talk to the server, and as what: one-time codes, session cookies, bearer tokens, Host and Origin checks."""

import hashlib
import hmac
import ipaddress
import os
import secrets
import socket
from collections.abc import Callable
from dataclasses import dataclass
from http import HTTPStatus
from time import time
from typing import Literal
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.responses import RedirectResponse, Response

from snakeslam.errors import InputError

COOKIE = "snakeslam_session"
TOKEN_VARIABLE = "SNAKESLAM_TOKEN"
VIEWER_VARIABLE = "SNAKESLAM_VIEWER_TOKEN"
LEAST_TOKEN_LENGTH = 16
SESSION_S = 12 * 3600.0
LEASE_HEADER = "control-lease"
Role = Literal["viewer", "operator"]


@dataclass(frozen=True, slots=True)
class Caller:
    """Who asks: ``identity`` names their credential without giving it away, ``lease_key`` is that of their lease."""

    role: Role
    identity: str
    lease_key: str | None


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
    token = _token_in(TOKEN_VARIABLE)
    if token is None and not is_loopback(host):
        raise InputError(f"--host {host}", f"needs a token in {TOKEN_VARIABLE}", "127.0.0.1 without one")
    return token


def viewer_token_from_environment() -> str | None:
    """Return the token of those who may only watch, if there is one; InputError when it is too short."""
    return _token_in(VIEWER_VARIABLE)


def _token_in(variable: str) -> str | None:
    token = os.environ.get(variable)
    if token is not None and len(token) < LEAST_TOKEN_LENGTH:
        raise InputError(variable, "the token is too short", f"{LEAST_TOKEN_LENGTH} characters or more")
    return token


class Auth:
    """Knows the tokens and the code of the next sign-in URL, and signs sessions.

    A session is role.expiry.nonce.MAC under a key made from the token: who sets the token keeps everybody signed in
    when the server starts again.
    """

    def __init__(self, token: str, announce: Callable[[str], None], viewer_token: str | None = None) -> None:
        self._tokens: dict[Role, str] = {"operator": token}
        if viewer_token is not None:
            self._tokens["viewer"] = viewer_token
        self._announce = announce
        self._ended: dict[str, float] = {}
        self.code = secrets.token_urlsafe(24)

    def redeem(self, code: str) -> str | None:
        """Return a new session for the one-time ``code`` and make the next code; None for a wrong one."""
        if not _same(code, self.code):
            return None
        self.code = secrets.token_urlsafe(24)
        self._announce(self.code)
        return self._open("operator")

    def sign_in(self, token: str) -> str | None:
        """Return a new session for a token; None for a wrong one."""
        role = self._role_of(token)
        return None if role is None else self._open(role)

    def sign_out(self, connection: HTTPConnection) -> None:
        """End the session of a request, if it has one."""
        session, now = connection.cookies.get(COOKIE, ""), time()
        if self._role_in(session) is not None:
            self._ended = {ended: until for ended, until in self._ended.items() if until > now}
            self._ended[session] = now + SESSION_S

    def caller(self, connection: HTTPConnection) -> Caller | None:
        """Return who asks: by token or open session; None for a stranger."""
        scheme, _, credentials = connection.headers.get("authorization", "").partition(" ")
        credential = credentials.strip()
        role = self._role_of(credential) if scheme.lower() == "bearer" else None
        if role is None:
            credential = connection.cookies.get(COOKIE, "")
            role = self._role_in(credential)
        if role is None:
            return None
        identity = hashlib.sha256(credential.encode()).hexdigest()[:12]
        return Caller(role, identity, connection.headers.get(LEASE_HEADER))

    def _role_of(self, token: str) -> Role | None:
        for role, known in self._tokens.items():
            if _same(token, known):
                return role
        return None

    def _open(self, role: Role) -> str:
        claim = f"{role}.{round(time() + SESSION_S)}.{secrets.token_urlsafe(18)}"
        return f"{claim}.{self._mac(role, claim)}"

    def _role_in(self, session: str) -> Role | None:
        """Return the role that a session opens, None for one that is forged, over or ended."""
        claim, _, mac = session.rpartition(".")
        name, _, rest = claim.partition(".")
        if name not in ("operator", "viewer") or name not in self._tokens:
            return None
        role: Role = name
        if not _same(mac, self._mac(role, claim)) or session in self._ended:
            return None
        return role if time() < int(rest.partition(".")[0]) else None

    def _mac(self, role: Role, claim: str) -> str:
        return hmac.new(b"session:" + self._tokens[role].encode(), claim.encode(), "sha256").hexdigest()


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
