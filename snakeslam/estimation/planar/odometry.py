"""estimator.mode = planar: the paper's 5-D filter over the poses of ``vio`` and the gait's motion model.

The pose of ``vio`` contains the IMU, so the prediction does not: it is the gait's alone. The observed poses err
together, by what ``vio`` has drifted, and apart, by a little noise. Only the noise is that of Eq. (39); the drift stays
in the published covariance, P_head + drift, and never shrinks by being observed again and again.
"""

from dataclasses import replace

import numpy as np

from snakeslam.errors import InputError
from snakeslam.estimation.base import Estimator, FrameEstimate
from snakeslam.estimation.health import NEW_MAP, TIED
from snakeslam.estimation.planar.motion import rotation
from snakeslam.estimation.planar.prediction import GaitPrediction
from snakeslam.estimation.planar.settings import PlanarSettings
from snakeslam.estimation.planar.state import PlanarState, wrapped
from snakeslam.geometry import se3, so3
from snakeslam.messages import CameraFrame, Float, Health, JointState, Packet, PoseEstimate, Verdict
from snakeslam.robot.model import SnakeModel

XY_YAW = [3, 4, 2]
"""Rows of x, y and yaw in a covariance of (theta_W, p_W, v_W)."""
START_SIGMA = np.array([1e-4, 1e-4, 1e-4, 0.1, 0.3])


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
        self._anchor = Anchor(np.zeros(3), np.zeros((3, 3)))
        self._drift = np.zeros((3, 3))
        self._last: PoseEstimate | None = None
        self._restarted = False

    def process(self, packet: Packet) -> FrameEstimate | None:
        """Take one packet; return an estimate for a camera frame."""
        if isinstance(packet, JointState):
            self._prediction.take(packet, self._state)
        estimate = self._vio.process(packet)
        return None if estimate is None or not isinstance(packet, CameraFrame) else self._fuse(packet.t_ns, estimate)

    def expect_roll(self, t_ns: int, roll_rad: float | None) -> None:
        """Hand on what control foresees of the head's roll."""
        self._vio.expect_roll(t_ns, roll_rad)

    def _fuse(self, t_ns: int, estimate: FrameEstimate) -> FrameEstimate:
        if not self._prediction.ready or (self._state is None and estimate.pose is None):
            return estimate
        # The gait's model carries the head over a new start of ``vio``, so that all is one map.
        self._restarted |= "reset" in estimate.events or estimate.tie is not None
        estimate = _in_one_map(estimate)
        if self._state is not None:
            self._prediction.bring(self._state, t_ns)
        if estimate.pose is None:
            return self._dead_reckoned(t_ns, estimate)
        pose = self._corrected(estimate.pose, estimate.health)
        return _with_pose(estimate, pose, estimate.health)

    def _corrected(self, vio: PoseEstimate, health: Health) -> PoseEstimate:
        """Update the filter with a pose of ``vio``, Eq. (41), and return the pose it then has."""
        shape = self._prediction.shape(vio.t_ns, vio.T_WI[:3, :3])
        if self._state is None:
            self._state = PlanarState.at(plane(vio.T_WI), shape, np.diag(START_SIGMA**2))
            self._prediction.start(vio.t_ns)
        state = self._state
        if self._restarted:
            self._restarted = False
            self._anchor = self._anchor.moved(plane(vio.T_WI), *state.head(shape), self._drift)
        cov_W = _turned(vio.cov, vio.T_WI[:3, :3])
        own = cov_W[np.ix_(XY_YAW, XY_YAW)]
        if health.verdict.tracked or self._last is None:
            self._drift = own
        T_WI = self._anchor.T @ vio.T_WI
        state.update(plane(T_WI), self._noise(own), shape, self._iterations)
        head, cov = state.head(shape)
        self._last = PoseEstimate(
            vio.t_ns,
            planted(T_WI, head),
            self._anchor.T[:3, :3] @ vio.v_W,
            self._published(cov_W, own, cov, head, planted(T_WI, head)[:3, :3]),
            health,
        )
        return self._last

    def _noise(self, own: Float) -> Float:
        """Return the observation's covariance R (3, 3): its noise, and what ``vio`` has lost since it last saw."""
        settings = self._settings
        growth = own - self._drift
        values, vectors = np.linalg.eigh(0.5 * (growth + growth.T))
        grown = vectors * np.maximum(values, 0.0) @ vectors.T
        return np.diag([settings.pose_m**2, settings.pose_m**2, np.deg2rad(settings.pose_deg) ** 2]) + grown

    def _published(self, cov_W: Float, own: Float, cov: Float, head: Float, R_WI: Float) -> Float:
        """Return the covariance (9, 9): that of ``vio``, its drift and the filter's own in x, y and yaw."""
        A = np.eye(9)
        for at in (slice(0, 3), slice(3, 6), slice(6, 9)):
            A[at, at] = self._anchor.T[:3, :3]
        total = A @ cov_W @ A.T
        if not np.array_equal(own, self._drift):
            total[XY_YAW] = 0.0
            total[:, XY_YAW] = 0.0
            B = A[np.ix_(XY_YAW, XY_YAW)]
            total[np.ix_(XY_YAW, XY_YAW)] += B @ self._drift @ B.T
        total[np.ix_(XY_YAW, XY_YAW)] += cov + self._anchor.cov_at(head)
        return _turned(total, R_WI.T)

    def _dead_reckoned(self, t_ns: int, estimate: FrameEstimate) -> FrameEstimate:
        """Return where the gait's model has brought the head while ``vio`` has no pose."""
        if self._state is None or self._last is None or t_ns <= self._last.t_ns:
            return estimate
        last = self._last
        head, cov = self._state.head(self._prediction.shape(t_ns, last.T_WI[:3, :3]))
        T_WI = planted(last.T_WI, head)
        cov_W = _turned(last.cov, last.T_WI[:3, :3])
        block = np.ix_(XY_YAW, XY_YAW)
        cov_W[block] += cov
        health = Health(Verdict.BLIND, (*estimate.health.reasons, "dead reckoning on the gait"), estimate.health.tracks)
        pose = PoseEstimate(t_ns, T_WI, last.v_W, _turned(cov_W, T_WI[:3, :3].T), health)
        return _with_pose(estimate, pose, health)


