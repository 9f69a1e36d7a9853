"""What strangers, and those who only watch, cannot take from the operator."""

import asyncio
import json
import re
import socket
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from server.auth import HostRule, checked_proxies
from server.edge import MOST_CONNECTIONS, Connections, ConnectionState
from server.sockets import LIMITS, TOO_MANY
from server.viewer_proxy import SUBPROTOCOL
from snakeslam.errors import InputError
from snakeslam.runtime.process.logs import BURST, Repeats
from tests.server.running import START_S, TOKEN, VIEWER_TOKEN, Running, is_ready, start, wait_for

WRONG, THREADS = 12, 6
SECURITY = ("content-security-policy", "x-content-type-options", "referrer-policy", "cross-origin-resource-policy")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("log") / "log"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory, log: Path) -> Iterator[Running]:
    with log.open("w") as file:
        running = start(tmp_path_factory.mktemp("server"), log=file)
        with running.client() as client:
            wait_for(lambda: is_ready(client), START_S)
        yield running
        assert running.stop() == 0


def address(server: Running) -> tuple[str, int]:
    host, port = server.url.removeprefix("http://").split(":")
    return host, int(port)


def rss_mb(server: Running) -> float:
    return int(Path(f"/proc/{server.process.pid}/statm").read_text().split()[1]) * 4096 / 1e6


def test_connections_that_ask_for_nothing_keep_nobody_out(server: Running, log: Path) -> None:
    """Beyond the descriptors they filled the log with 228 MB in a minute, and requests timed out."""
    with ExitStack() as stack, server.client() as client:
        assert client.get("/api/v1/state").status_code == 200
        for k in range(2 * MOST_CONNECTIONS):
            stranger = stack.enter_context(socket.create_connection(address(server), timeout=20))
            if k % 2:
                stranger.sendall(b"GET / HTTP/1.1\r\nHost: half-sent")
        descriptors = len(list(Path(f"/proc/{server.process.pid}/fd").iterdir()))
        assert descriptors < MOST_CONNECTIONS + 200
        with server.client() as newcomer:
            assert newcomer.get("/api/v1/state").status_code == 200
        assert client.post("/api/v1/estop").status_code == 200
    assert log.stat().st_size < 1e6


def test_a_half_sent_head_is_dropped_in_time(server: Running) -> None:
    with socket.create_connection(address(server), timeout=60) as stranger:
        stranger.sendall(b"GET /api/v1/state HTTP/1.1\r\nHost: 127.0.0.1\r\n")
        assert stranger.recv(1024) == b""


def test_a_half_sent_body_is_dropped_in_time(server: Running) -> None:
    host, port = address(server)
    with socket.create_connection((host, port), timeout=60) as slow:
        head = f"POST /api/v1/estop HTTP/1.1\r\nHost: {host}:{port}\r\nAuthorization: Bearer {TOKEN}\r\n"
        slow.sendall((head + 'Content-Length: 100\r\n\r\n{"reason": "').encode())
        assert slow.recv(4096).startswith(b"HTTP/1.1 408")


def test_invented_methods_and_paths_are_no_labels(server: Running) -> None:
    with server.client() as client:
        for k in range(50):
            client.request(f"INVENTED{k}", f"/nothing/{k}")
            client.get(f"/api/v1/nothing{k}")
        text = client.get("/metrics").text
    assert "INVENTED" not in text
    assert "nothing" not in text
    assert 'method="other"' in text


def test_wrong_tokens_lock_nobody_out(server: Running) -> None:
    """Six threads of wrong ones kept the right one, and the one-time code, out for as long as they went on."""

    def guess() -> set[int]:
        with server.anonymous() as stranger:
            return {stranger.post("/api/v1/session", json={"token": f"wrong {k}"}).status_code for k in range(WRONG)}

    with ThreadPoolExecutor(THREADS) as crowd:
        guessing = [crowd.submit(guess) for _ in range(THREADS)]
        for _ in range(WRONG):
            with server.anonymous() as browser:
                assert browser.post("/api/v1/session", json={"token": TOKEN}).status_code == 204
        code = re.search(r"http://\S+/login\S+", "".join(server.out))
        assert code is not None
        assert "set-cookie" in httpx.get(code.group()).headers
        assert set().union(*(guessed.result() for guessed in guessing)) == {401, 429}
    server.next_line()


def test_every_refusal_has_the_security_headers(server: Running) -> None:
    with server.anonymous() as stranger:
        refusals = [stranger.get("/api/v1/state"), stranger.get("/", headers={"Host": "evil.example"})]
    assert [refusal.status_code for refusal in refusals] == [401, 421]
    for refusal in refusals:
        assert set(SECURITY) <= set(refusal.headers)


def opened(server: Running, stack: ExitStack, path: str, token: str) -> ClientConnection:
    protocols = [Subprotocol(SUBPROTOCOL)] if path == "/viewer" else None
    bearer = {"Authorization": f"Bearer {token}"}
    url = server.websocket + path
    return stack.enter_context(
        connect(url, close_timeout=0.5, additional_headers=bearer, subprotocols=protocols, max_size=None)
    )


def is_open(stream: ClientConnection) -> bool:
    try:
        stream.recv(timeout=30)
    except ConnectionClosed:
        assert stream.close_code == TOO_MANY
        return False
    return True


