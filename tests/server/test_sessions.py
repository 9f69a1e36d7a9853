"""Signing out holds: over a restart, for every open websocket, and wherever else the session was known."""

import asyncio
import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import httpx
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from server.auth import COOKIE
from server.sessions import FILE, Sessions, digest, state_folder
from server.sockets import SIGNED_OUT
from server.teleop import LOST_CONTROL
from server.viewer_proxy import SUBPROTOCOL
from tests.server.running import TOKEN, VIEWER_TOKEN, Running, is_ready, start, wait_for

OTHER_TOKEN = "another-token-for-the-tests"
TOKENS = {"operator": TOKEN, "viewer": VIEWER_TOKEN}
DAY_S = 86_400.0


@pytest.fixture
def begin(tmp_path: Path) -> Iterator[Callable[..., Running]]:
    """Start servers one after the other, with the same state folder."""
    with ExitStack() as stack:

        def started(**options: Any) -> Running:
            running = start(tmp_path, **options)
            stack.callback(running.stop)
            return running

        yield started


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """One server for the tests that leave it as it was."""
    server = start(tmp_path_factory.mktemp("sessions"))
    yield server
    server.stop()


def sign_in(running: Running, token: str = TOKEN) -> str:
    """Sign a browser in; return its cookie header."""
    with running.anonymous() as browser:
        browser.post("/api/v1/session", json={"token": token}).raise_for_status()
        return f"{COOKIE}={browser.cookies[COOKIE]}"


def status(running: Running, cookie: str) -> int:
    with running.anonymous(headers={"Cookie": cookie}) as browser:
        return browser.get("/api/v1/session").status_code


def test_signing_out_holds_over_a_restart_with_the_same_token(begin: Callable[..., Running]) -> None:
    first = begin()
    kept, ended = sign_in(first), sign_in(first)
    with first.anonymous(headers={"Cookie": ended}) as browser:
        assert browser.delete("/api/v1/session").status_code == 204
    assert [status(first, kept), status(first, ended)] == [200, 401]
    first.stop()
    second = begin()
    assert [status(second, kept), status(second, ended)] == [200, 401]
    file = second.folder / "state" / "snakeslam" / FILE
    assert file.stat().st_mode & 0o777 == 0o600
    assert file.parent.stat().st_mode & 0o777 == 0o700
    assert kept.partition("=")[2].encode() not in file.read_bytes()
    second.stop()
    assert status(begin(token=OTHER_TOKEN), kept) == 401


def open_sockets(running: Running, cookie: str, stack: ExitStack) -> list[ClientConnection]:
    def opened(path: str, protocol: str | None = None) -> ClientConnection:
        protocols = None if protocol is None else [Subprotocol(protocol)]
        url, headers = running.websocket + path, {"Cookie": cookie}
        return stack.enter_context(
            connect(url, close_timeout=0.5, additional_headers=headers, subprotocols=protocols, max_size=None)
        )

    return [opened("/api/v1/telemetry"), opened("/viewer", SUBPROTOCOL), opened("/api/v1/teleop")]


def close_code(socket: ClientConnection) -> int:
    """Read to the end; return why it ended."""
    with suppress(ConnectionClosed):
        while True:
            socket.recv(timeout=30)
    assert socket.close_code is not None
    return socket.close_code


@pytest.mark.parametrize("everywhere", [False, True])
def test_signing_out_ends_the_sockets_the_drive_and_the_lease(running: Running, everywhere: bool) -> None:
    with running.client() as other, ExitStack() as stack:
        wait_for(lambda: is_ready(other))
        cookie = sign_in(running)
        browser = stack.enter_context(running.anonymous(headers={"Cookie": cookie}))
        lease = browser.post("/api/v1/control/lease", json={"name": "page", "seconds": 60}).json()
        browser.post("/api/v1/gait/start", headers={"Control-Lease": lease["key"]}).raise_for_status()
        wait_for(lambda: other.get("/api/v1/state").json()["moving"])
        sockets = open_sockets(running, cookie, stack)
        sockets[-1].send(json.dumps({"type": "hello", "lease": lease["key"]}))
        assert json.loads(sockets[-1].recv(timeout=30)) == {"type": "ready"}
        who = other if everywhere else browser
        assert who.delete("/api/v1/session", params={"everywhere": everywhere}).status_code == 204
        codes = [close_code(socket) for socket in sockets]
        assert codes[:2] == [SIGNED_OUT] * 2
        assert codes[2] in (SIGNED_OUT, LOST_CONTROL)  # both have happened; either may be noticed first
        wait_for(lambda: not other.get("/api/v1/state").json()["moving"])
        assert other.get("/api/v1/control/lease").json()["holder"] is None
        assert status(running, cookie) == 401


