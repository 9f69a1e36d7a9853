"""estimator.mode = planar: the paper's 5-D filter, Eq. (37)-(41), over the poses of ``vio`` and the gait's motion
model.  ``PlanarOdometry._process_frame`` is the algorithm. The pose of ``vio`` contains the IMU, so the prediction
does not use it: it is the gait's alone. The errors of the observed poses have a common part, the drift of ``vio``, and
a small independent one. Only the latter is the noise of Eq. (39); the drift is added to the published covariance,
P_head + drift, so that it does not shrink by being observed again and again."""

from dataclasses import replace

import numpy as np

from snakeslam.errors import InputError
from snakeslam.estimation.base import Estimator, FrameEstimate
from snakeslam.estimation.health import NEW_MAP, TIED
from snakeslam.estimation.planar.alignment import WorldAlignment
from snakeslam.estimation.planar.poses import START_SIGMA, XY_YAW, plane_pose, rotate_theta, with_plane_pose
from snakeslam.estimation.planar.prediction import GaitPrediction
from snakeslam.estimation.planar.settings import PlanarSettings
from snakeslam.estimation.planar.state import PlanarState
from snakeslam.messages import CameraFrame, Health, JointState, Packet, PoseEstimate, Verdict
from snakeslam.robot.model import SnakeModel

BLOCK = np.ix_(XY_YAW, XY_YAW)


