"""The simulator's camera as a process of its own, so that rendering never delays the control loop."""

import queue
from time import monotonic_ns

from snakeslam.config import Config
from snakeslam.garbage import collect_seldom
from snakeslam.robot.model import snake_model
from snakeslam.runtime.assembly.build import build_camera
from snakeslam.runtime.bus.bus import Bus
from snakeslam.runtime.bus.link import Link
from snakeslam.runtime.bus.shapes import robot_sizes
from snakeslam.runtime.bus.topics import CAMERA_READY, EXPOSURES, FRAMES, JPEG_IMAGES
from snakeslam.runtime.bus.wire import Exposure, Heartbeat
from snakeslam.runtime.process.node import Child, Life, spawn
from snakeslam.runtime.process.priority import set_own_share
from snakeslam.runtime.view.jpeg import JpegEncoder

WAITING = 2
"""The most exposures that wait to be rendered; the oldest is left out."""


def camera_process(config: Config, link: Link) -> Child:
    """Start the camera's process."""
    return spawn("snakeslam:cam", run_camera, config, link)


def run_camera(config: Config, link: Link, life: Life) -> None:
    """Render the exposures that the robot node publishes until the life ends; report ready until the first one."""
    set_own_share()
    source = build_camera(config)
    bus = Bus(link, wanted=lambda: not life.over)
    bus.expect(robot_sizes(snake_model(config.robot).joint_count))
    exposures: queue.Queue[Exposure] = queue.Queue()
    bus.subscribe(EXPOSURES, exposures.put)
    encoder = JpegEncoder(lambda image: bus.publish(JPEG_IMAGES, image))
    begun = False
    collect_seldom()
    try:
        while not life.over:
            try:
                exposure = exposures.get(timeout=0.1)
            except queue.Empty:
                if not begun:
                    bus.publish(CAMERA_READY, Heartbeat("camera", monotonic_ns()))
                continue
            begun = True
            while exposures.qsize() >= WAITING:
                exposure = exposures.get()
            frame = source.expose(exposure.exposure)
            bus.publish(FRAMES, frame)
            encoder.encode(frame)
    finally:
        bus.close()
        source.close()
