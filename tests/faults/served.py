"""A served robot with its processes, what its servos get, and a teleop client that holds the drive down."""

import json
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from socket import SHUT_RDWR

import httpx
import numpy as np
from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect

from snakeslam.runtime.bus.bus import Bus
from snakeslam.runtime.bus.link import Link, unix_endpoint
from snakeslam.runtime.bus.topics import ROBOT_STATE, SENSORS, RobotState
from snakeslam.runtime.bus.wire import Sensors
from tests.server.running import START_S, TOKEN, Running, children, is_ready, start, wait_for

PERIOD_S, PING_EVERY = 0.05, 10
LEASE_S = 3600
MOVES_S = 5.0
"""A drive that was not held moves the servos within this time, on a busy machine too."""
ROBOT, SLAM, SERVER = "snakeslam:robot", "snakeslam:slam", "server"
STATIONARY_STEPS = 30
"""The robot counts as stationary after this many equal targets, 0.3 s."""


class TeleopClient:
    """A teleop client at 20 Hz in a thread of its own; it goes on sending its drive, on a new socket if need be."""

    def __init__(self, server: Running) -> None:
        self._server = server
        with server.client() as client:
            lease = client.post("/api/v1/control/lease", json={"name": "driver", "seconds": LEASE_S, "take_over": True})
            self.key = str(lease.raise_for_status().json()["key"])
        self.drive, self.sockets = 0.0, 0
        self.answers: list[tuple[float, str]] = []
        """What was sent, and why it was refused (else ""), since the last press or release."""
        self._socket: ClientConnection | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="teleop", daemon=True)
        self._thread.start()
        wait_for(lambda: self.sockets)

    def press(self) -> None:
        """Hold the drive down from now on; wait for the first answer."""
        self._change(1.0)

    def release(self) -> None:
        """Send one zero and wait for its answer."""
        self._change(0.0)

    def _change(self, drive: float) -> None:
        self.answers.clear()
        self.drive = drive
        wait_for(lambda: any(sent == drive for sent, _ in self.answers))

    @property
    def refusal(self) -> str:
        """Why the newest input was refused; "" where it was not."""
        return self.answers[-1][1]

    def drop(self) -> None:
        """Cut the connection without closing it."""
        if self._socket is not None:
            self._socket.socket.shutdown(SHUT_RDWR)

    def close(self) -> None:
        """End the client, and so its socket."""
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._over.is_set():
            # Whatever ends the socket, the client opens another one and goes on.
            with suppress(WebSocketException, OSError, TimeoutError):
                self._serve_socket()
            self._over.wait(0.2)

    def _serve_socket(self) -> None:
        url, bearer = f"{self._server.websocket}/api/v1/teleop", {"Authorization": f"Bearer {TOKEN}"}
        with connect(url, additional_headers=bearer, open_timeout=30, ping_interval=None) as socket:
            socket.send(json.dumps({"type": "hello", "lease": self.key}))
            self._ping(socket)
            self._wait_for_pong(socket)
            self._socket, self.sockets = socket, self.sockets + 1
            before, k = 0.0, 0
            sent: dict[int, float] = {}
            while not self._over.wait(PERIOD_S):
                k += 1
                if k % PING_EVERY == 0:
                    self._ping(socket)
                drive = self.drive
                if drive != 0.0 or before != 0.0:
                    sent[k] = drive
                    self._send(socket, type="drive", seq=k, drive=drive)
                before = drive
                with suppress(TimeoutError):
                    while True:
                        answer = json.loads(socket.recv(timeout=0))
                        if answer["type"] in ("done", "refused"):
                            self.answers.append((sent[answer["seq"]], answer.get("detail", "")))

    def _ping(self, socket: ClientConnection) -> None:
        self._send(socket, type="ping")

    def _wait_for_pong(self, socket: ClientConnection) -> None:
        while json.loads(socket.recv(timeout=30))["type"] != "pong":
            pass

    def _send(self, socket: ClientConnection, **message: object) -> None:
        socket.send(json.dumps({"t_ms": time.monotonic() * 1e3, **message}))


