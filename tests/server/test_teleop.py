"""Driving over the websocket, with a real session behind it."""

import json
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import httpx
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from tests.server.running import TOKEN, VIEWER_TOKEN, Running, wait_for
from tests.server.test_access import status_of

LEASE = "/api/v1/control/lease"


class Driver:
    """The deadman input of a page, as a script."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket, self.seq = socket, 0

    def send(self, **message: Any) -> None:
        self.socket.send(json.dumps({"t_ms": time.monotonic() * 1e3, **message}))

    def receive(self) -> dict[str, Any]:
        return json.loads(self.socket.recv(timeout=30))

    def ping(self) -> None:
        self.send(type="ping")
        assert self.receive()["type"] == "pong"

    def drive(self, drive: float, turn: float = 0.0, **more: Any) -> dict[str, Any]:
        self.seq += 1
        self.send(**{"type": "drive", "seq": self.seq, "drive": drive, "turn": turn, **more})
        return self.receive()

    def closed(self) -> int | None:
        """Read until the server closes; return its code."""
        with suppress(ConnectionClosed):
            while True:
                self.socket.recv(timeout=30)
        return self.socket.close_code


@pytest.fixture
def lease(client: httpx.Client) -> str:
    key = client.post(LEASE, json={"name": "Ann", "seconds": 60}).raise_for_status().json()["key"]
    client.headers["Control-Lease"] = key
    return key


@contextmanager
def teleop(server: Running, key: str) -> Iterator[Driver]:
    url, bearer = f"{server.websocket}/api/v1/teleop", {"Authorization": f"Bearer {TOKEN}"}
    with connect(url, close_timeout=0.5, additional_headers=bearer) as socket:
        driver = Driver(socket)
        socket.send(json.dumps({"type": "hello", "lease": key}))
        yield driver


def test_held_input_drives_and_one_zero_stops(server: Running, client: httpx.Client, lease: str) -> None:
    with teleop(server, lease) as driver:
        assert driver.receive() == {"type": "ready"}
        driver.ping()
        done = driver.drive(-1.0, 0.5)
        assert (done["type"], done["seq"]) == ("done", 1)
        gait = client.get("/api/v1/state").json()["gait"]
        assert (gait["drive"], gait["turn"]) == (-1.0, 0.5)
        assert client.get("/api/v1/state").json()["moving"] is True
        assert driver.drive(0.0)["type"] == "done"
        state = client.get("/api/v1/state").json()
        assert (state["moving"], state["gait"]["drive"], state["gait"]["turn"]) == (False, 0.0, 0.0)


def test_the_robot_stops_when_the_input_does(server: Running, client: httpx.Client, lease: str) -> None:
    """The socket stays open and pings go on: only the input has ended."""
    with teleop(server, lease) as driver:
        driver.receive()
        driver.ping()
        wait_for(lambda: driver.drive(1.0)["type"] == "done" and client.get("/api/v1/state").json()["moving"])
        silent = time.monotonic()
        wait_for(lambda: driver.ping() is None and not client.get("/api/v1/state").json()["moving"])
        # Not a budget: a robot that only stopped with the lease would take a minute.
        assert time.monotonic() - silent < 20.0


def test_the_robot_stops_when_the_socket_closes(server: Running, client: httpx.Client, lease: str) -> None:
    with teleop(server, lease) as driver:
        driver.receive()
        driver.ping()
        driver.drive(1.0)
        driver.socket.socket.shutdown(socket.SHUT_RDWR)  # As a page that is killed: no goodbye.
    wait_for(lambda: not client.get("/api/v1/state").json()["moving"])
    assert client.get("/api/v1/state").json()["control"]["holder"] == "Ann"


def test_who_loses_control_loses_the_robot(server: Running, client: httpx.Client, lease: str) -> None:
    with teleop(server, lease) as driver, server.client() as bob:
        driver.receive()
        driver.ping()
        driver.drive(1.0)
        taken = bob.post(LEASE, json={"name": "Bob", "take_over": True}).json()
        assert driver.closed() == 4001
        wait_for(lambda: not bob.get("/api/v1/state").json()["moving"])
        bob.delete(LEASE, headers={"Control-Lease": taken["key"]}).raise_for_status()


def test_input_that_is_old_or_out_of_order_is_dropped(server: Running, client: httpx.Client, lease: str) -> None:
    with teleop(server, lease) as driver:
        driver.receive()
        driver.ping()
        assert driver.drive(0.0)["seq"] == 1
        now_ms = time.monotonic() * 1e3
        driver.send(type="drive", seq=1, drive=1.0)
        driver.send(type="drive", seq=7, drive=1.0, t_ms=now_ms - 1000)
        driver.send(type="drive", seq=8, drive=1.0, t_ms=now_ms + 5000)
        driver.ping()
        assert client.get("/api/v1/state").json()["moving"] is False
        metrics = client.get("/metrics").text
        for outcome in ("out of order", "stale", "from the future"):
            assert f'snakeslam_drive_inputs_total{{outcome="{outcome}"}}' in metrics


def test_a_latched_robot_is_not_driven(server: Running, client: httpx.Client, lease: str) -> None:
    client.post("/api/v1/estop").raise_for_status()
    with teleop(server, lease) as driver:
        driver.receive()
        driver.ping()
        refused = driver.drive(1.0)
        assert refused["type"] == "refused"
        assert "E-stop" in refused["detail"]
    assert client.get("/api/v1/state").json()["moving"] is False
    client.post("/api/v1/estop/reset").raise_for_status()


def test_an_estop_while_driving_holds_though_the_input_goes_on(
    server: Running, client: httpx.Client, lease: str
) -> None:
    with teleop(server, lease) as driver:
        driver.receive()
        driver.ping()
        driver.drive(1.0)
        client.post("/api/v1/estop").raise_for_status()
        assert driver.drive(1.0)["type"] == "refused"
        client.post("/api/v1/estop/reset").raise_for_status()
        assert client.get("/api/v1/state").json()["moving"] is False


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", '{"type": "drive"}', '{"type": "drive", "seq": 1, "t_ms": 0, "drive": 2}',
     '{"type": "drive", "seq": 1, "t_ms": 0, "drive": NaN}', '{"type": "ping", "t_ms": 1e999}',
     '{"type": "fly", "t_ms": 0}', '{"type": "ping", "t_ms": 0, "x": "' + "x" * 600 + '"}'],
)  # fmt: skip
def test_nonsense_closes_the_socket_and_moves_nothing(
    server: Running, client: httpx.Client, lease: str, text: str
) -> None:
    with teleop(server, lease) as driver:
        driver.receive()
        driver.socket.send(text)
        assert driver.closed() == 4003
    assert client.get("/api/v1/state").json()["moving"] is False


def test_a_flood_is_cut_off(server: Running, client: httpx.Client, lease: str) -> None:
    with teleop(server, lease) as driver:
        driver.receive()
        with suppress(ConnectionClosed):
            for seq in range(5000):
                driver.send(type="drive", seq=seq, drive=1.0)
        assert driver.closed() == 4002
    wait_for(lambda: not client.get("/api/v1/state").json()["moving"])


@pytest.mark.parametrize("hello", ['{"type": "hello", "lease": "wrong"}', '{"type": "hello"}', "hello", '"hello"'])
def test_without_the_lease_there_is_no_driving(server: Running, client: httpx.Client, lease: str, hello: str) -> None:
    url, bearer = f"{server.websocket}/api/v1/teleop", {"Authorization": f"Bearer {TOKEN}"}
    with connect(url, close_timeout=0.5, additional_headers=bearer) as socket:
        socket.send(hello)
        assert Driver(socket).closed() in (4001, 4003)


def test_strangers_viewers_and_other_origins_get_no_socket(server: Running) -> None:
    url = f"{server.websocket}/api/v1/teleop"
    assert status_of(url) == 401
    assert status_of(url, additional_headers={"Authorization": f"Bearer {VIEWER_TOKEN}"}) == 403
    bearer = {"Authorization": f"Bearer {TOKEN}"}
    assert status_of(url, additional_headers=bearer, origin="http://evil.example") == 403
