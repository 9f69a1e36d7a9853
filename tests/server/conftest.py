"""Fixtures of the server's tests."""

from collections.abc import Iterator

import httpx
import pytest

from tests.server.running import START_S, Running, is_ready, start, wait_for


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A server with a stationary robot."""
    running = start(tmp_path_factory.mktemp("server"))
    with running.client() as client:
        wait_for(lambda: is_ready(client), START_S)
    yield running
    assert running.stop() == 0


@pytest.fixture
def client(server: Running) -> Iterator[httpx.Client]:
    """Signed in by token, nothing moving and nobody in control but this client."""
    with server.client() as client:
        lease = client.post("/api/v1/control/lease", json={"take_over": True}).raise_for_status().json()
        client.delete("/api/v1/control/lease", headers={"Control-Lease": lease["key"]}).raise_for_status()
        client.post("/api/v1/estop/reset")
        client.post("/api/v1/gait/stop")
        yield client
