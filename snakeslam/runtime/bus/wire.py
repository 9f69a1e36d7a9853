"""The messages between the nodes on the bus, besides the types of ``messages``.

``stamp_ns`` is the robot node's own clock (``clock``), ``t_ns`` the backend's time.
"""

from dataclasses import dataclass

from snakeslam.calibration import SensorRig
from snakeslam.messages import (
    CameraExposure,
    GroundTruth,
    Health,
    ImuSample,
    JointState,
    JointTarget,
    PoseEstimate,
)
from snakeslam.robot.settings import RobotSettings
from snakeslam.runtime.bus.commands import RobotCommand


@dataclass(frozen=True, slots=True)
class SentCommand:
    """A command on its way to the robot: the ``number``-th of its ``sender``."""

    sender: str
    number: int
    stamp_ns: int
    command: RobotCommand


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """Shows that a process lives; ``t_frame_ns`` is the stamp of the newest frame that slam has processed.

    ``missing`` names in words a sensor that is silent and without which the robot may not move; None: none is.
    """

    sender: str
    stamp_ns: int
    t_frame_ns: int | None = None
    missing: str | None = None


@dataclass(frozen=True, slots=True)
class Estimate:
    """Slam's estimate at one frame of the robot node's start ``boot``; ``pose`` is None until initialised."""

    boot: str
    t_ns: int
    health: Health
    pose: PoseEstimate | None


@dataclass(frozen=True, slots=True)
class Hello:
    """Describes a robot node, five times a second; each start of it has another ``boot``.

    ``last_pose`` is the newest pose it received, for a slam that is started again; ``last_pose_holds`` is False when
    the robot has moved since then by more than the braking of a hold; ``seed`` is that of the run.
    """

    boot: str
    stamp_ns: int
    t_ns: int
    rig: SensorRig
    robot: RobotSettings | None
    seed: int
    simulated: bool
    last_pose: PoseEstimate | None = None
    last_pose_holds: bool = True


@dataclass(frozen=True, slots=True)
class Sensors:
    """The samples of one control period without the camera's frames; ``seq`` counts without a gap.

    ``target`` is what the servos got; ``truth`` is for display and recorder only.
    """

    boot: str
    seq: int
    stamp_ns: int
    imu: tuple[ImuSample, ...]
    joints: JointState | None
    target: JointTarget | None
    truth: tuple[GroundTruth, ...]


@dataclass(frozen=True, slots=True)
class Exposure:
    """A frame that the camera's process is to render, of the robot node's start ``boot``."""

    boot: str
    exposure: CameraExposure
