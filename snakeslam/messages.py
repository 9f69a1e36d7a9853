"""The frozen types that cross packages: packets in, estimates, targets and map changes out.

Arrays are made read-only; times are integer nanoseconds; frames and units are in the names (CONTRIBUTING.md).
"""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from snakeslam.errors import BackendError

Float = NDArray[np.float64]


def _read_only(message: Any, dtypes: dict[str, type[np.generic]]) -> None:
    """Replace the named array fields by read-only arrays of the given type (None stays None)."""
    for name, dtype in dtypes.items():
        value = getattr(message, name)
        if value is None:
            continue
        array = np.asarray(value, dtype=dtype).view()
        array.flags.writeable = False
        object.__setattr__(message, name, array)


@dataclass(frozen=True, slots=True)
class ImuSample:
    """Mean angular rate ``gyro_I`` (3,) rad/s and specific force ``accel_I`` (3,) m/s^2 up to ``t_ns``."""

    t_ns: int
    gyro_I: Float
    accel_I: Float

    def __post_init__(self) -> None:
        _read_only(self, {"gyro_I": np.float64, "accel_I": np.float64})


@dataclass(frozen=True, slots=True)
class CameraFrame:
    """One exposure, stamped at its middle.

    ``gray`` (H, W) uint8; ``rgb`` (H, W, 3) uint8 or None; ``depth_m`` (H, W) float32 along the optical axis, 0 where
    unknown, registered to ``gray``, or None for a monocular camera.
    """

    t_ns: int
    seq: int
    gray: NDArray[np.uint8]
    rgb: NDArray[np.uint8] | None = None
    depth_m: NDArray[np.float32] | None = None
    exposure_ns: int = 0

    def __post_init__(self) -> None:
        _read_only(self, {"gray": np.uint8, "rgb": np.uint8, "depth_m": np.float32})


@dataclass(frozen=True, slots=True)
class CameraExposure:
    """What must be known of a simulated robot to draw one camera frame of it.

    ``Ts_WL`` (N + 1, 4, 4) are the poses of links 0..N, ``T_WI`` (4, 4) that of the IMU, ``w_C`` (3,) the camera's
    angular rate in rad/s.
    """

    t_ns: int
    seq: int
    Ts_WL: Float
    T_WI: Float
    w_C: Float

    def __post_init__(self) -> None:
        _read_only(self, dict.fromkeys(("Ts_WL", "T_WI", "w_C"), np.float64))


@dataclass(frozen=True, slots=True)
class JointState:
    """What the servos report, joints from tail to head, all (N,); a current or temperature that is unknown is NaN."""

    t_ns: int
    q_rad: Float
    dq_rad_s: Float
    current_a: Float
    temperature_degc: Float

    def __post_init__(self) -> None:
        _read_only(self, dict.fromkeys(("q_rad", "dq_rad_s", "current_a", "temperature_degc"), np.float64))


Packet = ImuSample | CameraFrame | JointState


def check_packet(packet: object) -> None:
    """Raise BackendError for what is no packet: nobody would read it, and its sensor would be lost without a word."""
    if not isinstance(packet, Packet):
        raise BackendError(f"a packet of the unknown type {type(packet).__name__}")


@dataclass(frozen=True, slots=True)
class GaitCommand:
    """What the operator asks for; a parameter that is not among ``parameters`` takes the configured value.

    ``drive`` in [-1, 1] scales the gait's rate (0 holds), ``turn`` in [-1, 1] is positive to the left.
    """

    t_ns: int
    gait: str
    drive: float = 1.0
    turn: float = 0.0
    parameters: dict[str, float] = field(default_factory=dict[str, float])


@dataclass(frozen=True, slots=True)
class HeadCommand:
    """What the operator asks of the head; None leaves a thing as it is.

    ``turn_by_deg`` rotates the head's reference line, and so steers the robot, positive to the left.
    """

    t_ns: int
    controller: str | None = None
    neck_joints: int | None = None
    turn_by_deg: float | None = None


@dataclass(frozen=True, slots=True)
class JointTarget:
    """Commanded joint angles ``q_rad`` (N,), tail to head.

    ``head_roll_rad`` is how far the gait has rolled the head about its view, None where the gait does not roll.
    """

    t_ns: int
    q_rad: Float
    head_roll_rad: float | None = None

    def __post_init__(self) -> None:
        _read_only(self, {"q_rad": np.float64})


