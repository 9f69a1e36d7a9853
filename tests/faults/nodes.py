"""Real robot and slam processes on a real bus, and what reached the servos as the robot itself tells it."""

import os
import signal
import threading
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np

from snakeslam.backends.base import Backend
from snakeslam.config import Config
from snakeslam.messages import MapChunk
from snakeslam.robot.model import RobotSettings
from snakeslam.runtime.assembly.spec import SessionSpec
from snakeslam.runtime.bus.bus import Bus
from snakeslam.runtime.bus.commands import Drive, EStop, RobotCommand
from snakeslam.runtime.bus.link import Link, unix_endpoint
from snakeslam.runtime.bus.sender import Sender
from snakeslam.runtime.bus.topics import (
    CHUNKS,
    COMMANDS,
    ESTOP,
    ROBOT_EVENTS,
    ROBOT_STATE,
    SENSORS,
    SLAM_STATE,
    Event,
    RobotState,
    SlamState,
)
from snakeslam.runtime.bus.wire import Sensors, SentCommand
from snakeslam.runtime.nodes.robot import run_robot
from snakeslam.runtime.nodes.slam import run_slam
from snakeslam.runtime.process.clock import RobotClock
from snakeslam.runtime.process.node import Child, spawn
from tests.server.still_robot import still_robot

CONFIG = Config(robot=RobotSettings(model="orthogonal24"))
HOLD_NS, BRAKE_STEPS = 360_000_000, 16
"""A silence is noticed after 300 ms (and the way of two messages); the fastest joint brakes in 15 steps of 10 ms."""


def wait_for(condition: Callable[[], object], timeout_s: float = 60.0) -> None:
    until = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < until, "it did not happen in time"
        time.sleep(0.02)


class Nodes:
    """A robot node that listens, a slam node, and somebody who hears everything and may command."""

    def __init__(
        self, folder: Path, build: Callable[[SessionSpec], Backend] = still_robot, config: Config = CONFIG
    ) -> None:
        self.config = config
        self.endpoint = unix_endpoint(folder)
        self.link = Link(self.endpoint)
        robot = Link(self.endpoint, listens=True)
        self.robot: Child = spawn("robot", run_robot, SessionSpec(config, build=build), robot)
        self.start_slam()
        self.bus = Bus(self.link)
        self.lock = threading.Lock()
        self.steps: list[tuple[int, np.ndarray]] = []
        self.states: list[RobotState] = []
        self.events: list[Event] = []
        self.slam_states: list[SlamState] = []
        self.chunks: dict[int, MapChunk] = {}
        self.clock = RobotClock()
        self.sender = Sender()
        self.bus.subscribe(SENSORS, self._on_sensors)
        self.bus.subscribe(ROBOT_STATE, self.states.append)
        self.bus.subscribe(ROBOT_EVENTS, self.events.append)
        self.bus.subscribe(SLAM_STATE, self.slam_states.append)
        self.bus.subscribe(CHUNKS, lambda chunk: self.chunks.update({chunk.key: chunk}))

    def start_slam(self) -> None:
        self.slam: Child = spawn("slam", run_slam, self.config, self.link)

    def close(self) -> None:
        self.bus.close()
        for child in (self.robot, self.slam):
            if child.process.is_alive():
                os.kill(child.process.pid or 0, signal.SIGCONT)
            child.stop()

    def send_now(self, command: RobotCommand, stamp_ns: int | None = None) -> SentCommand:
        """Send ``command``, stamped now or otherwise."""
        now_ns = self.clock.now_ns()
        assert now_ns is not None
        sent = self.sender.stamped(command, now_ns if stamp_ns is None else stamp_ns)
        self.send(sent)
        return sent

    def send(self, sent: SentCommand) -> None:
        self.bus.publish(ESTOP if isinstance(sent.command, EStop) else COMMANDS, sent)

    def answered(self, sent: SentCommand) -> str | None:
        """Wait for the robot's answer; return why it refused."""

        def done() -> bool:
            return any(a.sender == sent.sender and a.done >= sent.number for a in self.states[-1].answers)

        wait_for(done)
        answer = next(a for a in self.states[-1].answers if a.sender == sent.sender)
        return next((refusal.reason for refusal in answer.refusals if refusal.number == sent.number), None)

    def rates(self, since_ns: int) -> list[tuple[int, float]]:
        """Return (stamp, largest step of a joint in rad) of every target since ``since_ns``."""
        with self.lock:
            steps = list(self.steps)
        pairs = pairwise(steps)
        return [(stamp, float(np.abs(q - before).max())) for (_, before), (stamp, q) in pairs if stamp >= since_ns]

    def assert_held(self, since_ns: int, seconds: float = 0.6) -> None:
        """The robot moved at ``since_ns``, brakes as soon as it must know of it, and is stationary from then on."""
        wait_for(lambda: self.steps and self.steps[-1][0] > since_ns + HOLD_NS + int(seconds * 1e9))
        # On a busy machine the steps come later than every 10 ms.
        wait_for(lambda: len(self.rates(since_ns + HOLD_NS)) > 3 * BRAKE_STEPS)
        known = self.rates(since_ns + HOLD_NS)
        assert all(step == 0.0 for _, step in known[BRAKE_STEPS:]), "it still moves"

    def assert_stationary(self, seconds: float = 0.3) -> None:
        """The servos get one and the same target for a while."""
        since_ns = time.monotonic_ns()
        wait_for(lambda: self.steps[-1][0] > since_ns + int(seconds * 1e9))
        assert all(step == 0.0 for _, step in self.rates(since_ns)), "it moves"

    def wait_stationary(self) -> None:
        """Wait until the servos have had one and the same target for a while."""
        since_ns = time.monotonic_ns()
        wait_for(lambda: len(steps := self.rates(since_ns)) > 30 and all(step == 0.0 for _, step in steps[-30:]))

    def wait_moving(self, command: RobotCommand | None = None) -> None:
        """Wait until the servos move; ``command`` is repeated meanwhile."""
        since_ns = time.monotonic_ns()
        if isinstance(command, Drive):
            self.send_now(Drive(0.0))  # an input that this robot node does not know must be released first

        def moving() -> bool:
            if command is not None:
                self.send_now(command)
            return sum(step > 1e-4 for _, step in self.rates(since_ns)) > 20

        wait_for(moving)

    def _on_sensors(self, sensors: Sensors) -> None:
        self.clock.add(sensors.stamp_ns)
        if sensors.target is not None:
            with self.lock:
                self.steps.append((sensors.stamp_ns, sensors.target.q_rad))
