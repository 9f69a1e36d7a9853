"""The published estimate of one frame."""

import numpy as np
from numpy.typing import NDArray

from snakeslam.estimation.base import FrameEstimate
from snakeslam.estimation.filter.state import State
from snakeslam.estimation.frontend.tracking import TrackedFeatures
from snakeslam.estimation.health import in_map
from snakeslam.estimation.vio.starting import FrameFeatures
from snakeslam.geometry import se3
from snakeslam.messages import CameraFrame, Health, MapTie, PoseEstimate

POSE_AND_VELOCITY = slice(0, 9)


def frame_estimate(
    frame: CameraFrame,
    observed: FrameFeatures | None,
    state: State | None,
    health: Health,
    events: tuple[str, ...] = (),
    shift_ns: int = 0,
    island: int = 0,
    tie: MapTie | None = None,
) -> FrameEstimate:
    """Return the estimate of a frame; the pose is that of the exposure, by the estimated clock of the camera."""
    pose = None
    if state is not None:
        health = in_map(health, island)
        cov = state.cov[POSE_AND_VELOCITY, POSE_AND_VELOCITY].copy()
        pose = PoseEstimate(state.t_ns - shift_ns, state.T_WI, state.v_W.copy(), cov, health)
    px, ids, inliers = _overlay(observed.features if observed is not None else None)
    extrinsics = None if state is None else state.extrinsics
    T_IC = None if extrinsics is None else se3.from_rt(extrinsics.R_IC, extrinsics.p_IC)
    return FrameEstimate(frame.t_ns, frame.seq, pose, health, px, ids, inliers, events, T_IC, island, tie)


def _overlay(
    features: TrackedFeatures | None,
) -> tuple[NDArray[np.float32], NDArray[np.int64], NDArray[np.bool_]]:
    if features is None:
        return np.empty((0, 2), np.float32), np.empty(0, np.int64), np.empty(0, bool)
    px = np.vstack([features.px, features.rejected_px])
    ids = np.concatenate([features.ids, features.rejected_ids])
    return px, ids, np.arange(len(ids)) < len(features.ids)
