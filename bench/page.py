"""The whole stack as its user has it: the served simulator, a page open in Chromium, twenty viewers, floods in turn.

The E-stop is pressed under each flood. ``python -m bench page [SECONDS]``; on the machine that also runs the browser,
which draws in software there.
"""

import asyncio
import contextlib
import json
import os
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from websockets.asyncio.client import connect

CHECKOUT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(CHECKOUT))

from bench.flooding import KINDS  # noqa: E402
from bench.floods import Latch, Operator, flood  # noqa: E402
from bench.live import processes, spread  # noqa: E402
from snakeslam.runtime.bus.bus import Bus  # noqa: E402
from snakeslam.runtime.bus.link import Link, unix_endpoint  # noqa: E402
from snakeslam.runtime.bus.topics import ROBOT_STATE, SENSORS, RobotState  # noqa: E402
from snakeslam.runtime.bus.wire import Sensors  # noqa: E402
from tests.e2e.chromium import chromium_path, open_chromium  # noqa: E402
from tests.e2e.conftest import start_dashboard, stop_dashboard, wait_until_running  # noqa: E402
from tests.server.running import TOKEN, VIEWER_TOKEN, Running  # noqa: E402

SECONDS = 60.0
SETTLE_S = 10.0
CHUNK_S, LONG_CHUNK_S, LEASE_S = 10.0, 60.0, 300
VIEWERS = 20
MEMORIES = 6
COMMANDS = 60
SIZE = {"width": 1440, "height": 900}
Row = tuple[str, str, str]

# The page's worker reports when it has drawn an image; this listens to it.
OVERHEAR = """window.drawn = [];
window.Worker = class extends Worker {
  constructor(...given) {
    super(...given);
    this.addEventListener("message", ({data}) => {
      if (data?.kind === "image") window.drawn.push([data.image.t_s, data.image.shown_ms]);
    });
  }
};"""
READ_AND_CLEAR = "() => window.drawn.splice(0)"
DRIVE = """async ([key, count]) => {
  const socket = new WebSocket(`ws://${location.host}/api/v1/teleop`);
  const times = [];
  let refused = 0;
  await new Promise((done, fail) => {
    let seq = 0, sent = 0, releasing = false;
    const next = () => {
      if (times.length === count) { socket.close(); done(); return; }
      sent = performance.now();
      const drive = releasing ? 0 : 0.5 + 0.4 * (seq % 2);
      socket.send(JSON.stringify({type: "drive", seq: seq++, t_ms: sent, drive, turn: 0}));
    };
    socket.onopen = () => {
      socket.send(JSON.stringify({type: "hello", lease: key}));
      socket.send(JSON.stringify({type: "ping", t_ms: performance.now()}));
    };
    socket.onmessage = ({data}) => {
      const message = JSON.parse(data);
      if (message.type === "done" && !releasing) times.push(performance.now() - sent);
      // The robot was held meanwhile: let go and press again, as an operator would.
      releasing = message.type === "refused";
      if (releasing && ++refused > count) fail(message.detail);
      if (message.type !== "ready") setTimeout(next, 40);
    };
    socket.onclose = ({reason}) => fail(reason);
  });
  return [times, refused];
}"""


class Steps:
    """When the robot node took each of its steps, and what simulated time it reached with it."""

    def __init__(self, folder: Path) -> None:
        self._steps: list[tuple[int, int]] = []
        (socket,) = folder.glob("**/bus.sock")
        self._bus = Bus(Link(unix_endpoint(socket.parent)))
        self._bus.subscribe(SENSORS, self._on_sensors)
        self._t_start_ns: int | None = None
        self._bus.subscribe(ROBOT_STATE, self._on_robot_state)

    def read_and_clear(self) -> np.ndarray:
        """Return the steps since the last call: simulated seconds, and the epoch's milliseconds, (N, 2)."""
        steps, self._steps = np.array(self._steps).reshape(-1, 2), []
        epoch_ns = time.time_ns() - time.monotonic_ns()
        return np.column_stack([(steps[:, 0] - (self._t_start_ns or 0)) * 1e-9, (steps[:, 1] + epoch_ns) * 1e-6])

    def close(self) -> None:
        self._bus.close()

    def _on_sensors(self, sensors: Sensors) -> None:
        self._steps.append((sensors.imu[-1].t_ns, sensors.stamp_ns))

    def _on_robot_state(self, state: RobotState) -> None:
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
    """Return the time from the middle of each image's exposure until it was on the page, in ms."""
    images = np.array(drawn)
    known = (images[:, 0] > steps[0, 0]) & (images[:, 0] < steps[-1, 0])
    exposed_ms = np.interp(images[known, 0], steps[:, 0], steps[:, 1])
    return images[known, 1] - exposed_ms


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


