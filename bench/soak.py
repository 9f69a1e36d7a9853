"""The robot node for long: double E-stops, and freezes of each program while the drive is held down.

``python -m bench soak [ESTOPS] [FREEZES] [SEED]`` counts what happened and exits 1 at a violation: a dead node, an
E-stop that does not latch, brake or reset, a motion without a fresh press. The robot is a light one that stands in
front of a flat image.
"""

import os
import signal
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

CHECKOUT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(CHECKOUT))

from snakeslam.runtime.assembly.spec import SessionSpec  # noqa: E402
from snakeslam.runtime.bus.bus import Bus  # noqa: E402
from snakeslam.runtime.bus.commands import EStop, ResetEStop, RobotCommand, Start  # noqa: E402
from snakeslam.runtime.bus.link import Link, unix_endpoint  # noqa: E402
from snakeslam.runtime.bus.sender import Sender  # noqa: E402
from snakeslam.runtime.bus.topics import (  # noqa: E402
    COMMANDS,
    ESTOP,
    ROBOT_STATE,
    SERVER_HEARTBEAT,
    SLAM_HEARTBEAT,
    RobotState,
)
from snakeslam.runtime.bus.wire import Heartbeat, SentCommand  # noqa: E402
from snakeslam.runtime.nodes.robot import run_robot  # noqa: E402
from snakeslam.runtime.process.clock import RobotClock  # noqa: E402
from snakeslam.runtime.process.node import spawn  # noqa: E402
from tests.faults.nodes import CONFIG  # noqa: E402
from tests.faults.served import ROBOT, SERVER, SLAM, Served, Watcher  # noqa: E402
from tests.server.running import wait_for  # noqa: E402
from tests.server.still_robot import still_robot  # noqa: E402

ESTOPS, FREEZES, SEED = 1000, 200, 1
FROZEN_SHARE, FROZEN_S = 0.1, 0.05
"""In this share of the double E-stops the robot node is frozen meanwhile, so that one round of its loop has both."""
SHORT_S, LONG_S, LONG_SHARE = (0.2, 2.0), (2.0, 5.0), 0.1
WATCHED_S = 0.7
MUST_HOLD_S = {ROBOT: 1.2, SLAM: 0.7, SERVER: 0.7}
"""A freeze of so long must be noticed; the limits are 1 s and 0.3 s."""


class ViolationError(Exception):
    """Something that must never happen."""


def need(condition: object, what: str) -> None:
    if not condition:
        raise ViolationError(what)


def wait_or_violate(condition: "object", what: str) -> None:
    try:
        wait_for(condition)  # pyright: ignore[reportArgumentType]
    except AssertionError as error:
        raise ViolationError(what) from error


