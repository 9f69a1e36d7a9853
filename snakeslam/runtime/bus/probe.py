"""Whether the nodes on a bus are alive, for a health check."""

import threading
from collections.abc import Sequence

from snakeslam.errors import SnakeslamError
from snakeslam.runtime.bus.bus import Bus
from snakeslam.runtime.bus.link import Link
from snakeslam.runtime.bus.topics import ROBOT_STATE, SLAM_HEARTBEAT

PATIENCE_S = 5.0
NODES = ("robot", "slam")


def check(link: Link, nodes: Sequence[str] = NODES, patience_s: float = PATIENCE_S) -> str:
    """Return a line that says the ``nodes`` are alive; SnakeslamError names the one that is silent."""
    bus = Bus(link, timeout_s=patience_s)
    robot, slam = threading.Event(), threading.Event()
    try:
        bus.subscribe(ROBOT_STATE, lambda _: robot.set())
        bus.subscribe(SLAM_HEARTBEAT, lambda _: slam.set())
        for name, arrived in (("robot", robot), ("slam", slam)):
            if name in nodes and not arrived.wait(patience_s):
                raise SnakeslamError(f"the {name} node is silent")
    finally:
        bus.close()
    return f"{' and '.join(nodes)} {'is' if len(nodes) == 1 else 'are'} alive"
