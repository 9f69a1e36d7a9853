"""The slam node: takes the robot's sensors off the bus, runs slam over them and publishes estimates and map."""

import queue
from collections import deque
from time import monotonic
from uuid import uuid4

import structlog

from snakeslam.config import Config
from snakeslam.garbage import collect_seldom
from snakeslam.messages import CameraFrame, MapChunk
from snakeslam.runtime.bus.bus import Bus
from snakeslam.runtime.bus.link import Link
from snakeslam.runtime.bus.shapes import hello_sizes
from snakeslam.runtime.bus.topics import (
    CHUNKS,
    ESTIMATES,
    FEATURES,
    FRAMES,
    HELLO,
    JPEG_IMAGES,
    ROBOT_STATE,
    SENSORS,
    SERVER_HEARTBEAT,
    SLAM_EVENTS,
    SLAM_HEARTBEAT,
    SLAM_STATE,
    Event,
    Features,
    Report,
    RobotState,
)
from snakeslam.runtime.bus.wire import Estimate, Heartbeat, Hello, Sensors
from snakeslam.runtime.nodes.live_slam import LiveSlam
from snakeslam.runtime.process.clock import RobotClock
from snakeslam.runtime.process.node import Life, run_beside
from snakeslam.runtime.process.priority import SLAM_NICE, set_own_share
from snakeslam.runtime.slam.sensor_watch import CAMERA, IMU, JOINTS, SensorWatch
from snakeslam.runtime.view.jpeg import JpegEncoder

HEARTBEAT_S = 0.05
STUCK_S = 2.0
"""A loop that made no iteration for so long sends no heartbeat any more."""
KNOWN_SERVERS = 16
_log = structlog.get_logger("slam")


