"""The emergency stop while others ask for everything: ``python -m bench estop [SECONDS]``, so long for each flood.

The served simulator drives, with a large map; the operator presses over a connection of their own.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx
import numpy as np
from rich.console import Console
from rich.table import Table

from bench.flooding import KINDS
from bench.live import spread
from snakeslam.messages import MapChunk
from snakeslam.runtime.bus.bus import Bus
from snakeslam.runtime.bus.link import Link, unix_endpoint
from snakeslam.runtime.bus.topics import CHUNKS, ROBOT_STATE, RobotState
from snakeslam.runtime.process.priority import set_control_priority
from tests.e2e.conftest import start_dashboard, stop_dashboard, wait_until_running
from tests.server.running import CHECKOUT, TOKEN, VIEWER_TOKEN, Running, wait_for

SECONDS, SETTLE_S, BETWEEN_S = 8.0, 1.0, 0.15
CLIENTS, PRESSERS = 8, 20
MAP_CHUNKS, CHUNK_POINTS = 200, 1000
"""A map as large as that of an office after 20 minutes."""
FIRST_KEY = 1_000_000
BUDGET_MS = 20.0
Row = tuple[str, str, str]


class Latch:
    """What the robot node itself says of its E-stop."""

    def __init__(self, folder: Path) -> None:
        (socket,) = folder.glob("**/bus.sock")
        self.bus = Bus(Link(unix_endpoint(socket.parent)))
        self._state: RobotState | None = None
        self._latched_ns: dict[str, int] = {}
        self.bus.subscribe(ROBOT_STATE, self._on_state)

    @property
    def latched(self) -> bool:
        """Whether it is latched."""
        return self._state is not None and self._state.estop_reason is not None

    def since_ns(self, reason: str) -> int | None:
        """When the robot node first said that it is latched for ``reason``, on this machine's monotonic clock."""
        return self._latched_ns.get(reason)

    def publish_map(self) -> None:
        """Add a large map to that of slam."""
        rng = np.random.default_rng(1)
        for k in range(MAP_CHUNKS):
            points = rng.uniform(-3.0, 3.0, (CHUNK_POINTS, 3)).astype(np.float32)
            rgb = rng.integers(0, 255, (CHUNK_POINTS, 3)).astype(np.uint8)
            self.bus.publish(CHUNKS, MapChunk(FIRST_KEY + k, 1, np.eye(4), points, rgb))

    def _on_state(self, state: RobotState) -> None:
        self._state = state
        if state.estop_reason is not None:
            self._latched_ns.setdefault(state.estop_reason, state.stamp_ns)


@dataclass
class Operator:
    """Presses, and starts again, over one connection that stays open."""

    client: httpx.Client
    latch: Latch
    presses: int = 0
    key: str = ""

    def start(self) -> None:
        """Take control, clear the E-stop and set the robot going; under a flood of presses it stays latched."""
        lease = self.client.post("/api/v1/control/lease", json={"name": "bench", "seconds": 60, "take_over": True})
        self.key = str(lease.raise_for_status().json()["key"])

    def release(self) -> None:
        """Clear the latch and start."""
        mine = {"Control-Lease": self.key}
        self.client.post("/api/v1/estop/reset", headers=mine)
        self.client.post("/api/v1/gait/start", headers=mine)

    def press(self) -> tuple[float, float]:
        """Press; return the ms until the robot node was latched (NaN: it already was) and until the answer was here."""
        self.presses += 1
        reason, before = f"press {self.presses}", self.latch.latched
        pressed_ns = time.monotonic_ns()
        answer = self.client.post("/api/v1/estop", json={"reason": reason})
        answered_ms = (time.monotonic_ns() - pressed_ns) * 1e-6
        assert answer.status_code == 200, answer.text
        assert answer.json()["estop"]["latched"]
        since_ns = self.latch.since_ns(reason)
        if before or since_ns is None:
            return float("nan"), answered_ms
        return (since_ns - pressed_ns) * 1e-6, answered_ms


@contextmanager
def flood(server: Running, kind: str) -> Generator[None]:
    """Have a crowd with the watch-only token ask for ``kind`` meanwhile; "none" is nobody."""
    if kind == "none":
        yield
        return
    clients = str(PRESSERS if kind in ("estop", "sockets") else CLIENTS)
    command = [sys.executable, "-m", "bench.flooding", server.url, kind, VIEWER_TOKEN, clients]
    crowd = subprocess.Popen(command, cwd=CHECKOUT)
    try:
        time.sleep(SETTLE_S)
        yield
    finally:
        crowd.kill()
        crowd.wait()


def presses(operator: Operator, seconds: float) -> Iterator[tuple[float, float]]:
    """Press and start again for so long."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        operator.release()
        time.sleep(BETWEEN_S)
        yield operator.press()


def row(kind: str, measured: list[tuple[float, float]]) -> Row:
    latched_ms, answered_ms = np.array(measured).T
    known = latched_ms[np.isfinite(latched_ms)]
    latency_text = spread(known, 95) if len(known) else "was latched"
    return (f"{kind}, n = {len(measured)}", latency_text, f"{spread(answered_ms, 95)}, {answered_ms.max():.1f}")


def rows(server: Running, latch: Latch, seconds: float) -> Iterator[Row]:
    """Press under each flood in turn; of each the times until latched and until answered."""
    with server.client() as client:
        operator = Operator(client, latch)
        operator.start()
        for kind in ("none", *KINDS):
            with flood(server, kind):
                yield row(kind, list(presses(operator, seconds)))


def main(seconds: float = SECONDS) -> None:
    columns = ("flood", "until latched: p50, p95, ms", "until answered: p50, p95, worst, ms")
    table = Table(*columns, title=f"E-stop, budget of p95 {BUDGET_MS:g} ms")
    with tempfile.TemporaryDirectory() as name:
        os.environ.update({"TMPDIR": name, "SNAKESLAM_VIEWER_TOKEN": VIEWER_TOKEN})
        server, _ = start_dashboard(Path(name))
        try:
            wait_until_running(server)
            # The operator sits at another machine: what is measured is not how this one shares its cores with them.
            set_control_priority()
            latch = Latch(Path(name))
            latch.publish_map()
            with server.client() as client:
                wait_for(lambda: client.get("/api/v1/map").json()["points"] >= MAP_CHUNKS * CHUNK_POINTS)
            for measured in rows(server, latch, seconds):
                table.add_row(*measured)
                Console(emoji=False).print(" | ".join(measured))
            latch.bus.close()
        finally:
            stop_dashboard(server)
    Console(emoji=False).print(table)


__all__ = ["TOKEN", "Latch", "Operator", "flood", "main", "presses"]
