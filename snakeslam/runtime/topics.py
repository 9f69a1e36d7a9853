"""What the live session and its host say to each other over a pipe: frozen, picklable, newest wins where it may.

Commands go to the session, reports come back. Times are those of the backend.
"""

from dataclasses import dataclass

from snakeslam.head.settings import HeadSettings
from snakeslam.messages import Float, GaitCommand, HeadCommand, Health, MapChunk
from snakeslam.runtime.governor import Governed


@dataclass(frozen=True, slots=True)
class SetGait:
    """Change the gait or its parameters; ``drive`` of ``gait`` is ignored: only Start and Stop set things moving."""

    gait: GaitCommand


@dataclass(frozen=True, slots=True)
class SetHead:
    """Change the head's controller or its neck, or turn its reference line."""

    head: HeadCommand


@dataclass(frozen=True, slots=True)
class Start:
    """Move."""


@dataclass(frozen=True, slots=True)
class Stop:
    """Come to rest."""


@dataclass(frozen=True, slots=True)
class Drive:
    """The operator's hand: move at ``drive`` of the gait's pace and ``turn``, both in [-1, 1], while it is repeated.

    Without another within ``session.DRIVE_FOR_S`` the robot stops; 0 lets go.
    """

    drive: float
    turn: float = 0.0


@dataclass(frozen=True, slots=True)
class EStop:
    """Latch the emergency stop and hold."""

    reason: str


@dataclass(frozen=True, slots=True)
class ResetEStop:
    """Clear the latch; never moves the robot."""


@dataclass(frozen=True, slots=True)
class Shutdown:
    """End the session."""


Command = SetGait | SetHead | Start | Stop | Drive | EStop | ResetEStop | Shutdown


@dataclass(frozen=True, slots=True)
class RobotShape:
    """What is needed to draw the robot."""

    model: str
    joint_count: int
    joint_length_m: float
    radius_m: float


@dataclass(frozen=True, slots=True)
class Started:
    """The session is built and runs; ``fov_y_rad``, ``aspect`` and ``T_IC`` (4, 4) are the camera's."""

    t_start_ns: int
    estimator_mode: str
    robot: RobotShape | None
    T_IC: Float
    fov_y_rad: float
    aspect: float
    gait: GaitCommand | None


@dataclass(frozen=True, slots=True)
class HeadMotion:
    """How still the head is, over the last period of the gait (``window_s``); None where it is not known.

    ``heading_deg`` is the mean heading in the estimate's world, ``yaw_deg`` the head's deviation from it now and
    ``yaw_rms_deg`` over the period; ``sway_m`` is the motion across the way, peak to peak.
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
class Tick:
    """The newest state, at most 20 times a second; ``commands_done`` counts the commands taken so far.

    ``T_WI`` (4, 4) is the estimate, ``Ts_WL`` (N + 1, 4, 4) the links that hang on it, ``T_WI_truth`` the truth brought
    to the estimate's first pose by yaw and translation, ``error_m`` the distance of the two. ``head`` is how still the
    head is, ``head_settings`` how it is held, ``notice`` what the operator should know of the gait, ``refusals`` the
    last commands that were not obeyed, ``governed`` the pace that the governor allows, None where it is off.
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


@dataclass(frozen=True, slots=True)
class Picture:
    """One camera frame as JPEG, and the features followed into it: rows of (x_px, y_px, inlier 0 or 1, id).

    ``roll_rad`` is how far the camera was rolled about its view, clockwise as it sees itself, None where not known.
    """

    t_ns: int
    seq: int
    width: int
    height: int
    tracks: tuple[tuple[float, float, int, int], ...]
    jpeg: bytes
    roll_rad: float | None = None


@dataclass(frozen=True, slots=True)
class Event:
    """Words for the timeline; ``level`` is info, warning or error."""

    t_ns: int
    level: str
    text: str


@dataclass(frozen=True, slots=True)
class Ended:
    """The session is over: a recording's end, a wish, or (``error``) a failure in one line."""

    error: str | None


Report = Started | Tick | Picture | MapChunk | Event | Ended