class Watcher:
    """What the robot node publishes, over a connection to the bus of its own."""

    def __init__(self, endpoint: Link) -> None:
        self._lock = threading.Lock()
        self._steps: list[tuple[int, np.ndarray]] = []
        self.states: list[tuple[float, RobotState]] = []
        self._bus = Bus(endpoint)
        self._bus.subscribe(SENSORS, self._on_sensors)
        self._bus.subscribe(ROBOT_STATE, lambda state: self.states.append((time.monotonic(), state)))

    @property
    def state(self) -> RobotState:
        """The newest state."""
        return self.states[-1][1]

    def fresh(self, since_s: float) -> bool:
        """Return whether a state has arrived since then."""
        return bool(self.states) and self.states[-1][0] > since_s

    def forget(self) -> None:
        """Drop what was received so far, except for the last of it."""
        with self._lock:
            del self._steps[:-STATIONARY_STEPS]
        del self.states[:-1]

    def motion_rad(self, since_ns: int) -> float:
        """Return how far the joint that moved most was moved since then, by the robot node's stamps."""
        with self._lock:
            steps = list(self._steps)
        pairs = [(b, a) for (_, a), (stamp, b) in pairwise(steps) if stamp >= since_ns]
        return float(np.max(np.sum([np.abs(b - a) for b, a in pairs], axis=0))) if pairs else 0.0

    def stationary(self) -> bool:
        """Return whether the last STATIONARY_STEPS targets are equal."""
        with self._lock:
            last = self._steps[-STATIONARY_STEPS:]
        return len(last) == STATIONARY_STEPS and all(np.array_equal(q, last[0][1]) for _, q in last)

    def close(self) -> None:
        """Leave the bus."""
        self._bus.close()

    def _on_sensors(self, sensors: Sensors) -> None:
        if sensors.target is not None:
            with self._lock:
                self._steps.append((sensors.stamp_ns, sensors.target.q_rad))


class Served:
    """A server with a robot node and a slam node of its own, as `make run` has them, around a light robot."""

    def __init__(self, folder: Path) -> None:
        before = os.environ.get("TMPDIR")
        os.environ["TMPDIR"] = str(folder)
        try:
            self.server = start(folder)
        finally:
            os.environ.pop("TMPDIR") if before is None else os.environ.update(TMPDIR=before)
        self.client = self.server.client()
        wait_for(lambda: is_ready(self.client), START_S)
        (socket,) = folder.glob("**/bus.sock")
        self.watcher = Watcher(Link(unix_endpoint(socket.parent)))
        wait_for(lambda: self.watcher.states)
        self.driver = TeleopClient(self.server)

    def pid(self, name: str) -> int:
        """Return the process of the server or of one of its nodes."""
        return self.server.process.pid if name == SERVER else wait_for(lambda: self._child(name))

    def _child(self, name: str) -> int | None:
        for pid in children(self.server.process.pid):
            # A node that is just being started has another name.
            with suppress(OSError):
                if Path(f"/proc/{pid}/comm").read_text().strip() == name[:15]:
                    return pid
        return None

    def post(self, path: str) -> httpx.Response:
        """Command like a page that has control."""
        return self.client.post(f"/api/v1{path}", headers={"Control-Lease": self.driver.key})

    def move_by_drive(self) -> None:
        """Release, press, and wait until the servos move; again when a slow machine had the robot held meanwhile."""

        def moves() -> bool:
            self.driver.release() if self.driver.drive else None
            self.driver.press()
            with suppress(AssertionError):
                self.wait_moving(MOVES_S)
                return True
            return False

        wait_for(moves, START_S)

    def move_by_start(self) -> None:
        """Start, and wait until the servos move."""
        wait_for(lambda: self.post("/gait/start").status_code == 200, START_S)
        self.wait_moving()

    def wait_moving(self, timeout_s: float = START_S) -> None:
        """Wait until the servos move."""
        self.watcher.forget()
        wait_for(lambda: self.watcher.state.moving and self.watcher.motion_rad(0) > 0.02, timeout_s)

    def moves_since(self, since_s: float, watched_s: float) -> bool:
        """Watch for a while since ``since_s``; return whether the robot moved at any time, or does not stop."""
        since_ns = round(since_s * 1e9)
        until_ns = since_ns + round(watched_s * 1e9)
        wait_for(lambda: self.watcher.state.stamp_ns > until_ns, START_S)
        moved = any(state.moving for _, state in list(self.watcher.states) if state.stamp_ns > since_ns)
        wait_for(self.watcher.stationary)
        return moved or self.watcher.state.moving

    @contextmanager
    def frozen(self, name: str) -> Iterator[None]:
        """Stop a process for the while."""
        pid = self.pid(name)
        os.kill(pid, signal.SIGSTOP)
        try:
            yield
        finally:
            os.kill(pid, signal.SIGCONT)

    def close(self) -> int:
        """End everything; return the server's exit code."""
        self.driver.close()
        self.watcher.close()
        self.client.close()
        return self.server.stop()