class Lone:
    """A robot node without server and slam: heartbeats in their names, and two senders of commands."""

    def __init__(self, folder: Path) -> None:
        link = Link(unix_endpoint(folder))
        self.child = spawn(
            "robot", run_robot, SessionSpec(CONFIG, build=still_robot), Link(link.endpoint, listens=True)
        )
        self.watcher = Watcher(link)
        self.buses, self.senders = (Bus(link), Bus(link)), (Sender(), Sender())
        self.clock = RobotClock()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._send_heartbeats, daemon=True)
        self.buses[0].subscribe(ROBOT_STATE, lambda state: self.clock.add(state.stamp_ns))
        wait_for(lambda: self.clock.now_ns() is not None and self.watcher.states)
        self._thread.start()

    @property
    def state(self) -> RobotState:
        return self.watcher.state

    def send(self, command: RobotCommand, k: int = 0) -> SentCommand:
        order = self.senders[k].stamped(command, self.clock.now_ns() or 0)
        self.buses[k].publish(ESTOP if isinstance(command, EStop) else COMMANDS, order)
        return order

    def done(self, order: SentCommand) -> bool:
        return any(answer.sender == order.sender and answer.done >= order.number for answer in self.state.answers)

    def send_both(self) -> list[SentCommand]:
        """Send an E-stop from each sender, at the same instant."""
        together, orders = threading.Barrier(2), [SentCommand("", 0, 0, Start())] * 2

        def send(k: int) -> None:
            together.wait()
            orders[k] = self.send(EStop(f"sender {k}"), k)

        threads = [threading.Thread(target=send, args=(k,)) for k in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        return orders

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        for bus in self.buses:
            bus.close()
        self.watcher.close()
        self.child.stop()

    def _send_heartbeats(self) -> None:
        while not self._over.wait(0.05):
            now_ns = self.clock.now_ns() or 0
            self.buses[0].publish(SERVER_HEARTBEAT, Heartbeat("server", now_ns))
            self.buses[0].publish(SLAM_HEARTBEAT, Heartbeat("slam", now_ns))


@contextmanager
def frozen(pid: int) -> Iterator[None]:
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


def double_estop(robot: Lone, freeze: bool) -> None:
    """Have the robot move, stop it from two sides at once, and reset it."""
    pid = robot.child.process.pid
    assert pid is not None

    def moving() -> bool:
        if not robot.state.moving:
            order = robot.send(Start())
            wait_for(lambda: robot.done(order))
        return robot.state.moving and robot.watcher.motion_rad(0) > 0.0

    robot.watcher.forget()
    wait_or_violate(moving, "it does not start")
    with ExitStack() as stack:
        if freeze:
            stack.enter_context(frozen(pid))
        orders = robot.send_both()
        if freeze:
            time.sleep(FROZEN_S)
    wait_or_violate(
        lambda: all(map(robot.done, orders)) or not robot.child.process.is_alive(), "an E-stop is not answered"
    )
    need(robot.child.process.is_alive(), "the robot node is dead")
    need(robot.state.estop_reason is not None and not robot.state.moving, "it is not latched")
    wait_or_violate(robot.watcher.stationary, "it does not brake")

    def reset() -> bool:
        # A command that a slow machine delivers late is refused, and given again.
        command = robot.send(ResetEStop())
        wait_for(lambda: robot.done(command))
        return robot.state.estop_reason is None

    wait_or_violate(reset, "it cannot be reset")
    after = robot.state
    need(not after.moving, f"the reset starts it (held: {after.held_because})")
    need(robot.watcher.stationary(), f"the reset moves its targets (held: {after.held_because})")


def soak_estops(count: int, rng: np.random.Generator) -> Counter[str]:
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder, closing(Lone(Path(folder))) as robot:
        for _ in track(range(count), "double E-stops"):
            freeze = bool(rng.random() < FROZEN_SHARE)
            double_estop(robot, freeze)
            counts["double E-stops, node frozen" if freeze else "double E-stops"] += 1
    return counts


def freeze_under_drive(served: Served, name: str, seconds: float) -> bool:
    """Freeze a program while the drive is held down; return whether the robot was held for it."""
    served.move_by_drive()
    pids = {node: served.pid(node) for node in (ROBOT, SLAM, SERVER)}
    frozen_ns = time.monotonic_ns()
    with frozen(pids[name]):
        time.sleep(seconds)
        thawed_ns = time.monotonic_ns()
    wait_or_violate(lambda: served.watcher.state.stamp_ns > thawed_ns + WATCHED_S * 1e9, f"{name} stays silent")
    states = [state for _, state in list(served.watcher.states) if state.stamp_ns > frozen_ns]
    first = next((k for k, state in enumerate(states) if not state.moving), None)
    need(first is None or not any(state.moving for state in states[first:]), f"it moves after a freeze of {name}")
    need(first is not None or seconds < MUST_HOLD_S[name], f"it is not held for a freeze of {name}")
    need({node: served.pid(node) for node in pids} == pids, "a node has died")
    if first is not None:
        wait_or_violate(served.watcher.stationary, "it does not come to rest")
    return first is not None


def soak_freezes(count: int, rng: np.random.Generator) -> Counter[str]:
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder, closing(Served(Path(folder))) as served:
        for _ in track(range(count), "freezes of each program"):
            for name in (ROBOT, SLAM, SERVER):
                seconds = float(rng.uniform(*(LONG_S if rng.random() < LONG_SHARE else SHORT_S)))
                held = freeze_under_drive(served, name, seconds)
                counts[f"freezes of {name}, {'held' if held else 'too short to be held'}"] += 1
    return counts


def main(estops: int = ESTOPS, freezes: int = FREEZES, seed: int = SEED) -> None:
    rng, console = np.random.default_rng(seed), Console(emoji=False)
    for what, soak, count in (("E-stops", soak_estops, estops), ("freezes", soak_freezes, freezes)):
        started = time.monotonic()
        try:
            counts = soak(count, rng)
        except ViolationError as violation:
            console.print(f"violation: {violation} (seed {seed})")
            sys.exit(1)
        for name, number in sorted(counts.items()):
            console.print(f"{name}: {number}")
        console.print(f"{what}: {time.monotonic() - started:.0f} s, no violation (seed {seed})")
