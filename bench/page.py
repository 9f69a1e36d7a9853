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
from snakeslam.runtime.topics import SENSORS  # noqa: E402
from tests.e2e.chromium import chromium_path, open_chromium  # noqa: E402
from tests.e2e.conftest import start_dashboard, stop_dashboard, wait_until_running  # noqa: E402
from tests.server.running import TOKEN, Running  # noqa: E402

SECONDS = 60.0
SETTLE_S = 10.0
VIEWERS, WATCHED_S = 20, 20.0
COMMANDS = 60
SIZE = {"width": 1440, "height": 900}
Row = tuple[str, str, str]

LISTEN = """async (ms) => {
  const socket = new WebSocket(`ws://${location.host}/api/v1/telemetry`);
  socket.binaryType = "arraybuffer";
  const ticks = [], frames = [];
  socket.onmessage = ({data}) => {
    const now = performance.now();
    if (typeof data === "string") {
      const message = JSON.parse(data);
      if (message.type === "tick") ticks.push([message.t_s, now]);
    } else {
      const length = new DataView(data).getUint32(1, true);
      frames.push([JSON.parse(new TextDecoder().decode(new Uint8Array(data, 5, length))).t_s, now]);
    }
  };
  await new Promise((done) => setTimeout(done, ms));
  socket.close();
  return {ticks, frames};
}"""
DRIVE = """async ([key, count]) => {
  const socket = new WebSocket(`ws://${location.host}/api/v1/teleop`);
  const times = [];
  await new Promise((done, fail) => {
    let seq = 0, sent = 0;
    setTimeout(() => fail(`only ${times.length} inputs were obeyed in a minute`), 60000);
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
    """When the robot node took each of its steps."""

    def __init__(self, folder: Path) -> None:
        self.stamps_ns: list[int] = []
        (socket,) = folder.glob("**/bus.sock")
        self._bus = Bus(Link(unix_endpoint(socket.parent)))
        self._bus.subscribe(SENSORS, lambda sensors: self.stamps_ns.append(sensors.stamp_ns))

    def take_ms(self) -> np.ndarray:
        """Return the periods since the last call."""
        stamps, self.stamps_ns = self.stamps_ns, []
        return np.diff(stamps) * 1e-6

    def close(self) -> None:
        self._bus.close()


def memory_mb(server: Running) -> float:
    """Return what the server and its nodes hold, shared pages counted once."""
    total_kb = 0
    for pid in (server.process.pid, *processes(server.process.pid)):
        with contextlib.suppress(OSError):
            for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
                if line.startswith("Pss:"):
                    total_kb += int(line.split()[1])
    return total_kb / 1e3


def simulated_s(server: Running) -> float:
    with server.client() as client:
        return float(client.get("/api/v1/state").json()["t_s"])


def delays_ms(heard: dict[str, Any]) -> np.ndarray:
    """Return how much later than the fastest tick of its second each picture came, by the simulated time it shows."""
    ticks, frames = np.array(heard["ticks"]), np.array(heard["frames"])
    late = ticks[:, 1] - 1e3 * ticks[:, 0]
    least = [late[np.abs(ticks[:, 1] - now) < 500.0].min() for now in frames[:, 1]]
    return frames[:, 1] - 1e3 * frames[:, 0] - np.array(least)


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


def with_page(server: Running, page: Any, steps: Steps, seconds: float) -> list[Row]:
    started, t_s, mb = time.monotonic(), simulated_s(server), memory_mb(server)
    steps.take_ms()
    heard = page.evaluate(LISTEN, seconds * 1e3)
    pace = (simulated_s(server) - t_s) / (time.monotonic() - started)
    periods_ms = steps.take_ms()
    with server.client() as client:
        key = client.post("/api/v1/control/lease", json={"name": "bench", "seconds": 30}).json()["key"]
    commands_ms = np.array(page.evaluate(DRIVE, [key, COMMANDS]))
    after_mb = memory_mb(server)
    return [
        ("pace against real time", f"{pace:.3f}", "1.0"),
        ("control period, p50 and p99, ms", spread(periods_ms, 99), "13"),
        ("command in the browser until obeyed, p50 and p95, ms", spread(commands_ms, 95), "50"),
        ("camera to browser, p50 and p95, ms", spread(delays_ms(heard), 95), "150"),
        ("server and nodes: memory, growth meanwhile, MB", f"{after_mb:.0f}, {after_mb - mb:+.0f}", "1500"),
    ]


def with_viewers(server: Running, steps: Steps) -> list[Row]:
    steps.take_ms()
    gaps = asyncio.run(viewers(server.websocket))
    worst = max(float(np.percentile(g, 99)) for g in gaps)
    return [
        (f"{VIEWERS} viewers, one stalled: worst p99 gap between ticks, ms", f"{worst:.0f}", "150"),
        ("control period meanwhile, p50 and p99, ms", spread(steps.take_ms(), 99), "13"),
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
                page.goto(url)
                page.wait_for_timeout(SETTLE_S * 1e3)
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
