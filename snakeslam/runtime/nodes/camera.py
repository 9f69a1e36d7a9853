"""The simulator's camera as a process of its own: rendering never stands in the way of the control loop."""

import queue
from time import monotonic_ns

from snakeslam.config import Config
from snakeslam.garbage import collect_seldom
from snakeslam.robot.model import snake_model
from snakeslam.runtime.assembly.build import build_camera
from snakeslam.runtime.bus.bus import Bus
from snakeslam.runtime.bus.link import Link
from snakeslam.runtime.bus.shapes import robot_sizes
from snakeslam.runtime.bus.topics import CAMERA_READY, EXPOSURES, FRAMES, PICTURES
from snakeslam.runtime.bus.wire import Beat, Exposure
from snakeslam.runtime.process.node import Child, Life, spawn
from snakeslam.runtime.process.priority import set_own_share
from snakeslam.runtime.view.pictures import Pictures

WAITING = 2
"""Pictures that wait to be drawn at most; the oldest goes."""


def camera_process(config: Config, link: Link) -> Child:
    """Start the camera's process."""
    return spawn("snakeslam:cam", run_camera, config, link)


def run_camera(config: Config, link: Link, life: Life) -> None:
    """Draw what the robot node asks for until the life ends; say so until it first does."""
    set_own_share()
    source = build_camera(config)
    bus = Bus(link, wanted=lambda: not life.over)
    bus.expect(robot_sizes(snake_model(config.robot).joint_count))
    wanted: queue.Queue[Exposure] = queue.Queue()
    bus.subscribe(EXPOSURES, wanted.put)
    pictures = Pictures(lambda picture: bus.publish(PICTURES, picture))
    asked = False
    collect_seldom()
    try:
        while not life.over:
            try:
                exposure = wanted.get(timeout=0.1)
            except queue.Empty:
                if not asked:
                    bus.publish(CAMERA_READY, Beat("camera", monotonic_ns()))
                continue
            asked = True
            while wanted.qsize() >= WAITING:
                exposure = wanted.get()
            frame = source.expose(exposure.exposure)
            bus.publish(FRAMES, frame)
            pictures.show(frame)
    finally:
        bus.close()
        source.close()
