"""The server as a process: how it starts, refuses to start, fails, and ends."""

import json
import os
import re
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

import httpx
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from server.auth import HostRule, is_loopback, token_from_environment
from server.main import bind
from snakeslam.cli import main as cli
from snakeslam.errors import InputError
from tests.server import still_robot
from tests.server.running import TOKEN, Running, children, is_ready, start, wait_for


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


@pytest.fixture
def begin(tmp_path: Path) -> Iterator[Callable[..., Running]]:
    """Start a server that is gone when the test is over, however it ends."""
    with ExitStack() as stack:

        def started(**options: Any) -> Running:
            running = start(tmp_path, **options)
            stack.callback(running.stop)
            return running

        yield started


def wait_running(running: Running) -> None:
    with running.client() as client:
        wait_for(lambda: is_ready(client), 60.0)


def test_it_ends_at_once_with_open_websockets_and_leaves_nobody(begin: Callable[..., Running]) -> None:
    running = begin()
    wait_running(running)
    below = children(running.process.pid)
    private = Path(next(iter(socket_paths(running.process.pid))))
    assert below
    assert private.stat().st_mode & 0o777 == 0o600
    assert private.parent.stat().st_mode & 0o777 == 0o700
    url = f"{running.websocket}/api/v1/telemetry"
    with connect(url, close_timeout=0.5, additional_headers={"Authorization": f"Bearer {TOKEN}"}) as stream:
        stream.recv(timeout=30)
        # A server that waited for its clients would not end at all.
        assert running.stop(signal.SIGINT) == 0
    wait_for(lambda: not any(map(alive, below)))
    assert not private.parent.exists()


def test_it_brings_the_robot_to_a_hold_before_it_ends(begin: Callable[..., Running]) -> None:
    running = begin()
    wait_running(running)
    ticks: list[dict] = []
    bearer = {"Authorization": f"Bearer {TOKEN}"}
    url = f"{running.websocket}/api/v1/telemetry"
    with (
        running.client() as client,
        connect(url, close_timeout=0.5, additional_headers=bearer) as stream,
        suppress(ConnectionClosed),
    ):
        client.put("/api/v1/gait", json={"name": "serpentine", "period_s": 2.5}).raise_for_status()
        while True:
            text = stream.recv(timeout=30)
            message = json.loads(text) if isinstance(text, str) else {}
            if message.get("type") != "tick":
                continue
            ticks.append(message)
            if len(ticks) <= 20 and not message["moving"]:
                # Not started yet, or held because a busy machine left slam no turn: both are tested elsewhere.
                ticks.clear()
                client.post("/api/v1/gait/start")
            if len(ticks) == 20:
                running.process.send_signal(signal.SIGTERM)
    assert running.stop() == 0
    assert not ticks[-1]["moving"]
    change = [max(abs(a - b) for a, b in zip(*pair, strict=True)) for pair in pairwise(t["q_target"] for t in ticks)]
    assert max(change[:18]) > 1e-3
    assert change[-1] < 1e-3


def test_its_log_is_one_json_object_a_line_with_no_secret_in_it(tmp_path: Path, begin: Callable[..., Running]) -> None:
    with (tmp_path / "log").open("w") as log:
        running = begin(log=log)
        wait_running(running)
        with running.client() as client:
            key = client.post("/api/v1/control/lease", json={"name": "Ann"}).json()["key"]
            client.put("/api/v1/gait", json={"name": "flying"})
        assert running.stop() == 0
    text = (tmp_path / "log").read_text()
    lines = [json.loads(line) for line in text.splitlines()]
    assert all({"event", "level", "timestamp"} <= set(line) for line in lines)
    refused = next(line for line in lines if line.get("status") == 422)
    assert (refused["method"], refused["path"], refused["who"].split()[0]) == ("PUT", "/api/v1/gait", "operator")
    assert any(line["event"] == "control" and line["holder"] == "Ann" for line in lines)
    for secret in (TOKEN, key, re.search(r"code=(\S+)", "".join(running.out))):
        assert str(secret) not in text


def socket_inodes(pid: int) -> set[str]:
    links: list[str] = []
    for fd in Path(f"/proc/{pid}/fd").iterdir():
        # A file may be closed between being listed and being read.
        with suppress(FileNotFoundError):
            links.append(str(fd.readlink()))
    return {link[len("socket:[") : -1] for link in links if link.startswith("socket:[")}


def socket_paths(pid: int) -> set[str]:
    """Unix sockets on which ``pid`` listens by a path."""
    inodes = socket_inodes(pid)
    rows = (line.split() for line in Path("/proc/net/unix").read_text().splitlines()[1:])
    return {row[7] for row in rows if len(row) > 7 and row[6] in inodes and row[7].endswith("viewer.sock")}


def listening_ports(pid: int) -> set[tuple[str, int]]:
    inodes = socket_inodes(pid)
    found: set[tuple[str, int]] = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]:
            row = line.split()
            if row[3] == "0A" and row[9] in inodes:
                address, port = row[1].split(":")
                found.add((address, int(port, 16)))
    return found


