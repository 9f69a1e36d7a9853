"""The interface of every estimator: packets in, one estimate for every camera frame out."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from snakeslam.messages import Float, Health, MapTie, Packet, PoseEstimate


@dataclass(frozen=True, slots=True)
class FrameEstimate:
    """An estimator's result for one camera frame.

    ``pose`` is None until initialised; ``tracks_px`` (M, 2) with ``track_ids`` (M,) and ``track_inliers`` (M,) are the
    features tracked into this frame; ``events`` are words for the timeline ("initialised", "reset", ...); ``T_IC`` are
    the camera's extrinsics, None where they are as calibrated; ``island`` is the number of the map that the pose is in,
    0 for the first; ``tie`` is the transform that has just connected this map to an earlier one.
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
        """Add the head's predicted roll about its optical axis at ``t_ns``; None while the gait does not roll."""
        ...

    def process(self, packet: Packet) -> FrameEstimate | None:
        """Process one packet; return an estimate for a camera frame, None for any other packet."""

        ...
