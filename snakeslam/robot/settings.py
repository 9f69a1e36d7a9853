"""The robot as a document: a preset's name, and the numbers in which this robot differs from it."""

from typing import Annotated, Literal

from pydantic import Field

from snakeslam.settings import Settings

ModelName = Literal["sim35", "orthogonal24"]
HeadPosture = Literal["flat", "raised"]
Offset = tuple[
    Annotated[float, Field(ge=-0.5, le=0.5)],
    Annotated[float, Field(ge=-0.5, le=0.5)],
    Annotated[float, Field(ge=-0.5, le=0.5)],
]
LEAST_JOINTS, MOST_JOINTS = 8, 64


class RobotHeadSettings(Settings):
    """Where the sensors are in the head link; offsets from the front end of its axis: forward, left, up."""

    camera_m: Offset | None = None
    """Position of the camera's optical centre, in m; null: the preset's, at the front end itself."""
    camera_tilt_deg: Annotated[float, Field(ge=-45, le=45)] | None = None
    """Upward tilt of the camera; null: the preset's, 0, which serves rolling gaits too."""
    imu_m: Offset | None = None
    """Position of the IMU, axes parallel to the link's, in m; null: the preset's, 0.012 m behind the front end."""


class RobotSettings(Settings):
    """Which robot: a preset's name (robot: orthogonal24), or a group; null takes the number of the preset model."""

    model: ModelName = "sim35"
    """sim35: the paper's simulated robot, 35 joints of 89.95 mm; orthogonal24: its prototype, 24 joints of 96 mm."""
    head_posture: HeadPosture = "raised"
    """raised lifts the head by two pitch joints (+-22 deg) and freezes the yaw joint between them; flat."""
    joint_count: Annotated[int, Field(ge=LEAST_JOINTS, le=MOST_JOINTS)] | None = None
    """Joints, which yaw and pitch in turn from the tail on; there is one link more."""
    link_length_m: Annotated[float, Field(ge=0.02, le=0.5)] | None = None
    """Length of a link, from one joint to the next, in m."""
    radius_m: Annotated[float, Field(ge=0.005, le=0.2)] | None = None
    """Radius of the body, in m; less than the length of a link."""
    link_mass_kg: Annotated[float, Field(ge=0.005, le=10)] | None = None
    """Mass of a link, in kg."""
    position_limit_deg: Annotated[float, Field(ge=20, le=150)] | None = None
    """Largest angle of a joint to either side."""
    rate_limit_rad_s: Annotated[float, Field(ge=0.1, le=50)] | None = None
    """Largest rate of a joint, in rad/s."""
    acceleration_limit_rad_s2: Annotated[float, Field(ge=1, le=1000)] | None = None
    """Largest acceleration of a joint, in rad/s^2."""
    torque_nm: Annotated[float, Field(ge=0.1, le=200)] | None = None
    """Largest torque of a joint, in N m."""
    head: RobotHeadSettings = RobotHeadSettings()