async def viewers(url: str, seconds: float) -> list[np.ndarray]:
    watching = [watch(url, k == 0, seconds) for k in range(VIEWERS)]
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


@dataclass
class Measured:
    """What was noted while the page was open."""

    held: list[str] = field(default_factory=list)
    presses: list[tuple[float, float]] = field(default_factory=list)
    memories_mb: list[float] = field(default_factory=list)


def under_floods(server: Running, page: Any, operator: Operator, seconds: float) -> Measured:
    """Let the robot go on under one flood after the other; press at each one's end, and start again."""
    measured, kinds = Measured(memories_mb=[memory_mb(server)]), cycle(KINDS)
    chunk_s = min(LONG_CHUNK_S, max(CHUNK_S, seconds / len(KINDS)))
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        kind = next(kinds)
        with flood(server, kind):
            page.wait_for_timeout(chunk_s * 1e3)
            why = goes_on(server, operator.key)
            measured.held += [f"{kind}: {why}"] if why and kind != "estop" else []
            measured.presses.append(operator.press())
        operator.release()
        measured.memories_mb.append(memory_mb(server))
    return measured


def with_page(server: Running, page: Any, steps: Steps, latch: Latch, seconds: float) -> list[Row]:
    key = crawl(server)
    page.wait_for_timeout(SETTLE_S * 1e3)
    page.evaluate(READ_AND_CLEAR)
    steps.read_and_clear()
    with server.client() as client:
        measured = under_floods(server, page, Operator(client, latch, key=key), seconds)
    taken, drawn = steps.read_and_clear(), page.evaluate(READ_AND_CLEAR)
    pace = (taken[-1, 0] - taken[0, 0]) / (taken[-1, 1] - taken[0, 1]) * 1e3
    commands_ms, refused = page.evaluate(DRIVE, [key, COMMANDS])
    latched_ms, answered_ms = np.array(measured.presses).T
    known_ms = latched_ms[np.isfinite(latched_ms)]
    memories_mb = measured.memories_mb[:: max(1, len(measured.memories_mb) // MEMORIES)]
    return [
        ("pace against real time", f"{pace:.4f}", "1.0"),
        ("held, under which flood", "; ".join(measured.held) or "never", "never"),
        ("control period, p50 and p99, ms", spread(np.diff(taken[:, 1]), 99), "13"),
        (f"E-stop until latched, n = {len(known_ms)}, p50 and p95, ms", spread(known_ms, 95), "20"),
        (f"E-stop until answered, n = {len(answered_ms)}, p50 and p95, ms", spread(answered_ms, 95), "20"),
        ("command in the browser until obeyed, p50 and p95, ms", spread(np.array(commands_ms), 95), "50"),
        (f"of {COMMANDS + refused} commands refused by a held robot", str(refused), "0"),
        ("camera to page, drawn, p50 and p95, ms", spread(delays_ms(drawn, taken), 95), "150"),
        ("server and nodes: memory over time, MB", " ".join(f"{mb:.0f}" for mb in memories_mb), "1500, flat"),
    ]


def rows(seconds: float) -> list[Row]:
    """Serve the default simulation, open the page and return the rows of the report."""
    path = chromium_path()
    if path is None:
        sys.exit("no Chromium: install it or point CHROMIUM at one")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ.update({"TMPDIR": name, "SNAKESLAM_VIEWER_TOKEN": VIEWER_TOKEN})
        server, url = start_dashboard(folder)
        try:
            wait_until_running(server)
            steps = Steps(folder)
            with open_chromium(path) as browser:
                page = browser.new_page(viewport=SIZE)
                page.add_init_script(OVERHEAR)
                page.goto(url)
                gaps: list[np.ndarray] = []
                lasting_s = seconds + SETTLE_S
                watching = threading.Thread(
                    target=lambda: gaps.extend(asyncio.run(viewers(server.websocket, lasting_s))), daemon=True
                )
                watching.start()
                latch = Latch(folder)
                table = with_page(server, page, steps, latch, seconds)
                latch.bus.close()
            watching.join()
            worst = max(float(np.percentile(gap, 99)) for gap in gaps)
            table.append((f"{VIEWERS} viewers, one stalled: worst p99 gap between ticks, ms", f"{worst:.0f}", "150"))
            steps.close()
            return table
        finally:
            stop_dashboard(server)


def main(seconds: float = SECONDS) -> None:
    table = Table(f"the page, {seconds:g} s", "measured", "budget")
    for row in rows(seconds):
        table.add_row(*row)
    Console(emoji=False).print(table)
