"""What every backend offers; the rest of the house knows no more of a robot, simulator or recording than this."""

from collections.abc import Sequence
from typing import Protocol

from snakeslam.calibration import SensorRig
from snakeslam.messages import GroundTruth, JointTarget, Packet
from snakeslam.robot.model import SnakeModel


class Backend(Protocol):
    """Yields packets in time order and takes joint targets."""

    @property
    def rig(self) -> SensorRig:
        """Calibration of the sensors that the packets come from."""
        ...

    @property
    def model(self) -> SnakeModel | None:
        """The robot, or None for a recording that has none."""
        ...

    @property
    def t_ns(self) -> int:
        """Time reached so far."""
        ...

    def step(self, target: JointTarget | None) -> Sequence[Packet] | None:
        """Advance one control period (10 ms; a replay: to the next packet) and return its packets; None at the end."""
        ...

    def take_ground_truth(self) -> Sequence[GroundTruth]:
        """Return the truth since the last call, at IMU times; for evaluation, display and the recorder only."""
        ...

    def close(self) -> None:
        """Release what was opened; safe to call twice."""
        ...
