"""docker-compose.yml: its health checks, run by hand beside the processes they are for, and what it must not do."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.conftest import CHECKOUT
from tests.server.running import START_S, TOKEN, Running, is_ready, start, wait_for

COMPOSE = yaml.safe_load((CHECKOUT / "docker-compose.yml").read_text())
SERVICES: dict[str, Any] = COMPOSE["services"]
BUS = "unixsock-stream//run/snakeslam/bus.sock"
NODES = """
import sys
from snakeslam.config import Config
from snakeslam.robot.model import RobotSettings
from snakeslam.runtime.bus.link import Link
from snakeslam.runtime.process.node import Life, end_at_signals
from snakeslam.runtime.nodes.robot import run_robot
from snakeslam.runtime.nodes.slam import run_slam
from snakeslam.runtime.assembly.spec import SessionSpec
from tests.server.still_robot import still_robot
if __name__ == "__main__":
    name, endpoint = sys.argv[1:]
    config, life = Config(robot=RobotSettings(model="orthogonal24")), Life()
    end_at_signals(life)
    if name == "robot":
        run_robot(SessionSpec(config, build=still_robot), Link(endpoint, listens=True), life)
    else:
        run_slam(config, Link(endpoint), life)
"""


def is_healthy(service: str, bus: str, url: str = "") -> bool:
    """Run a service's own health check, with this test's endpoint and address in place of the container's."""
    _, *command = SERVICES[service]["healthcheck"]["test"]
    command = [part.replace(BUS, bus).replace("http://127.0.0.1:8000", url) for part in command]
    if command[0] == "snakeslam":
        command = [sys.executable, "-m", *command]
    return subprocess.run(command, cwd=CHECKOUT, capture_output=True, check=False).returncode == 0


@pytest.fixture
def nodes(tmp_path: Path) -> Iterator[dict[str, "subprocess.Popen[bytes]"]]:
    bus = f"unixsock-stream/{tmp_path}/bus.sock"
    env = {**os.environ, "PYTHONPATH": str(CHECKOUT), "OPENBLAS_NUM_THREADS": "1"}
    running = {
        name: subprocess.Popen([sys.executable, "-c", NODES, name, bus], cwd=tmp_path, env=env)
        for name in ("robot", "slam")
    }
    yield running
    for process in running.values():
        process.kill()
        process.wait()


def test_a_killed_process_makes_its_health_check_red(
    tmp_path: Path, nodes: dict[str, "subprocess.Popen[bytes]"]
) -> None:
    """The robot's only looked whether the socket's file was there, which outlives the node."""
    bus = f"unixsock-stream/{tmp_path}/bus.sock"
    server: Running = start(tmp_path, bus=bus)
    try:
        with server.client() as client:
            wait_for(lambda: is_ready(client), START_S)
        assert all(is_healthy(service, bus, server.url) for service in ("robot", "slam", "server"))
        nodes["slam"].kill()
        nodes["slam"].wait()
        assert [is_healthy("slam", bus), is_healthy("robot", bus)] == [False, True]
        nodes["robot"].kill()
        nodes["robot"].wait()
        assert not is_healthy("robot", bus)
        wait_for(lambda: not is_healthy("server", bus, server.url))
        server.process.send_signal(signal.SIGKILL)
        server.process.wait()
        assert not is_healthy("server", bus, server.url)
    finally:
        server.stop(signal.SIGKILL)


@pytest.mark.parametrize("service", sorted(SERVICES))
def test_nothing_runs_as_root_or_shows_the_token_in_its_arguments(service: str) -> None:
    described = SERVICES[service]
    assert not str(described["user"]).startswith(("0", "root"))
    assert "TOKEN" not in str(described.get("command")) + str(described.get("healthcheck"))


def test_the_image_runs_as_a_user_of_its_own() -> None:
    lines = (CHECKOUT / "Dockerfile").read_text().splitlines()
    assert [line for line in lines if line.startswith("USER")] == ["USER snakeslam"]
    assert TOKEN not in "".join(lines)