def test_who_only_watches_signs_nobody_else_out(running: Running) -> None:
    operator, viewer = sign_in(running), sign_in(running, VIEWER_TOKEN)
    with running.anonymous(headers={"Cookie": viewer}) as browser:
        assert browser.delete("/api/v1/session", params={"everywhere": True}).status_code == 403
        assert browser.delete("/api/v1/session").status_code == 204
    assert [status(running, operator), status(running, viewer)] == [200, 401]


@pytest.mark.parametrize(
    "change", [lambda s: s[:-1] + ("0" if s[-1] != "0" else "1"), lambda s: s[:0], lambda s: s[:9]]
)
def test_a_session_cannot_be_guessed(running: Running, change: Callable[[str], str]) -> None:
    secret = sign_in(running).partition("=")[2]
    assert status(running, f"{COOKIE}={change(secret)}") == 401
    assert status(running, f"{COOKIE}={digest(secret)}") == 401


def test_sessions_end_in_time_and_with_their_token(tmp_path: Path) -> None:
    now_s = 1e9
    sessions = Sessions(TOKENS, tmp_path, DAY_S, lambda: now_s)

    async def over_time() -> None:
        nonlocal now_s
        secret = await sessions.open("viewer")
        assert sessions.find(secret) is not None
        now_s += DAY_S + 1.0
        assert sessions.find(secret) is None
        assert [session.role for session in await sessions.poll()] == ["viewer"]
        assert await sessions.poll() == []
        secret = await sessions.open("viewer")
        without_viewers = Sessions({"operator": TOKEN}, tmp_path, DAY_S, lambda: now_s)
        assert without_viewers.find(secret) is None
        without_viewers.close()

    asyncio.run(over_time())
    sessions.close()


def test_what_one_server_ends_is_over_in_another_with_the_same_file(tmp_path: Path) -> None:
    async def two() -> None:
        one, other = Sessions(TOKENS, tmp_path, DAY_S), Sessions(TOKENS, tmp_path, DAY_S)
        secret = await one.open("operator")
        assert await other.poll() == []
        found = other.find(secret)
        assert found is not None
        await one.end(one.all())
        assert await other.poll() == [found]
        assert other.find(secret) is None
        one.close()
        other.close()

    asyncio.run(two())


@pytest.mark.parametrize("content", [b"this is no database" * 100, b""])
def test_a_broken_file_signs_everybody_out_and_nothing_else(tmp_path: Path, content: bytes) -> None:
    (tmp_path / FILE).write_bytes(content)

    async def use() -> None:
        sessions = Sessions(TOKENS, tmp_path, DAY_S)
        secret = await sessions.open("operator")
        sessions.close()
        again = Sessions(TOKENS, tmp_path, DAY_S)
        assert again.find(secret) is not None
        again.close()

    asyncio.run(use())


def test_without_a_folder_that_can_be_written_sessions_end_with_the_server(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")

    async def use() -> None:
        sessions = Sessions(TOKENS, tmp_path / "file", DAY_S)
        assert sessions.find(await sessions.open("operator")) is not None
        sessions.close()

    asyncio.run(use())


def test_where_the_state_lies(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", "/state")
    assert state_folder(None) == Path("/state/snakeslam")
    monkeypatch.setenv("XDG_STATE_HOME", "not/absolute")
    assert state_folder(None) == Path.home() / ".local" / "state" / "snakeslam"
    assert state_folder("/elsewhere") == Path("/elsewhere")


def test_a_stranger_cannot_sign_anybody_out(running: Running) -> None:
    with httpx.Client(base_url=running.url) as stranger:
        assert stranger.delete("/api/v1/session", params={"everywhere": True}).status_code == 401
