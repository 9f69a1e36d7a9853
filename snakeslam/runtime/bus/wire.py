"""What the nodes say to each other on the bus, beside the types of ``messages``.

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
class Order:
    """A command on its way to the robot: the ``number``-th of its ``sender``."""

    sender: str
    number: int
    stamp_ns: int
    command: RobotCommand


@dataclass(frozen=True, slots=True)
class Beat:
    """A sign of life of the server or slam; ``t_frame_ns`` is the newest picture that slam has worked through.

    ``missing`` says in words which sensor the robot may not move without gives slam nothing; None where all do.
    """

    sender: str
    stamp_ns: int
    t_frame_ns: int | None = None
    missing: str | None = None


@dataclass(frozen=True, slots=True)
class Estimate:
    """What slam says of one picture of the robot's ``boot``; ``pose`` is None until initialised."""

    boot: str
    t_ns: int
    health: Health
    pose: PoseEstimate | None


@dataclass(frozen=True, slots=True)
class Hello:
    """What a robot node is, said five times a second: ``boot`` is another for each start of it.

    ``last_pose`` is the newest estimate it has heard, for a slam that begins anew; ``last_pose_holds`` is False where
    the robot has moved since then, beyond the braking of a hold; ``seed`` is that of the run.
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
    """What one control period gave, but for the camera; ``seq`` counts without a gap.

    ``truth`` is for display and recorder only.
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
    """A frame of ``boot``'s run that is to be drawn by the camera node."""

    boot: str
    exposure: CameraExposure
