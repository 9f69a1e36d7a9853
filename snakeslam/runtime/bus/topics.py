"""What a live session reports to its host, and the table of what goes over the bus.

Reports are frozen; commands go the other direction (``commands``). Times are those of the backend.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Generic, Literal, TypeVar

from snakeslam.head.settings import HeadSettings
from snakeslam.messages import CameraFrame, Float, GaitCommand, Health, MapChunk
from snakeslam.runtime.bus.wire import Estimate, Exposure, Heartbeat, Hello, Sensors, SentCommand


class Phase(Enum):
    """What the governor does now."""

    FULL = "full"
    SLOWING = "slowing"
    SLOW = "slow"
    RETURNING = "returning"


@dataclass(frozen=True, slots=True)
class Governed:
    """The share of the commanded pace that the governor allows, in (0, 1], and the reason when it is less than 1."""

    pace: float = 1.0
    phase: Phase = Phase.FULL
    reason: str | None = None


@dataclass(frozen=True, slots=True)
class RobotShape:
    """The robot's measures that are needed to draw it."""

    model: str
    joint_count: int
    joint_length_m: float
    radius_m: float


@dataclass(frozen=True, slots=True)
class Started:
    """The session runs; ``fov_y_rad``, ``aspect`` and ``T_IC`` (4, 4) are the camera's."""

    t_start_ns: int
    estimator_mode: str
    robot: RobotShape | None
    T_IC: Float
    fov_y_rad: float
    aspect: float
    gait: GaitCommand | None


@dataclass(frozen=True, slots=True)
class HeadMotion:
    """The head's motion over the last period of the gait (``window_s``); None where it is not known.

    ``heading_deg`` is the mean heading in the estimate's world, ``yaw_deg`` the head's deviation from it now and
    ``yaw_rms_deg`` over the period; ``sway_m`` is the motion across the displacement, peak to peak.
    """

    yaw_deg: float | None = None
    yaw_rms_deg: float | None = None
    yaw_rate_deg_s: float | None = None
    peak_yaw_rate_deg_s: float | None = None
    sway_m: float | None = None
    heading_deg: float | None = None
    window_s: float | None = None


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why the session did not do the command of this number (counted as in ``Tick.commands_done``)."""

    number: int
    reason: str


@dataclass(frozen=True, slots=True)
class Answer:
    """The robot's answer to a sender: ``done`` is the number of its last command that the robot handled."""

    sender: str
    done: int
    refusals: tuple[Refusal, ...] = ()


@dataclass(frozen=True, slots=True)
class RobotState:
    """The state of the robot node; ``period_s`` is the gait's, ``held_because`` why it is held until a start.

    ``governed`` is the pace that the governor allows, None where it is off. ``back_up_offered``: it is held because its
    camera saw nothing, and may be backed up.
    """

    boot: str
    stamp_ns: int
    t_start_ns: int
    t_ns: int
    moving: bool
    estop_reason: str | None
    held_because: str | None
    gait: GaitCommand | None
    head_settings: HeadSettings | None
    notice: str | None
    period_s: float | None
    realtime_factor: float | None
    q_target_rad: Float | None
    q_measured_rad: Float | None
    governed: Governed | None = None
    answers: tuple[Answer, ...] = ()
    back_up_offered: bool = False


@dataclass(frozen=True, slots=True)
class SlamState:
    """The state of slam over the sensors of the robot node's start ``boot``; members as in ``Tick``."""

    boot: str
    mode: str
    health: Health
    frame_rate_hz: float | None
    T_WI: Float | None
    Ts_WL: Float | None
    T_WI_truth: Float | None
    head: HeadMotion
    error_m: float | None
    distance_m: float | None
    map_points: int


@dataclass(frozen=True, slots=True)
class PlaybackState:
    """How a recording plays; times in seconds from its first frame.

    ``computed_s`` is how far the estimator has come, ``seeking`` whether it is computing up to a requested frame,
    ``seeks`` counts the jumps, so that curves over time are not drawn across one.
    """

    paused: bool
    speed: float
    position_s: float
    computed_s: float
    duration_s: float
    seeking: bool
    at_end: bool
    seeks: int


@dataclass(frozen=True, slots=True)
class Tick:
    """The newest state, at most 20 times a second; ``commands_done`` is the number of the last command handled.

    ``T_WI`` (4, 4) is the estimate, ``Ts_WL`` (N + 1, 4, 4) the links' poses that follow from it, ``T_WI_truth``
    the truth aligned with the estimate's first pose by yaw and translation, ``error_m`` the distance of the two.
    ``head`` is the head's motion, ``head_settings`` its control, ``notice`` what the operator should know of the
    gait, ``refusals`` the last commands that were not obeyed, ``governed`` the pace that the governor allows, None
    where it is off, ``held_because`` why the robot is held until somebody starts it again, ``back_up_offered``
    whether it is held because its camera saw nothing, and may be backed up, ``playback`` how a recording plays,
    None for a robot.
    """

    t_ns: int
    commands_done: int
    moving: bool
    estop_reason: str | None
    gait: GaitCommand | None
    health: Health
    realtime_factor: float | None
    frame_rate_hz: float | None
    q_target_rad: Float | None
    q_measured_rad: Float | None
    T_WI: Float | None
    Ts_WL: Float | None
    T_WI_truth: Float | None
    head: HeadMotion
    error_m: float | None
    distance_m: float | None
    map_points: int
    head_settings: HeadSettings | None = None
    notice: str | None = None
    refusals: tuple[Refusal, ...] = ()
    governed: Governed | None = None
    held_because: str | None = None
    back_up_offered: bool = False
    playback: PlaybackState | None = None