class Anchor:
    """Where the world of ``vio`` stands in the filter's: a yaw and a shift, that change when ``vio`` starts anew.

    ``cov`` (3, 3) is that of (x, y, yaw) of the head when it did, at ``head`` (3,).
    """

    def __init__(self, head: Float, cov: Float, T: Float | None = None) -> None:
        self.head, self.cov = head, cov
        self.T = np.eye(4) if T is None else T

    def moved(self, vio: Float, head: Float, cov: Float, drift: Float) -> "Anchor":
        """Return the anchor that brings ``vio`` (3,), the pose of the new start, to where the filter has the head."""
        turn = head[2] - vio[2]
        T = se3.from_rt(so3.from_yaw(turn), np.array([*(head[:2] - rotation(turn) @ vio[:2]), 0.0]))
        return Anchor(head, self.cov_at(head) + cov + drift, T)

    def cov_at(self, head: Float) -> Float:
        """Return ``cov`` as it bears upon a head that has gone on: a turn there is a shift here."""
        J = np.eye(3)
        J[:2, 2] = rotation(np.pi / 2.0) @ (head[:2] - self.head[:2])
        return J @ self.cov @ J.T


class GaitOdometry:
    """estimator.mode = gait: the paper's motion models alone, without camera and IMU; what ``planar`` is to better."""

    def __init__(self, settings: PlanarSettings, model: SnakeModel | None) -> None:
        if model is None:
            raise InputError("estimator.mode", "'gait' needs a robot's joints, and here are none", "visual, vio")
        self._prediction = GaitPrediction(model, settings, raw=True)
        self._state: PlanarState | None = None

    def process(self, packet: Packet) -> FrameEstimate | None:
        """Take one packet; return an estimate for a camera frame, of a head that starts in the origin."""
        if isinstance(packet, JointState) and self._prediction.take(packet, self._state) and self._state is None:
            shape = self._prediction.shape(packet.t_ns, None)
            self._state = PlanarState.at(np.zeros(3), shape, np.diag(START_SIGMA**2))
            self._prediction.start(packet.t_ns)
        return self._estimate(packet) if isinstance(packet, CameraFrame) else None

    def expect_roll(self, t_ns: int, roll_rad: float | None) -> None:
        """Commands have no part in it: the joints tell."""

    def _estimate(self, frame: CameraFrame) -> FrameEstimate:
        no_tracks = np.empty((0, 2), np.float32), np.empty(0, np.int64), np.empty(0, bool)
        if self._state is None:
            health = Health(Verdict.INITIALISING, ("waiting for the joints",))
            return FrameEstimate(frame.t_ns, frame.seq, None, health, *no_tracks)
        self._prediction.bring(self._state, frame.t_ns)
        head, cov = self._state.head(self._prediction.shape(frame.t_ns, None))
        T_WI = planted(se3.from_rt(self._prediction.level_attitude(frame.t_ns), np.zeros(3)), head)
        wide = np.diag([0.01, 0.01, 0.0, 0.0, 0.0, 0.01, 0.01, 0.01, 0.01])
        wide[np.ix_(XY_YAW, XY_YAW)] += cov
        health = Health(Verdict.DEGRADED, ("dead reckoning on the gait alone",))
        pose = PoseEstimate(frame.t_ns, T_WI, np.zeros(3), _turned(wide, T_WI[:3, :3].T), health)
        return FrameEstimate(frame.t_ns, frame.seq, pose, health, *no_tracks)


def plane(T_WI: Float) -> Float:
    """Return (x, y, yaw) of a pose."""
    return np.array([*T_WI[:2, 3], float(so3.yaw(T_WI[:3, :3]))])


def planted(T_WI: Float, head: Float) -> Float:
    """Return the pose with (x, y, yaw) ``head`` (3,) in place of its own."""
    turn = float(wrapped(head - plane(T_WI))[2])
    return se3.from_rt(so3.from_yaw(turn) @ T_WI[:3, :3], np.array([*head[:2], T_WI[2, 3]]))


def _turned(cov: Float, R: Float) -> Float:
    """Return a covariance of (theta, p, v) with theta turned by R: from I to W by R_WI, back by its transpose."""
    A = np.eye(9)
    A[:3, :3] = R
    return A @ cov @ A.T


def _in_one_map(estimate: FrameEstimate) -> FrameEstimate:
    """Return the estimate without what ``vio`` says of its maps."""
    if estimate.island == 0 and estimate.tie is None:
        return estimate
    health = estimate.health
    reasons = tuple(reason for reason in health.reasons if reason != NEW_MAP)
    good = health.verdict is Verdict.DEGRADED and not reasons
    health = replace(health, verdict=Verdict.GOOD if good else health.verdict, reasons=reasons, map_connected=True)
    events = tuple(event for event in estimate.events if event not in (NEW_MAP, TIED))
    return replace(estimate, health=health, events=events, island=0, tie=None)


def _with_pose(estimate: FrameEstimate, pose: PoseEstimate, health: Health) -> FrameEstimate:
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
