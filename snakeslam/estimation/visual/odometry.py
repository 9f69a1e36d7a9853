"""estimator.mode = visual: ORB features and RGB-D against a map of points; no IMU, no gait (the paper's baseline).

For each frame: find features, predict by constant velocity, match the map where it should appear, fit the pose, search
again closely, fit again, average what was seen into the map; where little is known, add a keyframe's points.
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
from snakeslam.estimation.orb_map.keyframe_map import VisualMap
from snakeslam.estimation.orb_map.matching import Matcher
from snakeslam.estimation.orb_map.orb import OrbExtractor
from snakeslam.estimation.orb_map.view import Match, View, look
from snakeslam.estimation.visual.settings import VisualSettings
from snakeslam.geometry import se3
from snakeslam.messages import CameraFrame, Float, Health, MapTie, Packet, PoseEstimate, Verdict

MIN_START_POINTS = 50
MIN_SHARE = 0.3
"""Part of the close matches that must agree."""
COAST_S = 0.3
MOST_OLD_MAPS = 4
TIE_EVERY_FRAMES = 10
"""While the present map is not connected, every so many frames the ones before are searched for it."""
NO_PAIRS = np.empty(0, np.int64)
BLIND_SIGMA_M_S = 0.5
BLIND_SIGMA_RAD_S = 1.0
R_LEVEL_WC = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""A level camera that looks along x of W: its x (right) is -y, its y (down) is -z."""


@dataclass(frozen=True, slots=True)
class _Track:
    """The last pose that rests on the picture: time, ``T_WC``, its covariance, the twist (rho, theta) per second."""

    t_ns: int
    T_WC: Float
    cov: Float
    twist: Float

    def predict(self, t_ns: int, roll_rad: float | None) -> Float:
        """Return T_WC at ``t_ns`` by constant velocity, held after ``COAST_S``; the roll as foreseen, if it was."""
        dt_s = min((t_ns - self.t_ns) / 1e9, COAST_S)
        step = se3.exp(self.twist * dt_s)
        if roll_rad is not None:
            step = se3.from_rt(with_roll(step[:3, :3], roll_rad), step[:3, 3])
        return self.T_WC @ step


