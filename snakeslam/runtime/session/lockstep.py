"""A run in lockstep: packets -> slam -> robot controller -> backend, as fast as the machine can; deterministic."""

from collections.abc import Sequence

from snakeslam.backends.base import Backend
from snakeslam.config import Config
from snakeslam.control import Control
from snakeslam.errors import BackendError
from snakeslam.messages import GroundTruth, Packet
from snakeslam.runtime.assembly.build import build_control, build_slam
from snakeslam.runtime.bus.topics import Event
from snakeslam.runtime.bus.wire import Estimate
from snakeslam.runtime.robot.controller import RobotController
from snakeslam.runtime.slam.runner import Sink, SlamRunner
from snakeslam.slam import Slam

NS = 1e-9


class Loop:
    """One backend, its robot's controller (None for a recording) and slam (None: no estimate), in lockstep.

    Slam and the controller, with its safety and governor, are those of a live session.
    """

    def __init__(self, backend: Backend, robot: RobotController | None, slam: Slam | None, sink: Sink) -> None:
        self.backend, self._robot = backend, robot
        self._runner = SlamRunner(slam, sink)

    def step(self) -> bool:
        """Advance one control period (a recording: one packet); return False at the end.

        BackendError when safety holds the robot: there is no operator who could start it again.
        """
        packets, truth = self._advance() if self._robot is not None else self._replay()
        for packet in packets or ():
            update = self._runner.add(packet)
            if update is not None and self._robot is not None:
                self._robot.on_estimate(Estimate(self._robot.boot, update.t_ns, update.health, update.pose))
        self._runner.on_truth(truth)
        return packets is not None

    def _replay(self) -> tuple[Sequence[Packet] | None, Sequence[GroundTruth]]:
        packets = self.backend.step(None)
        return packets, self.backend.read_ground_truth()

    def _advance(self) -> tuple[Sequence[Packet] | None, Sequence[GroundTruth]]:
        assert self._robot is not None
        t_ns = self.backend.t_ns
        step = self._robot.step(t_ns)
        held_because = self._robot.safety.held_because
        if held_because is not None:
            raise BackendError(f"the robot was held at {t_ns * NS:.2f} s of the run: {held_because}")
        if step is None:
            return None, self.backend.read_ground_truth()
        if step.target is not None:
            self._runner.add(step.target)
        return step.packets, step.truth


def build_loop(
    config: Config,
    backend: Backend,
    sink: Sink,
    *,
    slam: bool = True,
    control: Control | None = None,
    autostart: bool = False,
) -> Loop:
    """Return the loop over ``backend``, with slam unless it is left out; InputError where the settings cannot be run.

    ``control`` None is the configured one. The robot is stationary until ``run.rest_s`` with ``autostart``, else until
    the caller commands ``control``. No heartbeat is required, and blindness does not hold the robot, because a scripted
    run has no operator who could start it again.
    """
    control = build_control(config, backend) if control is None else control
    robot = None
    if control is not None:
        safety = config.safety.model_copy(update={"max_blind_s": 0.0})
        robot = RobotController(
            config.model_copy(update={"safety": safety}), backend, control, _ignore, required={}, autostart=autostart
        )
    return Loop(backend, robot, build_slam(config, backend) if slam else None, sink)


def _ignore(event: Event) -> None:
    """A scripted run has no timeline: what goes wrong raises an error."""
