"""The slam node: what the robot's sensors say, in order, through estimator and mapper, and out to whoever listens."""

import queue
from collections import deque
from collections.abc import Callable
from time import monotonic, perf_counter
from uuid import uuid4

import cv2
import structlog

from snakeslam.config import Config
from snakeslam.garbage import collect_seldom
from snakeslam.messages import CameraFrame, JointTarget, MapChunk, Packet, SlamUpdate
from snakeslam.robot.model import snake_model
from snakeslam.runtime.bus.bus import Bus
from snakeslam.runtime.bus.link import Link
from snakeslam.runtime.bus.merge import Item, Merge
from snakeslam.runtime.bus.shapes import hello_sizes
from snakeslam.runtime.bus.topics import (
    CHUNKS,
    ESTIMATES,
    FEATURES,
    FRAMES,
    HELLO,
    PICTURES,
    ROBOT_STATE,
    SENSORS,
    SERVER_BEAT,
    SLAM_BEAT,
    SLAM_EVENTS,
    SLAM_STATE,
    Event,
    Features,
    Report,
    RobotState,
    SlamState,
)
from snakeslam.runtime.bus.wire import Beat, Estimate, Hello, Sensors
from snakeslam.runtime.process.clock import RobotClock
from snakeslam.runtime.process.node import Life, run_beside
from snakeslam.runtime.process.priority import SLAM_NICE, go_apart
from snakeslam.runtime.view.anchor import Anchor
from snakeslam.runtime.view.live import LiveSink
from snakeslam.runtime.view.pictures import Pictures
from snakeslam.runtime.view.sensor_watch import CAMERA, IMU, JOINTS, SensorWatch
from snakeslam.slam import Slam

NS = 1e-9
BEAT_S = 0.05
STUCK_S = 2.0
"""A loop that has not got on for so long is no longer alive."""
KEYS_PER_S = 100
"""More keyframes than that there are not: the keys of a slam that begins later are higher."""
KNOWN_SERVERS = 16
_log = structlog.get_logger("slam")


class Mapping:
    """Slam over the sensors of one boot of the robot; no bus in sight. ``put`` gets features, chunks and events."""

    def __init__(self, config: Config, hello: Hello, put: Callable[[Report], None]) -> None:
        # The same picture must give the same features in every run, on any number of cores.
        cv2.setNumThreads(1)
        cv2.setRNGSeed(0)
        self.boot, self.mode, self.simulated = hello.boot, config.estimator.mode, hello.simulated
        model = None if hello.robot is None else snake_model(hello.robot)
        self._slam = Slam(config.estimator, config.mapping, hello.rig, hello.seed, model)
        R_IC = hello.rig.cam0.T_IC[:3, :3]
        self._sink = LiveSink(model, put, R_IC, gravity_known=self.mode != "visual")
        self._merge = Merge()
        self._anchor = Anchor(hello.last_pose, round(hello.t_ns * NS * KEYS_PER_S), holds=hello.last_pose_holds)
        self._frames: deque[CameraFrame] = deque(maxlen=2)
        self._slam_ms = 0.0
        self.watch = SensorWatch.of(hello.rig, self.mode, joints=model is not None)
        """What arrives, whether or not slam has come to work it through."""
        self.estimate: Estimate | None = None
        """What slam says of the newest picture it has worked through."""

    def set_period(self, period_s: float) -> None:
        """Tell the gait's period."""
        self._sink.set_period(period_s)

    def state(self) -> SlamState:
        """Return the newest state."""
        return self._sink.state(self.boot, self.mode, self.watch.faults())

    def due(self) -> bool:
        """Whether it is time to tell the state."""
        return self._sink.due()

    def take_sensors(self, sensors: Sensors) -> None:
        """Take one control period's samples."""
        lost = self._merge.lost
        for item in self._merge.sensors(sensors):
            self._process(item)
        if self._merge.lost > lost:
            _log.warning("sensor messages lost", count=self._merge.lost - lost)
        if sensors.truth:
            self._sink.on_truth(sensors.truth)
        self._take_ready()

    def take_frame(self, frame: CameraFrame) -> None:
        """Take a picture; when slam cannot keep up, the oldest of those that wait is left out."""
        self._frames.append(frame)
        self._take_ready()

    def _take_ready(self) -> None:
        while self._frames and self._merge.ready(self._frames[0]):
            for item in self._merge.frame(self._frames.popleft()):
                self._process(item)

    def _process(self, item: Item) -> None:
        if isinstance(item, JointTarget):
            self._slam.expect(item)
            return
        self._sink.on_packet(item)
        update = self._timed(item)
        if update is not None and isinstance(item, CameraFrame):
            update = self._anchor.moved(update)
            self.estimate = Estimate(self.boot, update.t_ns, update.health, update.pose)
            self._sink.on_update(update, item, self._slam_ms)
            self._slam_ms = 0.0

    def _timed(self, packet: Packet) -> SlamUpdate | None:
        started = perf_counter()
        update = self._slam.process(packet)
        self._slam_ms += (perf_counter() - started) * 1e3
        return update


