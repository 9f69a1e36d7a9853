"""What every backend offers; the rest of the program knows no more of a robot, simulator or recording than this.

What only some backends can do has a protocol of its own, which a backend hands out, or None: nobody has to ask for the
type of a backend.
"""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Protocol

from snakeslam.calibration import SensorRig
from snakeslam.messages import CameraExposure, CameraFrame, GroundTruth, JointTarget, Packet
from snakeslam.robot.model import SnakeModel


class RemoteCamera(Protocol):
    """A camera whose frames are drawn in another process, by a ``FrameSource``."""

    def read_exposures(self) -> Sequence[CameraExposure]:
        """Return what is to be drawn since the last call."""
        ...


class FrameSource(Protocol):
    """Draws the frames of a ``RemoteCamera``."""

    def expose(self, exposure: CameraExposure) -> CameraFrame:
        """Return the frame of ``exposure``."""
        ...

    def close(self) -> None:
        """Release what was opened; safe to call twice."""
        ...


class Recorded(Protocol):
    """What is known of a recording before it is played."""

    @property
    def start_ns(self) -> int:
        """Time at which playing starts."""
        ...

    @property
    def end_ns(self) -> int:
        """Stamp of the last packet."""
        ...

    @property
    def seed(self) -> int | None:
        """Seed of the recorded session, None where it is not known."""
        ...

    @property
    def has_truth(self) -> bool:
        """Whether the true motion was recorded."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What is odd about the recording's files and was read nevertheless, a line each."""
        ...

    @property
    def frame_stamps_ns(self) -> list[int]:
        """Stamps of the camera frames that are played, in order."""
        ...

    def read_frame(self, k: int) -> CameraFrame:
        """Return the ``k``-th of the frames that are played; InputError names a damaged file."""
        ...

    def frame_name(self, k: int) -> str:
        """Return what the ``k``-th of the frames that are played is called, for messages."""
        ...


class Backend(Protocol):
    """Yields packets in time order and takes joint targets."""

    @property
    @abstractmethod
    def simulated(self) -> bool:
        """Whether time is computed, so that it can wait for the estimator."""
        ...

    @property
    @abstractmethod
    def rig(self) -> SensorRig:
        """Calibration of the sensors that the packets come from."""
        ...

    @property
    @abstractmethod
    def model(self) -> SnakeModel | None:
        """The robot, or None for a recording that has none."""
        ...

    @property
    @abstractmethod
    def t_ns(self) -> int:
        """Time reached so far."""
        ...

    @property
    def moves(self) -> bool:
        """Whether joint targets move anything."""
        return self.model is not None

    @property
    def remote_camera(self) -> RemoteCamera | None:
        """The camera whose frames are drawn elsewhere; None where ``step`` returns all frames."""
        return None

    @property
    def recorded(self) -> Recorded | None:
        """The recording that is played; None for a simulator or a robot."""
        return None

    @abstractmethod
    def step(self, target: JointTarget | None) -> Sequence[Packet] | None:
        """Advance one control period (10 ms; a replay: to the next packet) and return its packets; None at the end."""
        ...

    @abstractmethod
    def read_ground_truth(self) -> Sequence[GroundTruth]:
        """Return the truth since the last call, at IMU times; for evaluation, display and the recorder only."""
        ...

    @abstractmethod
    def close(self) -> None:
        """Release what was opened; safe to call twice."""
        ...