class PlanarOdometry:
    """Packets in, one estimate a frame out: x, y and yaw are the filter's; z, roll and pitch those of ``vio``."""

    def __init__(self, settings: PlanarSettings, max_iterations: int, vio: Estimator, model: SnakeModel | None) -> None:
        if model is None:
            raise InputError("estimator.mode", "'planar' needs a robot's joints, and here are none", "visual, vio")
        self._settings = settings
        self._iterations = max_iterations
        self._vio = vio
        self._prediction = GaitPrediction(model, settings)
        self._state: PlanarState | None = None
        self._alignment = WorldAlignment(np.zeros(3), np.zeros((3, 3)))
        self._drift = np.zeros((3, 3))
        """Covariance of x, y and yaw of ``vio`` when a frame last supported it."""
        self._last: PoseEstimate | None = None
        self._restarted = False

    def process(self, packet: Packet) -> FrameEstimate | None:
        """Process one packet; return an estimate for a camera frame."""
        if isinstance(packet, JointState):
            self._prediction.add(packet, self._state)
        estimate = self._vio.process(packet)
        if estimate is None or not isinstance(packet, CameraFrame):
            return None
        return self._process_frame(packet.t_ns, estimate)

    def expect_roll(self, t_ns: int, roll_rad: float | None) -> None:
        """Pass the predicted roll of the head to ``vio``."""
        self._vio.expect_roll(t_ns, roll_rad)

    def _process_frame(self, t_ns: int, estimate: FrameEstimate) -> FrameEstimate:
        """Predict by the gait, correct by the pose of ``vio``, publish: one frame."""
        if not self._prediction.ready or (self._state is None and estimate.pose is None):
            return estimate
        # After a new start of ``vio`` the prediction goes on, so that all is one map here.
        self._restarted |= "reset" in estimate.events or estimate.tie is not None
        estimate = _in_one_map(estimate)

        # 1. Prediction, Eq. (38) and (40), from the last joint state to the time of the frame.
        if self._state is not None:
            self._prediction.propagate(self._state, t_ns)
        vio = estimate.pose
        if vio is None:
            return self._dead_reckoned(t_ns, estimate)

        # 2. The first pose defines the state; a pose after a new start of ``vio`` only aligns its world.
        shape = self._prediction.shape(vio.t_ns, vio.T_WI[:3, :3])
        if self._state is None:
            self._state = PlanarState.at(plane_pose(vio.T_WI), shape, np.diag(START_SIGMA**2))
            self._prediction.start(vio.t_ns)
        state = self._state
        if self._restarted:
            self._restarted = False
            self._alignment = self._alignment.realigned(plane_pose(vio.T_WI), *state.head(shape), self._drift)

        # 3. Noise of the observation: R = diag(sigma^2) + the growth of the covariance of ``vio`` since a frame last
        #    supported it, positive part.
        cov_W = rotate_theta(vio.cov, vio.T_WI[:3, :3])
        cov_vio = cov_W[BLOCK]
        if estimate.health.verdict.tracked or self._last is None:
            self._drift = cov_vio
        growth = cov_vio - self._drift
        values, vectors = np.linalg.eigh(0.5 * (growth + growth.T))
        pose_m, pose_rad = self._settings.pose_m, np.deg2rad(self._settings.pose_deg)
        R = np.diag([pose_m**2, pose_m**2, pose_rad**2]) + vectors * np.maximum(values, 0.0) @ vectors.T

        # 4. Correction by z = (x, y, yaw) of the head, Eq. (39) and (41).
        T_WI = self._alignment.T @ vio.T_WI
        state.update(plane_pose(T_WI), R, shape, self._iterations)

        # 5. Publish the head's pose with P_head + drift + alignment, in x, y and yaw; the rest is that of ``vio``.
        head, cov_head = state.head(shape)
        T_WI = with_plane_pose(T_WI, head)
        A = np.eye(9)
        for at in (slice(0, 3), slice(3, 6), slice(6, 9)):
            A[at, at] = self._alignment.T[:3, :3]
        cov = A @ cov_W @ A.T
        if not np.array_equal(cov_vio, self._drift):
            cov[XY_YAW] = 0.0
            cov[:, XY_YAW] = 0.0
            cov[BLOCK] += A[BLOCK] @ self._drift @ A[BLOCK].T
        cov[BLOCK] += cov_head + self._alignment.cov_at(head)
        v_W = self._alignment.T[:3, :3] @ vio.v_W
        self._last = PoseEstimate(vio.t_ns, T_WI, v_W, rotate_theta(cov, T_WI[:3, :3].T), estimate.health)
        return _with_pose(estimate, self._last, estimate.health)

    def _dead_reckoned(self, t_ns: int, estimate: FrameEstimate) -> FrameEstimate:
        """Return the estimate with the pose predicted by the gait, while ``vio`` has none."""
        if self._state is None or self._last is None or t_ns <= self._last.t_ns:
            return estimate
        last = self._last
        head, cov_head = self._state.head(self._prediction.shape(t_ns, last.T_WI[:3, :3]))
        T_WI = with_plane_pose(last.T_WI, head)
        cov_W = rotate_theta(last.cov, last.T_WI[:3, :3])
        cov_W[BLOCK] += cov_head
        health = Health(Verdict.BLIND, (*estimate.health.reasons, "dead reckoning on the gait"), estimate.health.tracks)
        pose = PoseEstimate(t_ns, T_WI, last.v_W, rotate_theta(cov_W, T_WI[:3, :3].T), health)
        return _with_pose(estimate, pose, health)


def _in_one_map(estimate: FrameEstimate) -> FrameEstimate:
    """Return the estimate without the numbers, reasons and events of the maps of ``vio``."""
    if estimate.island == 0 and estimate.tie is None:
        return estimate
    health = estimate.health
    reasons = tuple(reason for reason in health.reasons if reason != NEW_MAP)
    good = health.verdict is Verdict.DEGRADED and not reasons
    health = replace(health, verdict=Verdict.GOOD if good else health.verdict, reasons=reasons, map_connected=True)
    events = tuple(event for event in estimate.events if event not in (NEW_MAP, TIED))
    return replace(estimate, health=health, events=events, island=0, tie=None)


def _with_pose(estimate: FrameEstimate, pose: PoseEstimate, health: Health) -> FrameEstimate:
    """Return the estimate with another pose and verdict; extrinsics are left out, they belong to ``vio``."""
    return FrameEstimate(
        estimate.t_ns,
        estimate.seq,
        pose,
        health,
        estimate.tracks_px,
        estimate.track_ids,
        estimate.track_inliers,
        estimate.events,
    )