@pytest.mark.parametrize(("kind", "path"), [("telemetry", "/api/v1/telemetry"), ("viewer", "/viewer")])
def test_one_watch_only_token_has_so_many_sockets_and_an_operator_always_gets_in(
    server: Running, kind: str, path: str
) -> None:
    limit = LIMITS[kind]  # type: ignore[index]
    with ExitStack() as stack:
        watching = [opened(server, stack, path, VIEWER_TOKEN) for _ in range(limit.each + 3)]
        assert [is_open(stream) for stream in watching].count(True) == limit.each
        operating = [opened(server, stack, path, TOKEN) for _ in range(limit.each)]
        assert all(map(is_open, operating))


def test_a_crowd_of_viewer_sockets_leaves_no_memory_behind(server: Running) -> None:
    """200 of them had taken 174 MB, which did not come back."""

    def crowd() -> None:
        with ExitStack() as stack:
            for _ in range(100):
                try:
                    opened(server, stack, "/viewer", VIEWER_TOKEN)
                except (InvalidHandshake, OSError):
                    return

    crowd()
    before_mb = rss_mb(server)
    crowd()
    assert rss_mb(server) - before_mb < 40.0


def test_the_oldest_stranger_goes_first_and_an_operator_last() -> None:
    gone: list[str] = []

    class Connection:
        def __init__(self, name: str) -> None:
            self.name, self.transport = name, self

        def abort(self) -> None:
            gone.append(self.name)

    connections = Connections(3)
    for waits_s, name in enumerate(("operator", "viewer", "stranger", "a", "b", "c")):
        state = ConnectionState(Connection(name), float(waits_s))  # type: ignore[arg-type]
        connections.add(state)
        if name in ("operator", "viewer"):
            connections.signed_in(state, name, name)  # type: ignore[arg-type]
    assert gone == ["stranger", "a", "b"]
    connections.close_idle(16.0)
    assert gone[3:] == ["c"]
    connections.close_idle(60.0)
    assert gone[4:] == ["operator", "viewer"]


def test_the_same_line_is_logged_so_often_and_says_how_many_were_left_out() -> None:
    now_s = 0.0
    repeats = Repeats(lambda: now_s)
    written = [repeats.count(("same",)) for _ in range(1000)]
    assert written.count(0) == BURST
    assert repeats.count(("other",)) == 0
    now_s = 1.0
    assert repeats.count(("same",)) == 1000 - BURST


@pytest.mark.parametrize(
    ("host", "allowed"),
    [("{name}", True), ("{name}.local:8474", True), ("robot.example.com", True), ("a.lab.example", True),
     ("ROBOT.example.com.:80", True), ("evil.robot.example.com", False), ("lab.example", False), ("example.com", False),
     ("evillab.example", False), ("{name}.local.evil.example", False)],
)  # fmt: skip
def test_which_names_are_ours(host: str, allowed: bool) -> None:
    rule = HostRule("0.0.0.0", ["Robot.example.com", "*.lab.example"])
    name = socket.gethostname().partition(".")[0]
    assert rule.allows(host.format(name=name)) is allowed


@pytest.mark.parametrize("name", ["", "*", "http://robot", "a b", "robot:8000", "*.*.example", "-" * 70])
def test_what_is_no_host_name_is_one_clear_line(name: str) -> None:
    with pytest.raises(InputError, match=re.escape("server.hosts")):
        HostRule("0.0.0.0", [name])


def test_what_is_no_proxy_is_one_clear_line() -> None:
    assert checked_proxies(["127.0.0.1", "172.16.0.0/12"]) == ["127.0.0.1", "172.16.0.0/12"]
    with pytest.raises(InputError, match=re.escape("server.trusted_proxies")):
        checked_proxies(["caddy"])


async def _asked(app: object, headers: list[tuple[bytes, bytes]], client: str) -> dict[str, str]:
    sent: list[dict] = []
    scope = {"type": "http", "method": "POST", "path": "/api/v1/session", "raw_path": b"", "query_string": b"",
             "headers": [(b"host", b"localhost"), (b"content-type", b"application/json"), *headers],
             "client": (client, 1), "server": ("localhost", 80), "scheme": "http", "http_version": "1.1"}  # fmt: skip

    async def receive() -> dict:
        return {"type": "http.request", "body": json.dumps({"token": TOKEN}).encode(), "more_body": False}

    async def send(message: dict) -> None:
        sent.append(message)

    await app(scope, receive, send)  # type: ignore[operator]
    return {name.decode(): value.decode() for name, value in sent[0]["headers"]}


@pytest.mark.parametrize(("proxy", "secure"), [("127.0.0.1", True), ("127.0.0.9", False)])
def test_the_cookie_is_for_tls_only_where_a_trusted_front_end_says_so(proxy: str, secure: bool) -> None:
    from starlette.requests import HTTPConnection
    from starlette.responses import Response
    from uvicorn.middleware.proxy_headers import ProxyHeadersMiddleware

    from server.auth import set_cookie

    async def app(scope: dict, receive: object, send: object) -> None:
        response = Response()
        set_cookie(response, "x", HTTPConnection(scope), 60.0)
        await response(scope, receive, send)  # type: ignore[arg-type]

    front = ProxyHeadersMiddleware(app, trusted_hosts=checked_proxies(["127.0.0.1"]))  # type: ignore[arg-type]
    headers = asyncio.run(_asked(front, [(b"x-forwarded-proto", b"https"), (b"x-forwarded-for", b"10.0.0.9")], proxy))
    assert ("Secure" in headers["set-cookie"]) is secure