class Verdict(StrEnum):
    """What the estimator says of itself for one frame."""

    INITIALISING = "initialising"
    GOOD = "good"
    DEGRADED = "degraded"
    BLIND = "blind"
    LOST = "lost"

    @property
    def tracked(self) -> bool:
        """Whether the pose of this frame rests on the camera."""
        return self in (Verdict.GOOD, Verdict.DEGRADED)


@dataclass(frozen=True, slots=True)
class Health:
    """A verdict with its reasons in words, for the operator.

    ``innovation`` is the median of the squared innovations over what is foreseen, None where too few were tried.
    ``map_connected`` is False after a new start whose map is not tied to the one before: the pose is good within the
    new map, and may be metres off in the old one.
    """

    verdict: Verdict
    reasons: tuple[str, ...] = ()
    tracks: int = 0
    innovation: float | None = None
    map_connected: bool = True


@dataclass(frozen=True, slots=True)
class MapTie:
    """Map ``island`` was found to be part of map ``into``: ``T`` (4, 4) brings what was published of it there."""

    island: int
    into: int
    T: Float

    def __post_init__(self) -> None:
        _read_only(self, {"T": np.float64})


@dataclass(frozen=True, slots=True)
class PoseEstimate:
    """Causal pose of the IMU in the world, as published.

    ``T_WI`` (4, 4), ``v_W`` (3,) m/s, ``cov`` (9, 9) of the right-perturbation error (theta_I, p_W, v_W).
    """

    t_ns: int
    T_WI: Float
    v_W: Float
    cov: Float
    health: Health

    def __post_init__(self) -> None:
        _read_only(self, {"T_WI": np.float64, "v_W": np.float64, "cov": np.float64})


@dataclass(frozen=True, slots=True)
class MapChunk:
    """Coloured points of one keyframe, in its camera's frame; a higher ``revision`` replaces a lower one.

    ``T_WK`` (4, 4), ``points_K`` (N, 3) float32 m, ``rgb`` (N, 3) uint8. ``island`` is 0 for the first map and all that
    is connected to it; another number is that of a map that is not tied to it yet.
    """

    key: int
    revision: int
    T_WK: Float
    points_K: NDArray[np.float32]
    rgb: NDArray[np.uint8]
    island: int = 0

    def __post_init__(self) -> None:
        _read_only(self, {"T_WK": np.float64, "points_K": np.float32, "rgb": np.uint8})


@dataclass(frozen=True, slots=True)
class SlamUpdate:
    """All that ``slam`` says of one camera frame.

    ``pose`` is None until initialised; ``tracks_px`` (N, 2) float32 with ``track_ids`` (N,) and ``track_inliers`` (N,)
    are for the overlay; ``chunks`` are new or revised; ``events`` are words for the timeline ("reset", ...). The pose
    is in map ``island``; ``tie`` says that the map of the frames before was found to be part of this one.
    """

    t_ns: int
    seq: int
    pose: PoseEstimate | None
    health: Health
    tracks_px: NDArray[np.float32]
    track_ids: NDArray[np.int64]
    track_inliers: NDArray[np.bool_]
    chunks: tuple[MapChunk, ...] = ()
    events: tuple[str, ...] = ()
    island: int = 0
    tie: MapTie | None = None

    def __post_init__(self) -> None:
        _read_only(self, {"tracks_px": np.float32, "track_ids": np.int64, "track_inliers": np.bool_})


@dataclass(frozen=True, slots=True)
class GroundTruth:
    """True motion of the IMU, for evaluation and the recorder only; what is unknown is None.

    Where ``orientation_known`` is False, ``T_WI`` has the identity for a rotation.
    """

    t_ns: int
    T_WI: Float
    v_W: Float | None = None
    gyro_bias_I: Float | None = None
    accel_bias_I: Float | None = None
    orientation_known: bool = True

    def __post_init__(self) -> None:
        _read_only(self, dict.fromkeys(("T_WI", "v_W", "gyro_bias_I", "accel_bias_I"), np.float64))