class VisualOdometry:
    """Packets in, one estimate a frame out; all but camera frames is ignored."""

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
        self._map = VisualMap(settings)
        self._track: _Track | None = None
        self._tracked_ns: int | None = None
        self._lost = False
        self._island, self._maps = 0, 0
        self._old: list[tuple[int, VisualMap]] = []
        """Maps to which nothing ties the present one yet, with their numbers."""
        self._since_tie = 0
        self._roll = RollPrior()
        self._gray: NDArray[np.uint8] | None = None

    def expect_roll(self, t_ns: int, roll_rad: float | None) -> None:
        """Take the roll that the gait is to give the head."""
        self._roll.add(t_ns, roll_rad)

    def process(self, packet: Packet) -> FrameEstimate | None:
        """Take one packet; return an estimate for a camera frame; InputError when it has no depth."""
        if not isinstance(packet, CameraFrame):
            return None
        if packet.depth_m is None:
            raise InputError("estimator.mode", "'visual' needs depth, and these frames have none", "vio")
        frozen = self._gray is not None and bool(np.array_equal(self._gray, packet.gray))
        self._gray = packet.gray
        if frozen and self._track is not None:
            return self._blind(packet, None, ("the picture does not change",))
        rate_rad_s = 0.0 if self._track is None else float(np.linalg.norm(self._track.twist[3:]))
        view = look(packet, self._orb, self._camera, self._noise, rate_rad_s)
        if self._track is None:
            return self._start(packet, view, ())
        return self._follow(packet, view, self._track)

    def _predict(self, track: _Track, t_ns: int) -> Float:
        return track.predict(t_ns, self._roll.between(track.t_ns, t_ns))

    def _start(self, frame: CameraFrame, view: View, events: tuple[str, ...]) -> FrameEstimate:
        """Begin a map at this frame, where the last one ended or at the origin of W."""
        deep = int(np.count_nonzero(view.has_depth))
        if deep < MIN_START_POINTS:
            reason = f"few features with depth: {deep}"
            return _estimate(frame, None, Health(Verdict.INITIALISING, (reason,), deep), None, events)
        T_WC = se3.from_rt(R_LEVEL_WC, -R_LEVEL_WC @ self._T_CI[:3, 3])
        return self._begin(frame, view, T_WC, np.zeros((6, 6)), (*events, "initialised"))

    def _begin(self, frame: CameraFrame, view: View, T_WC: Float, cov: Float, events: tuple[str, ...]) -> FrameEstimate:
        if self._maps:
            self._old = [*self._old, (self._island, self._map)][-MOST_OLD_MAPS:]
            events = (*events, NEW_MAP)
        self._island, self._maps = self._maps, self._maps + 1
        self._map = VisualMap(self._settings)
        self._map.add_keyframe(T_WC, cov, view, NO_PAIRS, NO_PAIRS)
        self._track = _Track(frame.t_ns, T_WC, cov, np.zeros(6))
        self._tracked_ns, self._lost = frame.t_ns, False
        return self._estimate(
            frame, self._track, np.zeros(3), Health(Verdict.GOOD, (), self._map.points.count), None, events
        )

    def _follow(self, frame: CameraFrame, view: View, track: _Track) -> FrameEstimate:
        match = self._matcher.near(view, self._map, self._predict(track, frame.t_ns))
        if match is None or match.agreeing < self._required:
            wide = self._matcher.anywhere(view, self._map)
            if wide is not None and wide.agreeing >= self._settings.relocalise_inliers:
                match = wide
        reasons = self._objections(frame, track, match)
        if match is None or reasons:
            return self._blind(frame, match, reasons)
        return self._accept(frame, view, track, match, ("relocalised",) if self._lost else ())

    @property
    def _required(self) -> int:
        """Points that must agree: more after a gap, when the prediction vouches for nothing."""
        return self._settings.relocalise_inliers if self._lost else self._settings.min_inliers

    def _objections(self, frame: CameraFrame, track: _Track, match: Match | None) -> tuple[str, ...]:
        """Return why a fit is not to be believed, in words."""
        if match is None:
            return ("nothing in the picture matches the map",)
        if match.agreeing < self._required:
            return (f"few matches: {match.agreeing}",)
        if match.agreeing < MIN_SHARE * len(match.point):
            return (f"matches disagree: {len(match.point) - match.agreeing} rejected",)
        sigma_m = float(np.sqrt(np.trace(match.fit.cov[:3, :3])))
        if not sigma_m < self._settings.max_sigma_m:
            return (f"the matches leave the position open to {sigma_m:.2f} m",)
        return self._implausible(frame, track, match)

    def _implausible(self, frame: CameraFrame, track: _Track, match: Match) -> tuple[str, ...]:
        """Return what speaks against the motion since the last pose, or for few matches against the prediction."""
        dt_s = (frame.t_ns - track.t_ns) / 1e9
        moved = se3.log(se3.inv(track.T_WC) @ match.fit.T_WC) / dt_s
        speed_m_s, rate_deg_s = np.linalg.norm(moved[:3]), np.rad2deg(np.linalg.norm(moved[3:]))
        if speed_m_s > self._settings.max_speed_m_s:
            return (f"implausible speed: {speed_m_s:.1f} m/s",)
        if rate_deg_s > self._settings.max_rate_deg_s:
            return (f"implausible turn: {rate_deg_s:.0f} deg/s",)
        off_m = float(np.linalg.norm(self._predict(track, frame.t_ns)[:3, 3] - match.fit.T_WC[:3, 3]))
        allowed_m = self._settings.max_sigma_m + 0.5 * self._settings.max_acceleration_m_s2 * dt_s**2
        if match.agreeing < self._settings.few_inliers and off_m > allowed_m:
            return (f"few matches, {off_m:.2f} m from where they should be: {match.agreeing}",)
        return ()

    def _accept(
        self, frame: CameraFrame, view: View, track: _Track, match: Match, events: tuple[str, ...]
    ) -> FrameEstimate:
        tie = self._tie(view, match.fit.T_WC)
        if tie is not None:
            # Of this frame the old map is told, which the next one follows.
            track = replace(track, T_WC=tie[0].T @ track.T_WC)
            match, events = tie[1], (*events, TIED) if tie[0].into == 0 else events
        T_WC = match.fit.T_WC
        dt_s = (frame.t_ns - track.t_ns) / 1e9
        coasted = frame.t_ns - track.t_ns > COAST_S * 1e9
        twist = np.zeros(6) if coasted else se3.log(se3.inv(track.T_WC) @ T_WC) / dt_s
        cov = match.fit.cov + self._map.base_cov(match.point[match.fit.inliers], T_WC)
        published = _Track(frame.t_ns, T_WC, cov, twist)
        self._track = replace(published, T_WC=self._learn(view, match, cov))
        self._tracked_ns, self._lost = frame.t_ns, False
        health = self._health(match, view)
        p_before, p_now = (_imu_position(T, self._T_CI) for T in (track.T_WC, T_WC))
        velocity = np.zeros(3) if coasted else (p_now - p_before) / dt_s
        return self._estimate(frame, published, velocity, health, match, events, None if tie is None else tie[0])

    def _tie(self, view: View, T_WC: Float) -> tuple[MapTie, Match] | None:
        """Look for a frame of a map that is not connected in the maps before; go on in the one that it is found in."""
        self._since_tie += 1
        if self._island == 0 or self._since_tie < TIE_EVERY_FRAMES:
            return None
        self._since_tie = 0
        for at, (island, known) in enumerate(self._old):
            match = self._matcher.anywhere(view, known)
            if match is None or match.agreeing < max(self._settings.relocalise_inliers, MIN_SHARE * len(match.point)):
                continue
            tie = MapTie(self._island, island, match.fit.T_WC @ se3.inv(T_WC))
            self._map, self._island = known, island
            del self._old[at]
            return tie, match
        return None

    def _learn(self, view: View, match: Match, cov: Float) -> Float:
        """Take the frame into the map where it adds something; return T_WC, which that may have changed."""
        T_WC = match.fit.T_WC
        agreeing = match.fit.inliers
        self._map.points.count_frame(match.visible, match.point[agreeing])
        if not self._map.is_new(T_WC, view, match.feature[agreeing]):
            return T_WC
        before = self._matcher.seen_before(view, self._map, T_WC)
        return self._map.extend(T_WC, cov, view, match, before)

    def _health(self, match: Match, view: View) -> Health:
        reasons: list[str] = []
        if match.agreeing < self._settings.few_inliers:
            reasons.append(f"few matches: {match.agreeing}")
        if len(view) < self._settings.features // 4:
            reasons.append(f"few features, the picture is blurred or bare: {len(view)}")
        return Health(Verdict.DEGRADED if reasons else Verdict.GOOD, tuple(reasons), match.agreeing)

    def _blind(self, frame: CameraFrame, match: Match | None, reasons: tuple[str, ...]) -> FrameEstimate:
        """Publish the prediction, marked as such; too long without the map, start a new one where the last ended."""
        assert self._track is not None
        assert self._tracked_ns is not None
        track, self._lost = self._track, True
        blind_s = (frame.t_ns - self._tracked_ns) / 1e9
        grown = np.diag([BLIND_SIGMA_M_S] * 3 + [BLIND_SIGMA_RAD_S] * 3) ** 2 * blind_s**2
        guess = replace(track, t_ns=frame.t_ns, T_WC=self._predict(track, frame.t_ns), cov=track.cov + grown)
        count = 0 if match is None else match.agreeing
        if blind_s > self._max_blind_s:
            health = Health(Verdict.LOST, (*reasons, f"the map not found for {blind_s:.1f} s"), count)
            view = look(frame, self._orb, self._camera, self._noise, 0.0)
            if np.count_nonzero(view.has_depth) >= MIN_START_POINTS:
                return self._begin(frame, view, guess.T_WC, guess.cov, ("reset",))
            return _estimate(frame, None, health, match, ())
        health = Health(Verdict.BLIND, reasons, count)
        return self._estimate(frame, guess, np.zeros(3), health, match, ())

    def _estimate(
        self,
        frame: CameraFrame,
        track: _Track,
        v_W: Float,
        health: Health,
        match: Match | None,
        events: tuple[str, ...],
        tie: MapTie | None = None,
    ) -> FrameEstimate:
        """Publish a pose, with the map that it is in."""
        health = in_map(health, self._island)
        estimate = _estimate(frame, self._pose(track, v_W, health), health, match, events)
        return replace(estimate, island=self._island, tie=tie)

    def _pose(self, track: _Track, v_W: Float, health: Health) -> PoseEstimate:
        """Return the IMU's pose, its covariance in the order (theta_I, p_W, v_W)."""
        T_WI = track.T_WC @ self._T_CI
        Ad_IC = se3.adjoint(se3.inv(self._T_CI))
        cov_I = Ad_IC @ track.cov @ Ad_IC.T
        R = T_WI[:3, :3]
        order = np.zeros((6, 6))
        order[:3, 3:], order[3:, :3] = np.eye(3), R
        cov = np.zeros((9, 9))
        cov[:6, :6] = order @ cov_I @ order.T
        cov[6:, 6:] = BLIND_SIGMA_M_S**2 * np.eye(3)
        return PoseEstimate(track.t_ns, T_WI, v_W, cov, health)


def _imu_position(T_WC: Float, T_CI: Float) -> Float:
    return T_WC[:3, :3] @ T_CI[:3, 3] + T_WC[:3, 3]


def _estimate(
    frame: CameraFrame, pose: PoseEstimate | None, health: Health, match: Match | None, events: tuple[str, ...]
) -> FrameEstimate:
    if match is None:
        tracks = (np.empty((0, 2), np.float32), np.empty(0, np.int64), np.empty(0, bool))
    else:
        tracks = (match.px, match.ids, match.fit.inliers)
    return FrameEstimate(frame.t_ns, frame.seq, pose, health, *tracks, events)
