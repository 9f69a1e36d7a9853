"""Sensors that stop, in the real simulator behind a real server: told in words, the robot held, a start refused."""

import os
import signal
from collections.abc import Iterator
from contextlib import suppress
from http import HTTPStatus
from pathlib import Path

import httpx
import pytest

from tests.e2e.conftest import start_dashboard, stop_dashboard
from tests.server.running import START_S, Running, children, wait_for

CAMERA = "snakeslam:cam"
SILENT = "the camera is silent"
KILLS = 6
"""One more than the deaths in a row after which a node is given up."""


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    running, _ = start_dashboard(tmp_path_factory.mktemp("serve"), "sim.camera.rate_hz=10", "run.autostart=false")
    yield running
    assert stop_dashboard(running) == 0


@pytest.fixture
def client(server: Running) -> Iterator[httpx.Client]:
    with server.client() as client:
        yield client
        client.post("/api/v1/gait/stop")


def camera_pid(server: Running, other_than: int | None = None) -> int:
    """Wait for the camera's process."""

    def found() -> int | None:
        for pid in children(server.process.pid):
            with suppress(FileNotFoundError, ProcessLookupError):
                named = Path(f"/proc/{pid}/comm").read_text().strip() == CAMERA
                if named and pid != other_than:
                    return pid
        return None

    return wait_for(found, START_S)


def state(client: httpx.Client) -> dict:
    return client.get("/api/v1/state").json()


def start(client: httpx.Client) -> None:
    """Start the robot, as soon as all that it needs is there."""
    wait_for(lambda: client.post("/api/v1/gait/start").status_code == HTTPStatus.OK, START_S)
    assert state(client)["moving"]


def assert_reported_and_held(client: httpx.Client) -> None:
    wait_for(lambda: not state(client)["moving"])
    wait_for(lambda: SILENT in " ".join(state(client)["health"]["reasons"]))
    now = state(client)
    assert now["health"]["verdict"] in ("blind", "lost")
    assert now["health"]["tracks"] == 0
    assert SILENT in now["held_because"]
    refused = client.post("/api/v1/gait/start")
    assert refused.status_code == HTTPStatus.CONFLICT
    assert SILENT in refused.json()["detail"]


def test_a_camera_that_is_killed_repeatedly_is_reported_each_time_and_started_again(
    server: Running, client: httpx.Client
) -> None:
    start(client)
    pid = camera_pid(server)
    for kill in range(KILLS):
        os.kill(pid, signal.SIGKILL)
        if kill == 0:
            assert_reported_and_held(client)
        pid = camera_pid(server, other_than=pid)
    assert_reported_and_held(client)
    wait_for(lambda: state(client)["health"]["verdict"] in ("good", "degraded"), START_S)
    start(client)


def test_a_frozen_camera_is_reported_and_holds_the_robot_until_somebody_starts_it(
    server: Running, client: httpx.Client
) -> None:
    start(client)
    pid = camera_pid(server)
    os.kill(pid, signal.SIGSTOP)
    try:
        assert_reported_and_held(client)
    finally:
        os.kill(pid, signal.SIGCONT)
    wait_for(lambda: state(client)["health"]["verdict"] in ("good", "degraded"), START_S)
    assert not state(client)["moving"]
    start(client)
