"""The robot node on a real bus: when simulated time begins."""

import time
from contextlib import closing
from dataclasses import replace

from snakeslam.config import load_config
from snakeslam.runtime.assembly.build import build_backend, build_control
from snakeslam.runtime.bus.bus import Bus
from snakeslam.runtime.bus.link import Link, unix_endpoint
from snakeslam.runtime.bus.topics import CAMERA_READY, SLAM_HEARTBEAT
from snakeslam.runtime.bus.wire import Heartbeat, Hello
from snakeslam.runtime.nodes.robot import RobotNode
from snakeslam.runtime.robot.controller import RobotController

PATIENCE_S = 10.0


def _iterate_until(node, condition):
    until = time.monotonic() + PATIENCE_S
    while not condition() and time.monotonic() < until:
        node.iterate()
    return condition()


def test_simulated_time_begins_when_camera_and_slam_are_there(tmp_path):
    config = load_config(None, [])
    link = Link(unix_endpoint(tmp_path), listens=True)
    with (
        closing(Bus(link)) as bus,
        closing(Bus(replace(link, listens=False))) as others,
        closing(build_backend(config, "elsewhere")) as backend,
    ):
        events = []
        robot = RobotController(
            config, backend, build_control(config, backend), events.append, boot="b", estop_reason=None
        )
        hello = Hello("b", 0, 0, backend.rig, config.robot, config.run.seed, simulated=True)
        node = RobotNode(robot, bus, hello, camera=True)

        def begun():
            return backend.t_ns > 0

        for ready in ((CAMERA_READY, Heartbeat("camera", 0)), (SLAM_HEARTBEAT, Heartbeat("slam", time.monotonic_ns()))):
            for _ in range(30):
                node.iterate()
            assert not begun()
            others.publish(*ready)
            assert _iterate_until(node, node._inbox.camera_ready.is_set)
        assert _iterate_until(node, begun)
