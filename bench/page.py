"""The whole stack as its user has it: the served simulator with a page open in Chromium, then twenty viewers more.

``python -m bench page [SECONDS]``; on the machine that also runs the browser, which draws in software there.
"""

import asyncio
import contextlib
import json
import os
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from websockets.asyncio.client import connect

CHECKOUT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(CHECKOUT))

from bench.live import processes, spread  # noqa: E402
from snakeslam.runtime.bus import Bus  # noqa: E402
from snakeslam.runtime.link import Link, unix_endpoint  # noqa: E402
from snakeslam.runtime.topics import ROBOT_STATE, SENSORS, RobotState  # noqa: E402
from snakeslam.runtime.wire import Sensors  # noqa: E402
from tests.e2e.chromium import chromium_path, open_chromium  # noqa: E402
from tests.e2e.conftest import start_dashboard, stop_dashboard, wait_until_running  # noqa: E402
from tests.server.running import TOKEN, Running  # noqa: E402

SECONDS = 60.0
SETTLE_S = 10.0
CHUNK_S, LEASE_S = 10.0, 60
VIEWERS, WATCHED_S = 20, 20.0
COMMANDS = 60
SIZE = {"width": 1440, "height": 900}
Row = tuple[str, str, str]

# The page's worker says when it has drawn a picture; this listens in.
OVERHEAR = """window.drawn = [];
window.Worker = class extends Worker {
  constructor(...given) {
    super(...given);
    this.addEventListener("message", ({data}) => {
      if (data?.kind === "picture") window.drawn.push([data.picture.t_s, data.picture.shown_ms]);
    });
  }
};"""
TAKE = "() => window.drawn.splice(0)"
DRIVE = """async ([key, count]) => {
  const socket = new WebSocket(`ws://${location.host}/api/v1/teleop`);
  const times = [];
  await new Promise((done, fail) => {
    let seq = 0, sent = 0;
    const next = () => {
      if (times.length === count) { socket.close(); done(); return; }
      sent = performance.now();
      socket.send(JSON.stringify({type: "drive", seq: seq++, t_ms: sent, drive: 0.5 + 0.4 * (seq % 2), turn: 0}));
    };
    socket.onopen = () => {
      socket.send(JSON.stringify({type: "hello", lease: key}));
      socket.send(JSON.stringify({type: "ping", t_ms: performance.now()}));
    };
    socket.onmessage = ({data}) => {
      const message = JSON.parse(data);
      if (message.type === "done") times.push(performance.now() - sent);
      if (message.type === "refused") fail(message.detail);
      if (message.type !== "ready") setTimeout(next, 40);
    };
    socket.onclose = ({reason}) => fail(reason);
  });
  return times;
}"""


class Steps:
    """When the robot node took each of its steps, and what simulated time it reached with it."""

    def __init__(self, folder: Path) -> None:
        self._steps: list[tuple[int, int]] = []
        (socket,) = folder.glob("**/bus.sock")
        self._bus = Bus(Link(unix_endpoint(socket.parent)))
        self._bus.subscribe(SENSORS, self._hear)
        self._t_start_ns: int | None = None
        self._bus.subscribe(ROBOT_STATE, self._meet)

    def take(self) -> np.ndarray:
        """Return the steps since the last call: simulated seconds, and the epoch's milliseconds, (N, 2)."""
        steps, self._steps = np.array(self._steps).reshape(-1, 2), []
        epoch_ns = time.time_ns() - time.monotonic_ns()
        return np.column_stack([(steps[:, 0] - (self._t_start_ns or 0)) * 1e-9, (steps[:, 1] + epoch_ns) * 1e-6])

    def close(self) -> None:
        self._bus.close()

    def _hear(self, sensors: Sensors) -> None:
        self._steps.append((sensors.imu[-1].t_ns, sensors.stamp_ns))

    def _meet(self, state: RobotState) -> None:
        self._t_start_ns = state.t_start_ns


def memory_mb(server: Running) -> float:
    """Return what the server and its nodes hold, shared pages counted once."""
    total_kb = 0
    for pid in (server.process.pid, *processes(server.process.pid)):
        with contextlib.suppress(OSError):
            for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
                if line.startswith("Pss:"):
                    total_kb += int(line.split()[1])
    return total_kb / 1e3


def delays_ms(drawn: list[list[float]], steps: np.ndarray) -> np.ndarray:
    """Return how long after the middle of its exposure each picture was on the page."""
    pictures = np.array(drawn)
    known = (pictures[:, 0] > steps[0, 0]) & (pictures[:, 0] < steps[-1, 0])
    exposed_ms = np.interp(pictures[known, 0], steps[:, 0], steps[:, 1])
    return pictures[known, 1] - exposed_ms