class SlamNode:
    """Slam on the bus; ``turn`` takes what has come."""

    def __init__(self, config: Config, bus: Bus) -> None:
        self._config, self._bus = config, bus
        self._clock = RobotClock()
        self._heard_boot = ""
        self._name = uuid4().hex[:16]
        self._inbox: queue.SimpleQueue[Hello | Sensors | CameraFrame | RobotState | Beat] = queue.SimpleQueue()
        self._mapping: Mapping | None = None
        self._told: Estimate | None = None
        self._chunks: dict[int, MapChunk] = {}
        self._servers: deque[str] = deque(maxlen=KNOWN_SERVERS)
        self._turned_s = monotonic()
        self.pictures = Pictures(lambda picture: bus.publish(PICTURES, picture))
        bus.subscribe(FRAMES, self._see)
        bus.subscribe(SERVER_BEAT, self._inbox.put)
        bus.subscribe(ROBOT_STATE, self._on_robot_state)
        for topic in (HELLO, SENSORS):
            bus.subscribe(topic, self._hear)

    def beat(self) -> None:
        """Say that slam is alive, if it is; from a thread of its own, for a picture may take long."""
        now_ns, mapping = self._clock.now_ns(), self._mapping
        if mapping is not None and now_ns is not None and monotonic() - self._turned_s < STUCK_S:
            estimate = mapping.estimate
            t_frame_ns = None if estimate is None else estimate.t_ns
            self._bus.publish(SLAM_BEAT, Beat(self._name, now_ns, t_frame_ns, mapping.watch.missing()))

    def turn(self, timeout_s: float = 0.1) -> None:
        """Wait for messages and take all there are; of pictures the newest."""
        self._turned_s = monotonic()
        frame: CameraFrame | None = None
        try:
            message = self._inbox.get(timeout=timeout_s)
            while True:
                if isinstance(message, CameraFrame):
                    frame = message
                else:
                    self._take(message)
                message = self._inbox.get_nowait()
        except queue.Empty:
            pass
        if self._mapping is None:
            return
        if frame is not None:
            self._mapping.take_frame(frame)
        estimate = self._mapping.estimate
        if estimate is not None and estimate is not self._told:
            self._told = estimate
            self._bus.publish(ESTIMATES, estimate)
            self.beat()
        if self._mapping.due():
            self._bus.publish(SLAM_STATE, self._mapping.state())

    def _see(self, frame: CameraFrame) -> None:
        """Pass a frame on to slam, and to the page where no camera's process does; neither waits for the other."""
        self._inbox.put(frame)
        mapping = self._mapping
        if mapping is None:
            return
        mapping.watch.add(CAMERA, frame.t_ns)
        if not mapping.simulated:
            self.pictures.hear(frame)

    def _on_robot_state(self, state: RobotState) -> None:
        self._inbox.put(state)
        if (mapping := self._mapping_of(state.boot)) is not None:
            mapping.watch.advance(state.t_ns)

    def _mapping_of(self, boot: str) -> Mapping | None:
        mapping = self._mapping
        return mapping if mapping is not None and mapping.boot == boot else None

    def _hear(self, message: Hello | Sensors) -> None:
        """Read the robot's clock as the message comes in, not when it is its turn."""
        if message.boot != self._heard_boot:
            self._heard_boot = message.boot
            self._clock.restart()
        self._clock.hear(message.stamp_ns)
        self._inbox.put(message)
        if isinstance(message, Sensors) and (mapping := self._mapping_of(message.boot)) is not None:
            _note_stamps(mapping.watch, message)

    def _take(self, message: "Hello | Sensors | RobotState | Beat") -> None:
        if isinstance(message, Hello):
            self._meet(message)
        elif isinstance(message, Beat):
            self._greet(message.sender)
        elif self._mapping is None or message.boot != self._mapping.boot:
            return
        elif isinstance(message, Sensors):
            self._mapping.take_sensors(message)
        elif message.period_s is not None:
            self._mapping.set_period(message.period_s)

    def _meet(self, hello: Hello) -> None:
        """Begin anew for a robot node that was not known: it has a time, and in a simulator a world, of its own."""
        if self._mapping is not None and self._mapping.boot == hello.boot:
            return
        self._chunks.clear()
        self._bus.expect(hello_sizes(hello))
        self._mapping = Mapping(self._config, hello, self._put)
        _log.info("mapping", boot=hello.boot, mode=self._mapping.mode, goes_on=hello.last_pose is not None)

    def _greet(self, sender: str) -> None:
        """Give a server that was not known the whole map."""
        if sender not in self._servers:
            self._servers.append(sender)
            for chunk in self._chunks.values():
                self._bus.publish(CHUNKS, chunk)

    def _put(self, report: Report) -> None:
        if isinstance(report, MapChunk):
            self._chunks[report.key] = report
            self._bus.publish(CHUNKS, report)
        elif isinstance(report, Features):
            self._bus.publish(FEATURES, report)
        elif isinstance(report, Event):
            self._bus.publish(SLAM_EVENTS, report)


def _note_stamps(watch: SensorWatch, sensors: Sensors) -> None:
    if sensors.target is not None:
        watch.advance(sensors.target.t_ns)
    for sample in sensors.imu:
        watch.add(IMU, sample.t_ns)
    if sensors.joints is not None:
        watch.add(JOINTS, sensors.joints.t_ns)


def run_slam(config: Config, link: Link, life: Life) -> None:
    """Run the slam node until its life ends."""
    go_apart(SLAM_NICE)
    bus = Bus(link, wanted=lambda: not life.over)
    node = SlamNode(config, bus)
    beside = [
        run_beside("slam-beat", life, lambda: None if life.wait(BEAT_S) else node.beat()),
        run_beside("pictures", life, node.pictures.turn),
    ]
    collect_seldom()
    try:
        while not life.over:
            node.turn()
    finally:
        life.end()
        for thread in beside:
            thread.join()
        bus.close()
