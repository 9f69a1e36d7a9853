"""estimator.mode = gait: the paper's motion models alone, without camera and IMU; ``planar`` must be better."""

import numpy as np

from snakeslam.errors import InputError
from snakeslam.estimation.base import FrameEstimate
from snakeslam.estimation.planar.poses import START_SIGMA, XY_YAW, rotate_theta, with_plane_pose
from snakeslam.estimation.planar.prediction import GaitPrediction
from snakeslam.estimation.planar.settings import PlanarSettings
from snakeslam.estimation.planar.state import PlanarState
from snakeslam.geometry import se3
from snakeslam.messages import CameraFrame, Health, JointState, Packet, PoseEstimate, Verdict
from snakeslam.robot.model import SnakeModel

UNOBSERVED_VARIANCE = 0.01
"""Variance of roll, pitch, height and velocity, of which the planar models say nothing."""


class GaitDeadReckoning:
    """Integrates the motion models from the origin; the body is assumed to lie flat."""

    def __init__(self, settings: PlanarSettings, model: SnakeModel | None) -> None:
        if model is None:
            raise InputError("estimator.mode", "'gait' needs a robot's joints, and here are none", "visual, vio")
        self._prediction = GaitPrediction(model, settings, raw=True)
        self._state: PlanarState | None = None

    def process(self, packet: Packet) -> FrameEstimate | None:
        """Process one packet; return an estimate for a camera frame, of a head that starts in the origin."""
        if isinstance(packet, JointState) and self._prediction.add(packet, self._state) and self._state is None:
            shape = self._prediction.shape(packet.t_ns, None)
            self._state = PlanarState.at(np.zeros(3), shape, np.diag(START_SIGMA**2))
            self._prediction.start(packet.t_ns)
        return self._estimate(packet) if isinstance(packet, CameraFrame) else None

    def expect_roll(self, t_ns: int, roll_rad: float | None) -> None:
        """Do nothing: only the measured joints are used."""

    def _estimate(self, frame: CameraFrame) -> FrameEstimate:
        no_tracks = np.empty((0, 2), np.float32), np.empty(0, np.int64), np.empty(0, bool)
        if self._state is None:
            health = Health(Verdict.INITIALISING, ("waiting for the joints",))
            return FrameEstimate(frame.t_ns, frame.seq, None, health, *no_tracks)
        self._prediction.propagate(self._state, frame.t_ns)
        head, cov_head = self._state.head(self._prediction.shape(frame.t_ns, None))
        T_WI = with_plane_pose(se3.from_rt(self._prediction.level_attitude(frame.t_ns), np.zeros(3)), head)
        cov_W = np.diag([UNOBSERVED_VARIANCE] * 9)
        cov_W[XY_YAW, XY_YAW] = 0.0
        cov_W[np.ix_(XY_YAW, XY_YAW)] += cov_head
        health = Health(Verdict.DEGRADED, ("dead reckoning on the gait alone",))
        pose = PoseEstimate(frame.t_ns, T_WI, np.zeros(3), rotate_theta(cov_W, T_WI[:3, :3].T), health)
        return FrameEstimate(frame.t_ns, frame.seq, pose, health, *no_tracks)