def test_a_killed_server_ends_its_session(begin: Callable[..., Running]) -> None:
    running = begin()
    wait_running(running)
    below = children(running.process.pid)
    assert listening_ports(running.process.pid) == {("0100007F", int(running.url.rsplit(":", 1)[1]))}
    running.stop(signal.SIGKILL)
    wait_for(lambda: not any(map(alive, below)))


def restart(client: httpx.Client, behaviour: int, phase: str) -> dict:
    """Start a session of a robot that behaves so; return the state in which it ends up."""
    assert client.post("/api/v1/sim/start", json={"overrides": {"run.seed": behaviour}}).status_code == 200
    return wait_for(lambda: (s := client.get("/api/v1/state").json())["session"] == phase and s, 60.0)


def test_a_session_that_fails_says_why_and_can_be_started_again(client: httpx.Client) -> None:
    state = restart(client, still_robot.BREAKS, "failed")
    assert state["message"] == "RuntimeError: the fake robot broke"
    assert state["moving"] is False
    assert client.post("/api/v1/gait/start").status_code == 409
    assert client.post("/api/v1/estop").json()["estop"]["latched"] is True
    assert client.post("/api/v1/estop/reset").json()["estop"]["latched"] is False
    assert restart(client, 1, "running")["message"] is None


def test_a_robot_node_that_fails_is_started_again_and_held(client: httpx.Client) -> None:
    restart(client, still_robot.BREAKS_WHEN_MOVED, "running")
    wait_for(lambda: client.post("/api/v1/gait/start").status_code == 200)
    state = wait_for(lambda: (s := client.get("/api/v1/state").json())["session"] == "starting" and s)
    assert "the fake robot broke" in state["message"]
    state = wait_for(lambda: (s := client.get("/api/v1/state").json())["session"] == "running" and s, 60.0)
    assert (state["moving"], state["message"]) == (False, None)


def test_nodes_that_are_killed_are_started_again(server: Running, client: httpx.Client) -> None:
    restart(client, 1, "running")
    for pid in children(server.process.pid):
        if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes():
            os.kill(pid, signal.SIGKILL)
    state = wait_for(lambda: (s := client.get("/api/v1/state").json())["session"] == "starting" and s)
    assert "signal 9" in state["message"]
    state = wait_for(lambda: (s := client.get("/api/v1/state").json())["session"] == "running" and s, 60.0)
    assert (state["moving"], state["message"]) == (False, None)


def test_a_session_that_ends_keeps_its_map(client: httpx.Client) -> None:
    restart(client, still_robot.ENDS_WHEN_MOVED, "running")
    wait_for(lambda: client.get("/api/v1/map").json()["points"] > 0)
    wait_for(lambda: client.get("/api/v1/trajectory").json()["estimate"])
    client.post("/api/v1/gait/start").raise_for_status()
    state = wait_for(lambda: (s := client.get("/api/v1/state").json())["session"] == "ended" and s)
    assert state["message"] is None
    assert client.get("/api/v1/map").json()["points"] > 0
    assert client.get("/api/v1/trajectory").json()["estimate"]


def test_without_a_token_of_its_own_it_writes_one_for_this_user_only(begin: Callable[..., Running]) -> None:
    running = begin(token=None)
    path = re.search(r"Token for scripts: (\S+)", "".join(running.out))
    assert path is not None
    file = Path(path.group(1))
    assert file.stat().st_mode & 0o777 == 0o600
    token = file.read_text().strip()
    with running.anonymous(headers={"Authorization": f"Bearer {token}"}) as client:
        assert client.get("/api/v1/state").status_code == 200
    assert running.stop() == 0
    assert not file.exists()


def test_a_busy_port_is_one_clear_line(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as busy:
        port = busy.getsockname()[1]
        assert cli(["serve", "--port", str(port)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err == f"snakeslam: --port {port}: is in use (allowed: another port, or 0 for a free one)\n"


def test_other_machines_only_with_a_token(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SNAKESLAM_TOKEN", raising=False)
    assert cli(["serve", "--host", "0.0.0.0", "--port", "0"]) == 2
    words = "--host 0.0.0.0: needs a token in SNAKESLAM_TOKEN (allowed: 127.0.0.1 without one)"
    assert capsys.readouterr().err == f"snakeslam: {words}\n"


def test_a_short_token_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SNAKESLAM_TOKEN", "short")
    with pytest.raises(InputError, match="16 characters"):
        token_from_environment("127.0.0.1")


def test_an_address_of_somebody_else_is_refused() -> None:
    with pytest.raises(InputError, match=r"203\.0\.113\.1"):
        bind("203.0.113.1", 0)


@pytest.mark.parametrize(
    ("host", "loopback"),
    [("127.0.0.1", True), ("localhost", True), ("::1", True), ("127.8.8.8", True), ("0.0.0.0", False), ("::", False),
     ("192.168.1.4", False), ("robot.local", False)],
)  # fmt: skip
def test_what_counts_as_this_machine(host: str, loopback: bool) -> None:
    assert is_loopback(host) is loopback


def test_a_server_for_all_answers_to_addresses_but_not_to_foreign_names() -> None:
    rule = HostRule("0.0.0.0")
    assert rule.allows("192.168.1.4:8000")
    assert rule.allows("[fe80::1]:8000")
    assert not rule.allows("evil.example:8000")
