"""The typed answers of the API and the messages of /telemetry.

The OpenAPI schema is made of these models, and the page's TypeScript types are generated from it (``server.api``).
"""

from typing import TYPE_CHECKING, Literal

from pydantic import BaseModel, ConfigDict, Field, create_model

from snakeslam.gaits.catalogue import PARAMETER_KINDS
from snakeslam.head.settings import HeadController
from snakeslam.messages import Verdict
from snakeslam.runtime.bus.topics import Phase as GovernorPhase

SessionPhase = Literal["starting", "running", "ended", "failed"]
SourceKind = Literal["sim", "recording"]
Level = Literal["info", "warning", "error"]


class Answer(BaseModel):
    """What the server says: a fixed set of keys, all of them always there."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        use_attribute_docstrings=True,
        json_schema_serialization_defaults_required=True,
    )


class Source(Answer):
    """What is shown: the simulator (or the robot) or a recording."""

    kind: SourceKind
    name: str


class EStopState(Answer):
    """Whether the E-stop is latched, and why."""

    latched: bool
    reason: str | None


class Control(Answer):
    """Who may move the robot; null while nobody has taken control."""

    id: int | None
    holder: str | None


class CommandedGait(Answer):
    """The commanded gait with its parameters (null: the gait's own default); drive and turn in [-1, 1], left positive.

    ``GaitState`` adds a key for each parameter that any gait has.
    """

    name: str
    drive: float
    turn: float


if TYPE_CHECKING:
    GaitState = CommandedGait
    ParameterKey = str
else:
    ParameterKey = Literal[tuple(PARAMETER_KINDS)]
    GaitState = create_model(
        "GaitState",
        __base__=CommandedGait,
        __doc__=CommandedGait.__doc__.partition("\n")[0],
        **{key: (float | None, Field(description=kind.text)) for key, kind in PARAMETER_KINDS.items()},
    )


class HeadControl(Answer):
    """How the head is held."""

    controller: HeadController
    neck_joints: int | None
    """Yaw joints of the neck; null: as the gait needs."""


class HeadMotion(Answer):
    """How still the head is over the last period of the gait (``window_s``); null where it is not known."""

    yaw_deg: float | None
    """Deviation from the mean heading, now."""
    yaw_rms_deg: float | None
    yaw_rate_deg_s: float | None
    peak_yaw_rate_deg_s: float | None
    sway_m: float | None
    """Motion across the direction of travel, peak to peak."""
    heading_deg: float | None
    """Mean heading in the estimate's world."""
    window_s: float | None


class RobotInfo(Answer):
    """Which robot; "none" with 0 joints for a recording."""

    model: str
    joints: int


class EstimatorInfo(Answer):
    """Which estimator runs."""

    mode: str


class HealthState(Answer):
    """What the estimator says of its own pose."""

    verdict: Verdict
    reasons: list[str]
    tracks: int
    """Features that are tracked."""
    map_connected: bool
    """False after a new start whose map nothing ties to the first one."""


class Playback(Answer):
    """How a recording plays; seconds count from its first frame."""

    paused: bool
    speed: float
    """A multiple of real time."""
    position_s: float
    computed_s: float
    """How far the estimator has come; what is ahead has to be computed first."""
    duration_s: float
    seeking: bool
    at_end: bool
    seeks: int
    """Counts the jumps."""


class State(Answer):
    """What runs, how it moves, and what the estimator says of itself."""

    source: Source
    t_s: float
    """Seconds since the session's start."""
    moving: bool
    estop: EStopState
    control: Control
    gait: GaitState
    notice: str | None
    """What the operator should know of the gait, such as that it barely advances."""
    held_because: str | None
    """Why the robot is held until somebody starts it again; null when it is not."""
    back_up_offered: bool
    """It was stopped because the camera saw nothing; the operator may back it up."""
    head_control: HeadControl | None
    """Null without a robot."""
    head: HeadMotion
    robot: RobotInfo
    estimator: EstimatorInfo
    health: HealthState
    realtime_factor: float | None
    session: SessionPhase
    session_number: int
    """Another number, another session: nothing shown before belongs to it."""
    message: str | None
    playback: Playback | None
    """Null for a robot."""


class StateMessage(State):
    """The state, on /telemetry whenever something of it has changed."""

    type: Literal["state"] = "state"


class Governor(Answer):
    """The share of the commanded pace that the governor allows, and why it is not all."""

    pace: float
    phase: GovernorPhase
    reason: str | None


class Body(Answer):
    """The body in the estimate's world."""

    p_m: list[float]
    """Where each link begins, tail to head, as x, y, z in turn."""
    heading_deg: float
    estimated: bool
    """False before the first estimate: the joints are measured, the pose is not."""


class Tick(Answer):
    """The newest figures, on /telemetry at most 20 times a second."""

    t_s: float
    realtime_factor: float | None
    frame_rate_hz: float | None
    q_target: list[float]
    """Joint angles in rad, tail to head."""
    q_measured: list[float]
    moving: bool
    drive: float
    turn: float
    estop: EStopState
    notice: str | None
    head_control: HeadControl | None
    head: HeadMotion
    health: HealthState
    governor: Governor | None
    """Null where it is off."""
    error_m: float | None
    """Distance of the estimate from the simulator's truth."""
    distance_m: float | None
    map_points: int
    body: Body | None
    """Null where nothing is known of the body."""
    playback: Playback | None
    type: Literal["tick"] = "tick"


class TimelineEvent(Answer):
    """One line of the timeline, on /telemetry."""

    t_s: float
    level: Level
    text: str
    type: Literal["event"] = "event"


class Features(Answer):
    """What the estimator tracked into a frame, on /telemetry; it comes a little later than the frame."""

    t_s: float
    seq: int
    tracks: list[tuple[float, float, Literal[0, 1], int]]
    """Rows of x in px, y in px, 1 for an inlier, id."""
    roll_deg: float | None
    """How far the camera was rolled clockwise about its view; null when the estimator does not know."""
    type: Literal["features"] = "features"


class Pong(Answer):
    """The answer to a ping, with its time."""

    t_ms: float
    type: Literal["pong"] = "pong"


class ImageHeader(Answer):
    """The JSON header of a camera image on /telemetry, before the JPEG."""

    t_s: float
    seq: int
    width: int
    height: int


TelemetryMessage = StateMessage | Tick | TimelineEvent | Features | Pong
"""The JSON messages of /telemetry, distinguished by ``type``."""