class SlamNode:
    """Slam on the bus; each ``iterate`` handles what has arrived."""

    def __init__(self, config: Config, bus: Bus) -> None:
        self._config, self._bus = config, bus
        self._clock = RobotClock()
        self._clock_boot = ""
        self._name = uuid4().hex[:16]
        self._inbox: queue.SimpleQueue[Hello | Sensors | CameraFrame | RobotState | Heartbeat] = queue.SimpleQueue()
        self._slam: LiveSlam | None = None
        self._published: Estimate | None = None
        self._chunks: dict[int, MapChunk] = {}
        self._servers: deque[str] = deque(maxlen=KNOWN_SERVERS)
        self._iteration_s = monotonic()
        self.encoder = JpegEncoder(lambda image: bus.publish(JPEG_IMAGES, image))
        bus.subscribe(FRAMES, self._on_frame)
        bus.subscribe(SERVER_HEARTBEAT, self._inbox.put)
        bus.subscribe(ROBOT_STATE, self._on_robot_state)
        for topic in (HELLO, SENSORS):
            bus.subscribe(topic, self._on_robot_message)

    def publish_heartbeat(self) -> None:
        """Publish a heartbeat if slam is alive; from a thread of its own, because one frame may take long."""
        now_ns, slam = self._clock.now_ns(), self._slam
        if slam is not None and now_ns is not None and monotonic() - self._iteration_s < STUCK_S:
            t_frame_ns = None if slam.estimate is None else slam.estimate.t_ns
            self._bus.publish(SLAM_HEARTBEAT, Heartbeat(self._name, now_ns, t_frame_ns, slam.watch.missing()))

    def iterate(self, timeout_s: float = 0.1) -> None:
        """Wait for messages, handle all there are, of frames the newest only, and publish what follows from them."""
        self._iteration_s = monotonic()
        frame = self._handle_messages(timeout_s)
        if self._slam is None:
            return
        if frame is not None:
            self._slam.add_frame(frame)
        estimate = self._slam.estimate
        if estimate is not None and estimate is not self._published:
            self._published = estimate
            self._bus.publish(ESTIMATES, estimate)
            self.publish_heartbeat()
        if self._slam.due():
            self._bus.publish(SLAM_STATE, self._slam.state())

    def _handle_messages(self, timeout_s: float) -> CameraFrame | None:
        """Handle what arrives within ``timeout_s`` and all that follows at once; return the newest frame of it."""
        frame: CameraFrame | None = None
        try:
            message = self._inbox.get(timeout=timeout_s)
            while True:
                if isinstance(message, CameraFrame):
                    frame = message
                else:
                    self._handle(message)
                message = self._inbox.get_nowait()
        except queue.Empty:
            return frame

    def _handle(self, message: "Hello | Sensors | RobotState | Heartbeat") -> None:
        if isinstance(message, Hello):
            self._handle_hello(message)
        elif isinstance(message, Heartbeat):
            self._handle_server(message.sender)
        elif self._slam is None or message.boot != self._slam.boot:
            return
        elif isinstance(message, Sensors):
            self._slam.add_sensors(message)
        elif message.period_s is not None:
            self._slam.set_period(message.period_s)

    def _handle_hello(self, hello: Hello) -> None:
        """Begin with a new slam for a new robot node: it has a time, and in a simulator a world, of its own."""
        if self._slam is not None and self._slam.boot == hello.boot:
            return
        self._chunks.clear()
        self._bus.expect(hello_sizes(hello))
        self._slam = LiveSlam(self._config, hello, self._publish_report)
        _log.info("slam started", boot=hello.boot, mode=self._slam.mode, continues=hello.last_pose is not None)

    def _handle_server(self, sender: str) -> None:
        """Send a new server the whole map."""
        if sender not in self._servers:
            self._servers.append(sender)
            for chunk in self._chunks.values():
                self._bus.publish(CHUNKS, chunk)

    def _publish_report(self, report: Report) -> None:
        if isinstance(report, MapChunk):
            self._chunks[report.key] = report
            self._bus.publish(CHUNKS, report)
        elif isinstance(report, Features):
            self._bus.publish(FEATURES, report)
        elif isinstance(report, Event):
            self._bus.publish(SLAM_EVENTS, report)

    # The bus's threads call what follows: stamps and the robot's clock are read when a message arrives, not when the
    # loop comes to handle it.

    def _on_frame(self, frame: CameraFrame) -> None:
        """Queue a frame for slam, and for the page unless the simulator's camera makes the page's images itself."""
        self._inbox.put(frame)
        slam = self._slam
        if slam is None:
            return
        slam.watch.add(CAMERA, frame.t_ns)
        if not slam.simulated:
            self.encoder.add(frame)

    def _on_robot_state(self, state: RobotState) -> None:
        self._inbox.put(state)
        if (slam := self._slam_of(state.boot)) is not None:
            slam.watch.advance(state.t_ns)

    def _on_robot_message(self, message: Hello | Sensors) -> None:
        if message.boot != self._clock_boot:
            self._clock_boot = message.boot
            self._clock.restart()
        self._clock.add(message.stamp_ns)
        self._inbox.put(message)
        if isinstance(message, Sensors) and (slam := self._slam_of(message.boot)) is not None:
            _add_stamps(slam.watch, message)

    def _slam_of(self, boot: str) -> LiveSlam | None:
        slam = self._slam
        return slam if slam is not None and slam.boot == boot else None


def _add_stamps(watch: SensorWatch, sensors: Sensors) -> None:
    if sensors.target is not None:
        watch.advance(sensors.target.t_ns)
    for sample in sensors.imu:
        watch.add(IMU, sample.t_ns)
    if sensors.joints is not None:
        watch.add(JOINTS, sensors.joints.t_ns)


def run_slam(config: Config, link: Link, life: Life) -> None:
    """Run the slam node until its life ends."""
    set_own_share(SLAM_NICE)
    bus = Bus(link, wanted=lambda: not life.over)
    node = SlamNode(config, bus)
    beside = [
        run_beside("slam-heartbeat", life, lambda: None if life.wait(HEARTBEAT_S) else node.publish_heartbeat()),
        run_beside("jpeg", life, node.encoder.iterate),
    ]
    collect_seldom()
    try:
        while not life.over:
            node.iterate()
    finally:
        life.end()
        for thread in beside:
            thread.join()
        bus.close()
