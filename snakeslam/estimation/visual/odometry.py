"""estimator.mode = visual: ORB features and RGB-D against a map of points; no IMU, no gait (the paper's baseline).

``VisualOdometry._process_frame`` is the algorithm: one frame from its features to the published pose, step by step.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from snakeslam.calibration import SensorRig
from snakeslam.errors import InputError
from snakeslam.estimation.base import FrameEstimate
from snakeslam.estimation.health import NEW_MAP, TIED, in_map
from snakeslam.estimation.imaging.camera import PinholeCamera
from snakeslam.estimation.imaging.roll_prior import RollPrior, with_roll
from snakeslam.estimation.measurements.settings import NoiseSettings
from snakeslam.estimation.orb_map.keyframe_map import OrbMap
from snakeslam.estimation.orb_map.matching import Matcher
from snakeslam.estimation.orb_map.orb import OrbExtractor
from snakeslam.estimation.orb_map.view import Match, OrbView, extract_view
from snakeslam.estimation.visual.settings import VisualSettings
from snakeslam.geometry import se3
from snakeslam.messages import CameraFrame, Float, Health, MapTie, Packet, PoseEstimate, Verdict

MIN_START_POINTS = 50
"""Features with depth that the first frame of a map must have."""
MIN_SHARE = 0.3
"""Least share of the matches that must be inliers."""
COAST_S = 0.3
"""Time for which the last velocity is extrapolated; after it the pose is held."""
MAX_OLD_MAPS = 4
"""Maps that are not connected to the present one and are kept to find it in them."""
TIE_EVERY_FRAMES = 10
"""While the present map is not connected, it is matched with the earlier ones every so many frames."""
NO_INDICES = np.empty(0, np.int64)
BLIND_SIGMA_M_S = 0.5
BLIND_SIGMA_RAD_S = 1.0
"""Growth of the sigmas of a prediction without an image, per second: about the speeds of the head."""
R_LEVEL_WC = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""A level camera whose optical axis is x of W: its x (right) is -y, its y (down) is -z."""


@dataclass(frozen=True, slots=True)
class _TrackedPose:
    """The last pose from an image: time, ``T_WC``, its covariance (6, 6), the twist (rho, theta) per second."""

    t_ns: int
    T_WC: Float
    cov: Float
    twist: Float

    def predict(self, t_ns: int, roll_rad: float | None) -> Float:
        """Return T_WC Exp(twist dt) at ``t_ns``, dt at most COAST_S, with the roll that control predicts, if any."""
        dt_s = min((t_ns - self.t_ns) / 1e9, COAST_S)
        step = se3.exp(self.twist * dt_s)
        if roll_rad is not None:
            step = se3.from_rt(with_roll(step[:3, :3], roll_rad), step[:3, 3])
        return self.T_WC @ step


