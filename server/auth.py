"""Who may talk to the server, and as what: one-time codes, session cookies, bearer tokens, Host and Origin checks."""

import ipaddress
import os
import re
import secrets
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from http import HTTPStatus
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.requests import HTTPConnection
from starlette.responses import RedirectResponse, Response

from server.sessions import IDENTITY_CHARS, Role, Session, Sessions, digest
from snakeslam.errors import InputError

COOKIE = "snakeslam_session"
TOKEN_VARIABLE = "SNAKESLAM_TOKEN"
VIEWER_VARIABLE = "SNAKESLAM_VIEWER_TOKEN"
LEAST_TOKEN_LENGTH = 16
LEASE_HEADER = "control-lease"
HOST_NAME = re.compile(r"(\*\.)?[A-Za-z0-9_-]{1,63}(\.[A-Za-z0-9_-]{1,63})*\.?")


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
    """Knows the tokens and the code of the next sign-in URL, and opens sessions."""

    def __init__(
        self, token: str, announce: Callable[[str], None], sessions: Sessions, viewer_token: str | None = None
    ) -> None:
        self._tokens = tokens_by_role(token, viewer_token)
        self._announce = announce
        self.sessions = sessions
        self.code = secrets.token_urlsafe(24)

    async def redeem(self, code: str) -> str | None:
        """Return a new session for the one-time ``code`` and make the next code; None for a wrong one."""
        if not _same(code, self.code):
            return None
        self.code = secrets.token_urlsafe(24)
        self._announce(self.code)
        return await self.sessions.open("operator")

    async def sign_in(self, token: str) -> str | None:
        """Return a new session for a token; None for a wrong one."""
        role = self._role_of(token)
        return None if role is None else await self.sessions.open(role)

    async def sign_out(self, connection: HTTPConnection, everywhere: bool) -> list[Session]:
        """End the session of a request, or all of them, for good; return those that ended."""
        own = self.sessions.find(connection.cookies.get(COOKIE, ""))
        ended = self.sessions.all() if everywhere else [own] if own is not None else []
        await self.sessions.end(ended)
        return ended

    def caller(self, connection: HTTPConnection) -> Caller | None:
        """Return who asks: by token or open session; None for a stranger."""
        key = connection.headers.get(LEASE_HEADER)
        scheme, _, credentials = connection.headers.get("authorization", "").partition(" ")
        token = credentials.strip()
        role = self._role_of(token) if scheme.lower() == "bearer" else None
        if role is not None:
            return Caller(role, digest(token)[:IDENTITY_CHARS], key)
        session = self.sessions.find(connection.cookies.get(COOKIE, ""))
        return None if session is None else Caller(session.role, session.identity, key)

    def _role_of(self, token: str) -> Role | None:
        for role, known in self._tokens.items():
            if _same(token, known):
                return role
        return None


def tokens_by_role(token: str, viewer_token: str | None) -> dict[Role, str]:
    """Return the tokens in force."""
    return {"operator": token} if viewer_token is None else {"operator": token, "viewer": viewer_token}


def _same(given: str, wanted: str) -> bool:
    return secrets.compare_digest(given.encode(), wanted.encode())


def set_cookie(response: Response, session: str, connection: HTTPConnection, lasting_s: float) -> None:
    """Give the browser its session; one that came over TLS sends it over TLS only."""
    secure, age_s = is_secure(connection), round(lasting_s)
    response.set_cookie(COOKIE, session, age_s, secure=secure, httponly=True, samesite="strict", path="/")


def delete_cookie(response: Response, connection: HTTPConnection) -> None:
    """Delete the session's cookie in the browser."""
    response.delete_cookie(COOKIE, path="/", httponly=True, samesite="strict", secure=is_secure(connection))


def is_secure(connection: HTTPConnection) -> bool:
    """Whether a request came over TLS, to this server or to a trusted proxy in front of it."""
    return connection.url.scheme in ("https", "wss")


async def login_response(auth: Auth, code: str, connection: HTTPConnection) -> Response:
    """Answer /login: into the page with a session, or just to the page, which then asks for the token."""
    response = RedirectResponse("/", HTTPStatus.SEE_OTHER)
    session = await auth.redeem(code)
    if session is not None:
        set_cookie(response, session, connection, auth.sessions.lasting_s)
    return response


def checked_hosts(names: Sequence[str]) -> tuple[str, ...]:
    """Return the allowed names in the form in which they are compared; InputError for what is no name."""
    for name in names:
        if HOST_NAME.fullmatch(name) is None:
            raise InputError("server.hosts", f"{name!r} is no host name", "robot.example.com or *.example.com")
    return tuple(name.lower().rstrip(".") for name in names)


def checked_proxies(addresses: Sequence[str]) -> list[str]:
    """Return the addresses and networks of trusted proxies; InputError for what is neither."""
    for address in addresses:
        try:
            ipaddress.ip_network(address)
        except ValueError as error:
            allowed = "an address or a network, such as 127.0.0.1 or 172.16.0.0/12"
            raise InputError("server.trusted_proxies", f"{address!r}: {error}", allowed) from error
    return list(addresses)


class HostRule:
    """Which Host names are ours, so that no foreign name can be pointed at this address (DNS rebinding)."""

    def __init__(self, bound: str, allowed: Sequence[str] = ()) -> None:
        machine = socket.gethostname().lower().rstrip(".")
        # What mDNS (Avahi, Bonjour) calls this machine on its own network.
        local = f"{machine.partition('.')[0]}.local"
        names = checked_hosts(allowed)
        self._names = {"localhost", bound.lower(), machine, local} | {name for name in names if name[0] != "*"}
        self._endings = tuple(name[1:] for name in names if name[0] == "*")
        self._any_address = not is_loopback(bound)

    def allows(self, host: str) -> bool:
        """Whether a Host header (name or address, with or without a port) is ours."""
        name = _host_name(f"//{host}").removesuffix(".")
        if name in self._names or (self._endings and name.endswith(self._endings)):
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
