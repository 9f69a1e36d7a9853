"""Slam over the live sensors of one start of the robot node: merge, runner and view; without a bus."""

from collections import deque
from collections.abc import Callable

import structlog

from snakeslam.config import Config
from snakeslam.messages import CameraFrame
from snakeslam.robot.model import snake_model
from snakeslam.runtime.bus.topics import Report, SlamState
from snakeslam.runtime.bus.wire import Estimate, Hello, Sensors
from snakeslam.runtime.slam.continuation import WorldContinuation
from snakeslam.runtime.slam.merge import Merge
from snakeslam.runtime.slam.runner import Item, SlamRunner
from snakeslam.runtime.slam.sensor_watch import SensorWatch
from snakeslam.runtime.view.live import LiveSink
from snakeslam.slam import Slam

NS = 1e-9
KEYS_PER_S = 100
"""More than the keyframes of a second, so that a slam that begins later has higher keys of chunks."""
_log = structlog.get_logger("slam")


class LiveSlam:
    """Slam over the sensors of the robot node that sent ``hello``; ``put`` gets features, chunks and events."""

    def __init__(self, config: Config, hello: Hello, put: Callable[[Report], None]) -> None:
        self.boot, self.mode, self.simulated = hello.boot, config.estimator.mode, hello.simulated
        model = None if hello.robot is None else snake_model(hello.robot)
        R_IC = hello.rig.cam0.T_IC[:3, :3]
        self._sink = LiveSink(model, put, R_IC, gravity_known=self.mode != "visual")
        first_key = round(hello.t_ns * NS * KEYS_PER_S)
        continuation = WorldContinuation(hello.last_pose, first_key, holds=hello.last_pose_holds)
        slam = Slam(config.estimator, config.mapping, hello.rig, hello.seed, model)
        self._runner = SlamRunner(slam, self._sink, continuation.moved)
        self._merge = Merge()
        self._frames: deque[CameraFrame] = deque(maxlen=2)
        self.watch = SensorWatch.of(hello.rig, self.mode, joints=model is not None)
        """What arrives, whether or not slam has processed it yet."""
        self.estimate: Estimate | None = None
        """The estimate at the newest frame that slam has processed."""

    def set_period(self, period_s: float) -> None:
        """Set the gait's period."""
        self._sink.set_period(period_s)

    def state(self) -> SlamState:
        """Return the newest state."""
        return self._sink.state(self.boot, self.mode, self.watch.faults())

    def due(self) -> bool:
        """Return whether the state is to be published."""
        return self._sink.due()

    def add_sensors(self, sensors: Sensors) -> None:
        """Add the samples of one control period."""
        lost = self._merge.lost
        for item in self._merge.add_sensors(sensors):
            self._process(item)
        if self._merge.lost > lost:
            _log.warning("sensor messages lost", count=self._merge.lost - lost)
        self._runner.on_truth(sensors.truth)
        self._process_ready_frames()

    def add_frame(self, frame: CameraFrame) -> None:
        """Add a frame; when slam cannot keep up, the oldest one that waits is left out."""
        self._frames.append(frame)
        self._process_ready_frames()

    def _process_ready_frames(self) -> None:
        while self._frames and self._merge.ready(self._frames[0]):
            for item in self._merge.add_frame(self._frames.popleft()):
                self._process(item)

    def _process(self, item: Item) -> None:
        update = self._runner.add(item)
        if update is not None:
            self.estimate = Estimate(self.boot, update.t_ns, update.health, update.pose)
