"""A real server in a process of its own, spoken to over HTTP like any user would."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from http import HTTPStatus
from pathlib import Path
from typing import IO, Any

import httpx

CHECKOUT = Path(__file__).resolve().parents[2]
TOKEN = "a-token-for-the-tests"
VIEWER_TOKEN = "a-token-to-watch-with"
START_S = 60.0


class Patient(httpx.HTTPTransport):
    """Asks again when it is asked to slow down, as a script should: the tests ask faster than any script may."""

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        while (response := super().handle_request(request)).status_code == HTTPStatus.TOO_MANY_REQUESTS:
            response.close()
            time.sleep(0.1)
        return response


@dataclass
class Running:
    """A started server; ``out`` is what it printed so far."""

    process: subprocess.Popen[str]
    folder: Path
    url: str = ""
    out: list[str] = field(default_factory=list)

    def client(self, **options: Any) -> httpx.Client:
        headers = {"Authorization": f"Bearer {TOKEN}", **options.pop("headers", {})}
        return httpx.Client(base_url=self.url, headers=headers, timeout=20.0, transport=Patient(), **options)

    def anonymous(self, **options: Any) -> httpx.Client:
        return httpx.Client(base_url=self.url, timeout=20.0, **options)

    @property
    def websocket(self) -> str:
        return self.url.replace("http://", "ws://")

    def next_line(self) -> str:
        assert self.process.stdout is not None
        self.out.append(self.process.stdout.readline())
        return self.out[-1]

    def stop(self, number: int = signal.SIGTERM) -> int:
        if self.process.poll() is None:
            self.process.send_signal(number)
        code = self.process.wait(60)
        assert self.process.stdout is not None
        self.process.stdout.close()
        return code


def wait_for(condition: Callable[[], Any], timeout_s: float = 60.0) -> Any:
    """Return the first true value of ``condition``."""
    until = time.monotonic() + timeout_s
    while not (value := condition()):
        assert time.monotonic() < until, "it did not happen in time"
        time.sleep(0.05)
    return value


def children(pid: int) -> set[int]:
    """Processes below ``pid``, at any depth."""
    found: set[int] = set()
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        # A thread may end between being listed and being read.
        with suppress(FileNotFoundError, ProcessLookupError):
            for child in map(int, task.read_text().split()):
                found |= {child} | children(child)
    return found


def start(
    folder: Path,
    token: str | None = TOKEN,
    recordings: str = "",
    log: IO[str] | None = None,
    port: int = 0,
    bus: str | None = None,
    seed: int | None = None,
) -> Running:
    env = {key: value for key, value in os.environ.items() if key != "SNAKESLAM_TOKEN"}
    env["PYTHONPATH"] = os.pathsep.join([str(CHECKOUT), *filter(None, [env.get("PYTHONPATH")])])
    if token is not None:
        env["SNAKESLAM_TOKEN"] = token
        env["SNAKESLAM_VIEWER_TOKEN"] = VIEWER_TOKEN
    env["XDG_STATE_HOME"] = str(folder / "state")
    if bus is not None:
        env["SNAKESLAM_TEST_BUS"] = bus
    if seed is not None:
        env["SNAKESLAM_TEST_SEED"] = str(seed)
    folders = [recordings] if recordings else []
    command = [sys.executable, "-m", "tests.server.serve_still", str(port), "127.0.0.1", *folders]
    process = subprocess.Popen(command, cwd=folder, env=env, stdout=subprocess.PIPE, stderr=log, text=True)
    running = Running(process, folder)
    while not (found := re.search(r"Open (http://[^/]+)/login", running.next_line())):
        assert running.out[-1], "the server ended before it was ready"
    running.url = found.group(1)
    return running


def is_ready(client: httpx.Client) -> bool:
    """Whether a robot runs and would move: it runs before its slam does, and refuses until then."""
    state = client.get("/api/v1/state").json()
    return state["session"] == "running" and state["health"]["verdict"] not in ("initialising", "lost")
