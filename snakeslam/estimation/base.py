"""What every estimator offers: packets in, one estimate for every camera frame out."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from snakeslam.messages import Float, Health, MapTie, Packet, PoseEstimate


@dataclass(frozen=True, slots=True)
class FrameEstimate:
    """What an estimator says of one camera frame.

    ``pose`` is None until initialised; ``tracks_px`` (M, 2) with ``track_ids`` (M,) and ``track_inliers`` (M,) are the
    features followed into this frame; ``events`` are words for the timeline ("initialised", "reset", ...); ``T_IC`` is
    the camera on the IMU, None where it is as calibrated; ``island`` is the map that the pose is in, 0 the first one;
    ``tie`` says that the present map has just been found to be part of an earlier one.
    """

    t_ns: int
    seq: int
    pose: PoseEstimate | None
    health: Health
    tracks_px: NDArray[np.float32]
    track_ids: NDArray[np.int64]
    track_inliers: NDArray[np.bool_]
    events: tuple[str, ...] = ()
    T_IC: Float | None = None
    island: int = 0
    tie: MapTie | None = None


class Estimator(Protocol):
    """Turns packets, in time order, into poses; no clock, thread, file or socket."""

    def expect_roll(self, t_ns: int, roll_rad: float | None) -> None:
        """Take the head's roll about its view that the gait is to have at ``t_ns``, None while it does not roll."""
        ...

    def process(self, packet: Packet) -> FrameEstimate | None:
        """Take one packet; return an estimate for a camera frame and None for any other packet."""
        ...