class VisualOdometry:
    """Packets in, one estimate a frame out; all packets but camera frames are ignored."""

    def __init__(
        self, settings: VisualSettings, noise: NoiseSettings, max_blind_s: float, rig: SensorRig, seed: int
    ) -> None:
        self._settings = settings
        self._noise = noise
        self._max_blind_s = max_blind_s
        self._camera = PinholeCamera(rig.cam0)
        self._T_CI = rig.cam0.T_CI
        self._orb = OrbExtractor(settings)
        self._matcher = Matcher(settings, self._camera, seed)
        self._map = OrbMap(settings)
        self._last: _TrackedPose | None = None
        self._tracked_ns: int | None = None
        self._lost = False
        self._island, self._maps = 0, 0
        self._old: list[tuple[int, OrbMap]] = []
        """Earlier maps that are not connected to the present one, with their numbers."""
        self._since_tie = 0
        self._roll = RollPrior()
        self._gray: NDArray[np.uint8] | None = None

    def expect_roll(self, t_ns: int, roll_rad: float | None) -> None:
        """Add the roll that the gait is predicted to give the head."""
        self._roll.add(t_ns, roll_rad)

    def process(self, packet: Packet) -> FrameEstimate | None:
        """Process one packet; return an estimate for a camera frame; InputError when it has no depth."""
        if not isinstance(packet, CameraFrame):
            return None
        if packet.depth_m is None:
            raise InputError("estimator.mode", "'visual' needs depth, and these frames have none", "vio")
        return self._process_frame(packet)

    # -- The algorithm ------------------------------------------------------------------------------------------------

    def _process_frame(self, frame: CameraFrame) -> FrameEstimate:
        """Extract, predict, match, fit, update the map: one frame."""
        # 1. An image that repeats the one before contains no new information.
        frozen = self._gray is not None and bool(np.array_equal(self._gray, frame.gray))
        self._gray = frame.gray
        if frozen and self._last is not None:
            return self._blind(frame, None, ("the image does not change",))

        # 2. ORB features with depth. Their noise grows with the motion blur of the last rotation rate.
        rate_rad_s = 0.0 if self._last is None else float(np.linalg.norm(self._last.twist[3:]))
        view = extract_view(frame, self._orb, self._camera, self._noise, rate_rad_s)
        if self._last is None:
            return self._start(frame, view, ())
        last = self._last

        # 3. Match the map near the predicted pose T_WC Exp(twist dt) and fit T_WC to the matches; where that gives too
        #    few inliers, match by descriptors alone, wherever the camera may be.
        match = self._matcher.near(view, self._map, self._predict(last, frame.t_ns))
        if match is None or match.inlier_count < self._required:
            anywhere = self._matcher.anywhere(view, self._map)
            if anywhere is not None and anywhere.inlier_count >= self._settings.relocalise_inliers:
                match = anywhere

        # 4. Reject a pose with few inliers, a large covariance or an implausible motion.
        objections = self._objections(frame, last, match)
        if match is None or objections:
            return self._blind(frame, match, objections)
        events: tuple[str, ...] = ("relocalised",) if self._lost else ()

        # 5. A map that was begun anew may be found in an earlier one; then the pose is that of the earlier map.
        tie = self._tie(view, match.fit.T_WC)
        if tie is not None:
            last = replace(last, T_WC=tie[0].T @ last.T_WC)
            match, events = tie[1], (*events, TIED) if tie[0].into == 0 else events

        # 6. Velocity Log(T_last^-1 T) / dt, unless the last pose is too old. The covariance is that of the fit plus
        #    that of the keyframes to which the points belong.
        T_WC, dt_s = match.fit.T_WC, (frame.t_ns - last.t_ns) / 1e9
        coasted = frame.t_ns - last.t_ns > COAST_S * 1e9
        twist = np.zeros(6) if coasted else se3.log(se3.inv(last.T_WC) @ T_WC) / dt_s
        cov = match.fit.cov + self._map.keyframe_cov(match.point[match.fit.inliers], T_WC)
        published = _TrackedPose(frame.t_ns, T_WC, cov, twist)

        # 7. Update the map; a new keyframe adjusts its own pose as well, from which the next frame is predicted.
        self._last = replace(published, T_WC=self._update_map(view, match, cov))
        self._tracked_ns, self._lost = frame.t_ns, False

        # 8. Publish the pose of the IMU, p_WI = p_WC + R_WC p_CI, and its velocity.
        p_before, p_now = (T[:3, :3] @ self._T_CI[:3, 3] + T[:3, 3] for T in (last.T_WC, T_WC))
        velocity = np.zeros(3) if coasted else (p_now - p_before) / dt_s
        health = self._health(match, view)
        return self._estimate(frame, published, velocity, health, match, events, None if tie is None else tie[0])

    # -- Steps --------------------------------------------------------------------------------------------------------

    def _predict(self, last: _TrackedPose, t_ns: int) -> Float:
        return last.predict(t_ns, self._roll.between(last.t_ns, t_ns))

    def _start(self, frame: CameraFrame, view: OrbView, events: tuple[str, ...]) -> FrameEstimate:
        """Begin the first map at this frame, with a level camera and the IMU at the origin of W."""
        with_depth = int(np.count_nonzero(view.has_depth))
        if with_depth < MIN_START_POINTS:
            reason = f"few features with depth: {with_depth}"
            return _estimate(frame, None, Health(Verdict.INITIALISING, (reason,), with_depth), None, events)
        T_WC = se3.from_rt(R_LEVEL_WC, -R_LEVEL_WC @ self._T_CI[:3, 3])
        return self._begin(frame, view, T_WC, np.zeros((6, 6)), (*events, "initialised"))

    def _begin(
        self, frame: CameraFrame, view: OrbView, T_WC: Float, cov: Float, events: tuple[str, ...]
    ) -> FrameEstimate:
        """Begin a map whose first keyframe is this frame at ``T_WC``; earlier maps are kept to be tied to it."""
        if self._maps:
            self._old = [*self._old, (self._island, self._map)][-MAX_OLD_MAPS:]
            events = (*events, NEW_MAP)
        self._island, self._maps = self._maps, self._maps + 1
        self._map = OrbMap(self._settings)
        self._map.add_keyframe(T_WC, cov, view, NO_INDICES, NO_INDICES)
        self._last = _TrackedPose(frame.t_ns, T_WC, cov, np.zeros(6))
        self._tracked_ns, self._lost = frame.t_ns, False
        return self._estimate(
            frame, self._last, np.zeros(3), Health(Verdict.GOOD, (), self._map.points.count), None, events
        )

    @property
    def _required(self) -> int:
        """Inliers that a pose must have: more after a gap, when the prediction does not support it."""
        return self._settings.relocalise_inliers if self._lost else self._settings.min_inliers

    def _objections(self, frame: CameraFrame, last: _TrackedPose, match: Match | None) -> tuple[str, ...]:
        """Return why the pose of a match is rejected, in words; nothing if it is accepted."""
        settings = self._settings
        if match is None:
            return ("nothing in the image matches the map",)
        if match.inlier_count < self._required:
            return (f"few matches: {match.inlier_count}",)
        if match.inlier_count < MIN_SHARE * len(match.point):
            return (f"matches disagree: {len(match.point) - match.inlier_count} rejected",)
        sigma_m = float(np.sqrt(np.trace(match.fit.cov[:3, :3])))
        if not sigma_m < settings.max_sigma_m:
            return (f"the matches leave the position open to {sigma_m:.2f} m",)
        dt_s = (frame.t_ns - last.t_ns) / 1e9
        twist = se3.log(se3.inv(last.T_WC) @ match.fit.T_WC) / dt_s
        speed_m_s, rate_deg_s = np.linalg.norm(twist[:3]), np.rad2deg(np.linalg.norm(twist[3:]))
        if speed_m_s > settings.max_speed_m_s:
            return (f"implausible speed: {speed_m_s:.1f} m/s",)
        if rate_deg_s > settings.max_rate_deg_s:
            return (f"implausible rotation: {rate_deg_s:.0f} deg/s",)
        # With few inliers the distance from the prediction is bounded by an acceleration, sigma + a dt^2 / 2.
        off_m = float(np.linalg.norm(self._predict(last, frame.t_ns)[:3, 3] - match.fit.T_WC[:3, 3]))
        allowed_m = settings.max_sigma_m + 0.5 * settings.max_acceleration_m_s2 * dt_s**2
        if match.inlier_count < settings.few_inliers and off_m > allowed_m:
            return (f"few matches, {off_m:.2f} m from where they should be: {match.inlier_count}",)
        return ()

    def _tie(self, view: OrbView, T_WC: Float) -> tuple[MapTie, Match] | None:
        """Seek a frame of a map that is not connected in the earlier maps; continue in the one that matches it."""
        self._since_tie += 1
        if self._island == 0 or self._since_tie < TIE_EVERY_FRAMES:
            return None
        self._since_tie = 0
        for at, (island, known) in enumerate(self._old):
            match = self._matcher.anywhere(view, known)
            if match is None or match.inlier_count < max(
                self._settings.relocalise_inliers, MIN_SHARE * len(match.point)
            ):
                continue
            tie = MapTie(self._island, island, match.fit.T_WC @ se3.inv(T_WC))
            self._map, self._island = known, island
            del self._old[at]
            return tie, match
        return None

    def _update_map(self, view: OrbView, match: Match, cov: Float) -> Float:
        """Add the frame as a keyframe if its view is new; return T_WC, which the adjustment may have changed."""
        T_WC, inliers = match.fit.T_WC, match.fit.inliers
        self._map.points.count_frame(match.visible, match.point[inliers])
        if not self._map.is_new(T_WC, view, match.feature[inliers]):
            return T_WC
        before = self._matcher.seen_before(view, self._map, T_WC)
        return self._map.extend(T_WC, cov, view, match, before)

    def _health(self, match: Match, view: OrbView) -> Health:
        reasons: list[str] = []
        if match.inlier_count < self._settings.few_inliers:
            reasons.append(f"few matches: {match.inlier_count}")
        if len(view) < self._settings.features // 4:
            reasons.append(f"few features, the image is blurred or has no texture: {len(view)}")
        return Health(Verdict.DEGRADED if reasons else Verdict.GOOD, tuple(reasons), match.inlier_count)

    def _blind(self, frame: CameraFrame, match: Match | None, reasons: tuple[str, ...]) -> FrameEstimate:
        """Publish the prediction with the verdict blind; after ``max_blind_s`` begin a new map at the prediction."""
        assert self._last is not None
        assert self._tracked_ns is not None
        last, self._lost = self._last, True
        blind_s = (frame.t_ns - self._tracked_ns) / 1e9
        grown = np.diag([BLIND_SIGMA_M_S] * 3 + [BLIND_SIGMA_RAD_S] * 3) ** 2 * blind_s**2
        guess = replace(last, t_ns=frame.t_ns, T_WC=self._predict(last, frame.t_ns), cov=last.cov + grown)
        count = 0 if match is None else match.inlier_count
        if blind_s > self._max_blind_s:
            health = Health(Verdict.LOST, (*reasons, f"the map not found for {blind_s:.1f} s"), count)
            view = extract_view(frame, self._orb, self._camera, self._noise, 0.0)
            if np.count_nonzero(view.has_depth) >= MIN_START_POINTS:
                return self._begin(frame, view, guess.T_WC, guess.cov, ("reset",))
            return _estimate(frame, None, health, match, ())
        health = Health(Verdict.BLIND, reasons, count)
        return self._estimate(frame, guess, np.zeros(3), health, match, ())

    def _estimate(
        self,
        frame: CameraFrame,
        tracked: _TrackedPose,
        v_W: Float,
        health: Health,
        match: Match | None,
        events: tuple[str, ...],
        tie: MapTie | None = None,
    ) -> FrameEstimate:
        """Return the estimate of a tracked or predicted pose, with the number of its map."""
        health = in_map(health, self._island)
        estimate = _estimate(frame, self._pose(tracked, v_W, health), health, match, events)
        return replace(estimate, island=self._island, tie=tie)

    def _pose(self, tracked: _TrackedPose, v_W: Float, health: Health) -> PoseEstimate:
        """Return the pose of the IMU with its covariance, (rho, theta) of C reordered to (theta_I, p_W, v_W)."""
        T_WI = tracked.T_WC @ self._T_CI
        Ad_IC = se3.adjoint(se3.inv(self._T_CI))
        cov_I = Ad_IC @ tracked.cov @ Ad_IC.T
        R = T_WI[:3, :3]
        order = np.zeros((6, 6))
        order[:3, 3:], order[3:, :3] = np.eye(3), R
        cov = np.zeros((9, 9))
        cov[:6, :6] = order @ cov_I @ order.T
        cov[6:, 6:] = BLIND_SIGMA_M_S**2 * np.eye(3)
        return PoseEstimate(tracked.t_ns, T_WI, v_W, cov, health)


def _estimate(
    frame: CameraFrame, pose: PoseEstimate | None, health: Health, match: Match | None, events: tuple[str, ...]
) -> FrameEstimate:
    if match is None:
        tracks = (np.empty((0, 2), np.float32), np.empty(0, np.int64), np.empty(0, bool))
    else:
        tracks = (match.px, match.ids, match.fit.inliers)
    return FrameEstimate(frame.t_ns, frame.seq, pose, health, *tracks, events)
