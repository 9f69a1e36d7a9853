"""Whatever fails in the robot node's loop, the brake ramp goes out and the loop goes on; over a real robot node."""

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from snakeslam.runtime.bus.bus import Bus
from snakeslam.runtime.bus.commands import EStop, ResetEStop, Start, Stop
from snakeslam.runtime.bus.sender import Sender
from snakeslam.runtime.bus.topics import ESTOP, SERVER_HEARTBEAT, RobotState
from snakeslam.runtime.bus.wire import Heartbeat
from snakeslam.runtime.robot.safety import LOST, SERVER
from snakeslam.runtime.robot.target_guard import NOT_FINITE
from tests.faults.failing_robot import failing_control, failing_robot
from tests.faults.nodes import HOLD_NS, Nodes, wait_for

ROUNDS = 12


class Operator:
    """The server's heartbeat over a bus of its own, and the commands of somebody who starts the robot."""

    def __init__(self, nodes: Nodes) -> None:
        self.nodes, self._over = nodes, threading.Event()
        self._thread = threading.Thread(target=self._send_heartbeats, daemon=True)
        self._thread.start()

    def start(self) -> None:
        """Have the robot move."""
        nodes = self.nodes
        wait_for(lambda: nodes.slam_states and nodes.slam_states[-1].T_WI is not None)
        wait_for(lambda: nodes.answered(nodes.send_now(Start())) is None)
        nodes.wait_moving()

    def close(self) -> None:
        self._over.set()
        self._thread.join()

    def _send_heartbeats(self) -> None:
        while not self._over.wait(0.05):
            now_ns = self.nodes.clock.now_ns()
            if now_ns is not None:
                self.nodes.bus.publish(SERVER_HEARTBEAT, Heartbeat(SERVER, now_ns))


@pytest.fixture(scope="module")
def operator(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Operator]:
    nodes = Nodes(tmp_path_factory.mktemp("bus"))
    with closing(nodes), closing(Operator(nodes)) as operator:
        wait_for(lambda: nodes.states)
        yield operator


def reset(nodes: Nodes) -> None:
    wait_for(lambda: nodes.answered(nodes.send_now(ResetEStop())) is None)
    wait_for(lambda: nodes.states[-1].estop_reason is None)


def test_estops_at_the_same_moment_latch_and_the_node_lives(operator: Operator) -> None:
    """Two senders, both messages in one round of the loop: it was frozen while they came."""
    nodes, pid = operator.nodes, operator.nodes.robot.process.pid
    assert pid is not None
    with closing(Bus(nodes.link)) as other:
        second = Sender()
        for k in range(ROUNDS):
            os.kill(pid, signal.SIGSTOP)
            try:
                first = nodes.send_now(EStop(f"first {k}"))
                other.publish(ESTOP, second.stamped(EStop(f"second {k}"), 0))
                time.sleep(0.1)
            finally:
                os.kill(pid, signal.SIGCONT)
            assert nodes.answered(first) is None
            wait_for(lambda: nodes.states[-1].estop_reason is not None)
            nodes.assert_stationary(0.05)
            reset(nodes)
    assert nodes.robot.process.is_alive()


def test_what_is_no_estop_on_the_estops_topic_is_dropped(operator: Operator) -> None:
    nodes = operator.nodes
    nodes.bus.publish(ESTOP, nodes.sender.stamped(Start(), nodes.clock.now_ns() or 0))
    stop = nodes.send_now(Stop())
    assert nodes.answered(stop) is None
    nodes.assert_stationary()
    assert nodes.states[-1].estop_reason is None


def held_after_start(nodes: Nodes, operator: Operator) -> RobotState:
    """Start; return the state in which the robot is held, for another reason than a heartbeat that came late."""
    for _ in range(10):
        operator.start()
        wait_for(lambda: nodes.states[-1].held_because is not None)
        held = nodes.states[-1]
        if held.held_because not in LOST.values():
            return held
    raise AssertionError("heartbeats come late again and again")


def test_a_robot_that_fails_for_some_steps_is_held_and_can_be_started_again(tmp_path: Path) -> None:
    nodes = Nodes(tmp_path, failing_robot)
    with closing(nodes), closing(Operator(nodes)) as operator:
        for _ in range(2):
            held = held_after_start(nodes, operator)
            assert held.held_because == "the robot failed: OSError: the servo bus does not answer"
            nodes.assert_held(held.stamp_ns - HOLD_NS)
        assert nodes.robot.process.is_alive()
        wait_for(lambda: any("the servo bus does not answer" in event.text for event in nodes.events))


def test_control_that_gives_no_numbers_or_raises_leaves_a_held_robot_that_can_be_started_again(tmp_path: Path) -> None:
    nodes = Nodes(tmp_path, failing_control)
    with closing(nodes), closing(Operator(nodes)) as operator:
        for reason in (NOT_FINITE, "control failed: FloatingPointError: overflow"):
            held = held_after_start(nodes, operator)
            assert held.held_because == reason
            nodes.assert_held(held.stamp_ns - HOLD_NS)
        assert nodes.robot.process.is_alive()