async def watch(url: str, stalled: bool, seconds: float) -> np.ndarray:
    """Be a viewer, and return the gaps between ticks in ms; a stalled one reads nothing."""
    headers = {"Authorization": f"Bearer {TOKEN}"}
    times: list[float] = []
    async with connect(f"{url}/api/v1/telemetry", additional_headers=headers, max_size=None) as socket:
        until = time.monotonic() + seconds
        if stalled:
            await asyncio.sleep(seconds)
        while not stalled and time.monotonic() < until:
            message = await socket.recv()
            if isinstance(message, str) and json.loads(message)["type"] == "tick":
                times.append(time.monotonic())
    return np.diff(times) * 1e3


async def viewers(url: str) -> list[np.ndarray]:
    watching = [watch(url, k == 0, WATCHED_S) for k in range(VIEWERS)]
    return (await asyncio.gather(*watching))[1:]


def crawl(server: Running) -> str:
    """Take control and start the gait; return the lease's key."""
    with server.client() as client:
        lease = client.post("/api/v1/control/lease", json={"name": "bench", "seconds": LEASE_S})
        key = str(lease.raise_for_status().json()["key"])
        mine = {"Control-Lease": key}
        client.put("/api/v1/gait", json={"name": "serpentine"}, headers=mine).raise_for_status()
        client.post("/api/v1/gait/start", headers=mine).raise_for_status()
        return key


def goes_on(server: Running, key: str) -> str:
    """Keep control; return why the robot is held, "" while it moves."""
    with server.client() as client:
        client.put("/api/v1/control/lease", headers={"Control-Lease": key}).raise_for_status()
        state = client.get("/api/v1/state").json()
        return "" if state["moving"] else str(state["held_because"])


def with_page(server: Running, page: Any, steps: Steps, seconds: float) -> list[Row]:
    key = crawl(server)
    page.wait_for_timeout(SETTLE_S * 1e3)
    started, mb, held = time.monotonic(), memory_mb(server), []
    page.evaluate(TAKE)
    steps.take()
    while time.monotonic() - started < seconds:
        page.wait_for_timeout(CHUNK_S * 1e3)
        held.append(goes_on(server, key))
    taken, drawn = steps.take(), page.evaluate(TAKE)
    pace = (taken[-1, 0] - taken[0, 0]) / (taken[-1, 1] - taken[0, 1]) * 1e3
    commands_ms = np.array(page.evaluate(DRIVE, [key, COMMANDS]))
    after_mb = memory_mb(server)
    return [
        ("pace against real time", f"{pace:.4f}", "1.0"),
        ("held, for", "; ".join(filter(None, held)) or "nothing", "nothing"),
        ("control period, p50 and p99, ms", spread(np.diff(taken[:, 1]), 99), "13"),
        ("command in the browser until obeyed, p50 and p95, ms", spread(commands_ms, 95), "50"),
        ("camera to page, drawn, p50 and p95, ms", spread(delays_ms(drawn, taken), 95), "150"),
        ("server and nodes: memory, growth meanwhile, MB", f"{after_mb:.0f}, {after_mb - mb:+.0f}", "1500"),
    ]


def with_viewers(server: Running, steps: Steps) -> list[Row]:
    steps.take()
    gaps = asyncio.run(viewers(server.websocket))
    worst = max(float(np.percentile(g, 99)) for g in gaps)
    return [
        (f"{VIEWERS} viewers, one stalled: worst p99 gap between ticks, ms", f"{worst:.0f}", "150"),
        ("control period meanwhile, p50 and p99, ms", spread(np.diff(steps.take()[:, 1]), 99), "13"),
    ]


def rows(seconds: float) -> list[Row]:
    """Serve the default simulation, open the page and return what is to be told of it."""
    path = chromium_path()
    if path is None:
        sys.exit("no Chromium: install it or point CHROMIUM at one")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["TMPDIR"] = name
        server, url = start_dashboard(folder)
        try:
            wait_until_running(server)
            steps = Steps(folder)
            with open_chromium(path) as browser:
                page = browser.new_page(viewport=SIZE)
                page.add_init_script(OVERHEAR)
                page.goto(url)
                table = with_page(server, page, steps, seconds)
            # Playwright's own loop runs in this thread as long as it is open.
            thread = threading.Thread(target=lambda: table.extend(with_viewers(server, steps)))
            thread.start()
            thread.join()
            steps.close()
            return table
        finally:
            stop_dashboard(server)


def main(seconds: float = SECONDS) -> None:
    table = Table(f"the page, {seconds:g} s", "measured", "budget")
    for row in rows(seconds):
        table.add_row(*row)
    Console(emoji=False).print(table)