@dataclass(frozen=True, slots=True)
class JpegImage:
    """One camera frame as JPEG."""

    t_ns: int
    seq: int
    width: int
    height: int
    jpeg: bytes


@dataclass(frozen=True, slots=True)
class Features:
    """The features tracked into frame ``seq``: rows of (x_px, y_px, inlier 0 or 1, id).

    ``roll_rad`` is how far the camera was rolled about its view, clockwise as it sees itself, None where not known.
    """

    t_ns: int
    seq: int
    tracks: tuple[tuple[float, float, int, int], ...]
    roll_rad: float | None = None


@dataclass(frozen=True, slots=True)
class Event:
    """A line of the timeline; ``level`` is info, warning or error."""

    t_ns: int
    level: str
    text: str


@dataclass(frozen=True, slots=True)
class Opening:
    """Another source is being opened; what was shown before does not belong to it."""


@dataclass(frozen=True, slots=True)
class Restarting:
    """The robot node has died and is started again: a new session begins with the next ``Started``."""

    reason: str


@dataclass(frozen=True, slots=True)
class Silence:
    """The robot node is silent, in words; None when its state arrives again."""

    reason: str | None


@dataclass(frozen=True, slots=True)
class Ended:
    """The session is over: at a recording's end, by request, or (``error``) by a failure, in one line."""

    error: str | None


Report = Opening | Started | Tick | JpegImage | Features | MapChunk | Event | Restarting | Silence | Ended

T_co = TypeVar("T_co", covariant=True)
Policy = Literal["lossless", "newest", "urgent"]
BULKY_BYTES, SMALL_BYTES = 1 << 26, 1 << 22
"""64 MB is a colour image with depth of 9 megapixels; 4 MB the largest JPEG."""


@dataclass(frozen=True, slots=True)
class Topic(Generic[T_co]):
    """One row of the table. A subscriber may miss messages of policy ``newest``; ``urgent`` overtakes everything.

    A ``bulky`` topic is sent after all others, and waits for a slow link instead of being dropped.
    """

    name: str
    type: type[T_co]
    rate_hz: float | None
    """None: sent when there is a message."""
    policy: Policy
    recorded: bool = False
    bulky: bool = False

    @property
    def most_bytes(self) -> int:
        """The largest message in bytes; a larger one is dropped undecoded."""
        return BULKY_BYTES if self.bulky else SMALL_BYTES


ESTOP = Topic("robot/estop", SentCommand, None, "urgent", recorded=True)
COMMANDS = Topic("robot/commands", SentCommand, None, "lossless", recorded=True)
HELLO = Topic("robot/hello", Hello, 5.0, "newest", recorded=True)
SENSORS = Topic("robot/sensors", Sensors, 100.0, "lossless", recorded=True)
ROBOT_STATE = Topic("robot/state", RobotState, 20.0, "newest")
ROBOT_EVENTS = Topic("robot/events", Event, None, "lossless", recorded=True)
EXPOSURES = Topic("camera/exposures", Exposure, 20.0, "newest")
CAMERA_READY = Topic("camera/ready", Heartbeat, 10.0, "newest")
FRAMES = Topic("camera/frames", CameraFrame, 20.0, "newest", recorded=True, bulky=True)
JPEG_IMAGES = Topic("camera/images", JpegImage, 20.0, "newest")
SERVER_HEARTBEAT = Topic("server/heartbeat", Heartbeat, 20.0, "newest")
SLAM_HEARTBEAT = Topic("slam/heartbeat", Heartbeat, 20.0, "newest")
ESTIMATES = Topic("slam/estimates", Estimate, 20.0, "newest", recorded=True)
SLAM_STATE = Topic("slam/state", SlamState, 20.0, "newest")
FEATURES = Topic("slam/features", Features, 20.0, "newest")
CHUNKS = Topic("slam/chunks", MapChunk, None, "lossless", recorded=True, bulky=True)
SLAM_EVENTS = Topic("slam/events", Event, None, "lossless", recorded=True)

TOPICS = (
    ESTOP, COMMANDS, HELLO, SENSORS, ROBOT_STATE, ROBOT_EVENTS, EXPOSURES, CAMERA_READY, FRAMES,
    JPEG_IMAGES, SERVER_HEARTBEAT, SLAM_HEARTBEAT, ESTIMATES, SLAM_STATE, FEATURES, CHUNKS, SLAM_EVENTS,
)  # fmt: skip
