"""estimator.mode = visual: ORB features and depth against a map of points; no IMU and no gait (the paper's baseline).

For each frame: predict by constant velocity, match what the frame before saw, then what the map should show, refine the
pose, average the points, take a keyframe when the view is new. Lost, it looks for itself in the keyframes.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snakeslam.calibration import SensorRig
from snakeslam.errors import InputError
from snakeslam.estimation.base import FrameEstimate
from snakeslam.estimation.camera import PinholeCamera
from snakeslam.estimation.local_map import LocalMap
from snakeslam.estimation.orb import OrbExtractor, OrbFeatures, match_anywhere, match_near
from snakeslam.estimation.pnp import PnpResult, ransac, refine
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.geometry import se3, so3
from snakeslam.messages import CameraFrame, Float, Health, Packet, PoseEstimate, Verdict

RANSAC_PX = 4.0
LEVEL_R_WC = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
MARGIN = 1.02


@dataclass(frozen=True, slots=True)
class _Track:
    """A frame that was placed: its pose and which features (rows) are which points."""

    t_ns: int
    T_WC: Float
    rows: NDArray[np.int64]
    points: NDArray[np.int64]


class VisualOdometry:
    """Packets in, one estimate a frame out; IMU samples are not looked at."""

    def __init__(self, settings: EstimatorSettings, rig: SensorRig, seed: int) -> None:
        self._settings, self._visual = settings, settings.visual
        self._camera = PinholeCamera(rig.cam0)
        self._sigma_xy = settings.noise.pixel_px * self._visual.pixel_scale / self._camera.focal_px
        self._extractor = OrbExtractor(self._visual.features, settings.frontend.fast_threshold, self._camera)
        self._T_CI = rig.cam0.T_CI
        self._seed = seed
        self._half_tan = MARGIN * np.abs(self._camera.normalise(np.zeros((1, 2), np.float32)))[0]
        self._map = LocalMap(settings.noise, self._sigma_xy)
        self._last: _Track | None = None
        self._before: _Track | None = None
        self._supported_ns = 0
        self._keyframe_rows = 0

    def process(self, packet: Packet) -> FrameEstimate | None:
        """Take one packet; return an estimate for a camera frame. InputError when the frame has no depth."""
        if not isinstance(packet, CameraFrame):
            return None
        if packet.depth_m is None:
            raise InputError("estimator.mode", "'visual' needs a depth image with every frame", "vio")
        if self._last is not None and packet.t_ns <= self._last.t_ns:
            return self._estimate(packet, None, None, Health(Verdict.BLIND, ("the frame's time goes back",)), ())
        features = self._extractor.extract(packet)
        if not len(self._map):
            return self._begin(packet, features, self._start_pose(), ("initialised",))
        return self._follow(packet, features)

    def _start_pose(self) -> Float:
        """Return the last pose, or for the first frame a level camera at the origin of the IMU."""
        if self._last is not None:
            return self._last.T_WC
        T_WC = se3.from_rt(LEVEL_R_WC, np.zeros(3))
        T_WC[:3, 3] = -(T_WC @ self._T_CI)[:3, 3]
        return T_WC

    def _begin(self, frame: CameraFrame, features: OrbFeatures, T_WC: Float, events: tuple[str, ...]) -> FrameEstimate:
        usable = int(np.sum(self._map.usable(features.depth_m)))
        if usable < self._visual.few_matches:
            health = Health(Verdict.INITIALISING, (f"few features with depth: {usable}",), usable)
            return self._estimate(frame, features, None, health, ())
        self._map = LocalMap(self._settings.noise, self._sigma_xy)
        self._map.add_keyframe(T_WC, features, np.full(len(features), -1))
        points = self._map.keyframes[-1].points
        rows = np.flatnonzero(points >= 0)
        self._keyframe_rows = len(rows)
        self._remember(_Track(frame.t_ns, T_WC, rows, points[rows]))
        result = PnpResult(T_WC, np.ones(len(rows), bool), np.eye(6) * 1e-8)
        return self._estimate(frame, features, result, Health(Verdict.GOOD, (), len(rows)), events)

    def _follow(self, frame: CameraFrame, features: OrbFeatures) -> FrameEstimate:
        events: tuple[str, ...] = ()
        start = self._near_the_last(frame.t_ns, features)
        if start is None:
            start = self._anywhere(features)
            events = ("relocalised",) if start is not None else ()
        placed = self._against_map(start, features) if start is not None else None
        if placed is None:
            return self._blind(frame, features)
        result, rows, points = placed
        rows, points = rows[result.inliers], points[result.inliers]
        health = self._judge(len(rows), len(result.inliers))
        if health.verdict is Verdict.GOOD:
            self._map.fuse(result.T_WC, features, rows, points)
        self._remember(_Track(frame.t_ns, result.T_WC, rows, points))
        if self._is_keyframe(len(rows), result.T_WC) and health.verdict is Verdict.GOOD:
            matched = np.full(len(features), -1)
            matched[rows] = points
            self._map.add_keyframe(result.T_WC, features, matched)
            self._keyframe_rows = len(rows)
        return self._estimate(frame, features, result, health, events)

    def _remember(self, track: _Track) -> None:
        self._before, self._last = self._last, track
        self._supported_ns = track.t_ns

    def _predicted(self, t_ns: int) -> Float:
        """Return the pose at constant velocity since the frames before."""
        last, before = self._last, self._before
        if last is None or before is None or last.t_ns - before.t_ns > self._visual.max_prediction_ns:
            return np.eye(4) if last is None else last.T_WC
        xi = se3.log(se3.inv(before.T_WC) @ last.T_WC) * ((t_ns - last.t_ns) / (last.t_ns - before.t_ns))
        return last.T_WC @ se3.exp(xi)

    def _near_the_last(self, t_ns: int, features: OrbFeatures) -> Float | None:
        """Return a pose from the points of the frame before, looked for in growing circles."""
        if self._last is None or t_ns - self._last.t_ns > self._visual.max_prediction_ns:
            return None
        predicted = self._predicted(t_ns)
        points = self._last.points
        px, ahead = self._project(predicted, self._map.p_W[points])
        points = points[ahead]
        for radius_px in self._visual.search_radii_px:
            k, rows = match_near(px, self._map.words[points], features, radius_px, self._visual.max_distance)
            if len(k) >= self._visual.few_matches:
                T_WC = self._ransac(points[k], features.xy[rows])
                if T_WC is not None:
                    return T_WC
        k, rows = match_anywhere(self._map.words[points], features, self._visual.max_distance)
        return self._ransac(points[k], features.xy[rows]) if len(k) >= self._visual.few_matches else None

    def _anywhere(self, features: OrbFeatures) -> Float | None:
        """Return a pose from the keyframe that shares most, newest first."""
        for keyframe in reversed(self._map.keyframes):
            own = np.flatnonzero(keyframe.points >= 0)
            points = keyframe.points[own]
            k, rows = match_anywhere(keyframe.features.words[own], features, self._visual.max_distance)
            if len(k) < 2 * self._visual.few_matches:
                continue
            T_WC = self._ransac(points[k], features.xy[rows])
            if T_WC is not None:
                return T_WC
        return None

    def _ransac(self, points: NDArray[np.int64], xy: Float) -> Float | None:
        return ransac(self._map.p_W[points], xy, RANSAC_PX / self._camera.focal_px, self._seed)

    def _project(self, T_WC: Float, p_W: Float) -> tuple[Float, NDArray[np.bool_]]:
        p_C = se3.act(se3.inv(T_WC), p_W)
        ahead = p_C[:, 2] > 0.1
        return self._camera.project(p_C[ahead]), ahead

    def _against_map(
        self, T_WC: Float, features: OrbFeatures
    ) -> tuple[PnpResult, NDArray[np.int64], NDArray[np.int64]] | None:
        """Return the refined pose from all points in view, with the features and points that it rests on."""
        rows = points = np.empty(0, np.int64)
        result: PnpResult | None = None
        for radius_px in self._visual.refine_radii_px:
            expected = self._map.in_view(T_WC, self._half_tan)
            px, ahead = self._project(T_WC, self._map.p_W[expected])
            expected = expected[ahead]
            k, rows = match_near(px, self._map.words[expected], features, radius_px, self._visual.max_distance)
            points = expected[k]
            if len(points) < self._visual.few_matches:
                return None
            result = refine(
                T_WC,
                self._map.p_W[points],
                features.xy[rows],
                features.depth_m[rows],
                self._sigma_xy,
                self._settings.noise,
            )
            T_WC = result.T_WC
            self._map.count(expected, points[result.inliers])
        if result is None or int(result.inliers.sum()) < self._visual.few_matches:
            return None
        return result, rows, points

    def _judge(self, used: int, matched: int) -> Health:
        reasons: list[str] = []
        if used < 2 * self._visual.few_matches:
            reasons.append(f"few matches: {used}")
        if used < 0.3 * matched:
            reasons.append(f"matches disagree: {matched - used} rejected")
        return Health(Verdict.DEGRADED if reasons else Verdict.GOOD, tuple(reasons), used)

    def _blind(self, frame: CameraFrame, features: OrbFeatures) -> FrameEstimate:
        blind_s = (frame.t_ns - self._supported_ns) / 1e9
        if blind_s > self._settings.health.max_blind_s:
            return self._begin(frame, features, self._start_pose(), ("reset",))
        health = Health(Verdict.BLIND, ("nothing of the map is recognised",))
        return self._estimate(frame, features, None, health, ())

    def _is_keyframe(self, used: int, T_WC: Float) -> bool:
        """Whether much of the last keyframe is out of view, or the camera has moved on."""
        near = se3.inv(self._map.keyframes[-1].T_WC) @ T_WC
        turned_deg = np.rad2deg(np.linalg.norm(so3.log(near[:3, :3])))
        moved_m = np.linalg.norm(near[:3, 3])
        return bool(
            used < self._visual.keyframe_ratio * self._keyframe_rows
            or turned_deg > self._visual.keyframe_angle_deg
            or moved_m > self._visual.keyframe_distance_m
        )

    def _estimate(
        self,
        frame: CameraFrame,
        features: OrbFeatures | None,
        result: PnpResult | None,
        health: Health,
        events: tuple[str, ...],
    ) -> FrameEstimate:
        pose = self._pose(frame.t_ns, result, health) if result is not None else None
        px = features.px if features is not None else np.empty((0, 2), np.float32)
        used = np.zeros(len(px), bool)
        ids = np.full(len(px), -1, np.int64)
        if result is not None and self._last is not None:
            used[self._last.rows] = True
            ids[self._last.rows] = self._last.points
        return FrameEstimate(frame.t_ns, frame.seq, pose, health, px, ids, used, events)

    def _pose(self, t_ns: int, result: PnpResult, health: Health) -> PoseEstimate:
        T_WI = result.T_WC @ self._T_CI
        # The camera's right perturbation (rho, theta) seen at the IMU, then its translation in W.
        M = se3.adjoint(se3.inv(self._T_CI)) @ result.cov @ se3.adjoint(se3.inv(self._T_CI)).T
        R = np.zeros((6, 6))
        R[:3, 3:], R[3:, :3] = np.eye(3), T_WI[:3, :3]
        cov = np.full((9, 9), 0.0)
        cov[:6, :6] = R @ M @ R.T
        cov[6:, 6:] = np.eye(3) * self._visual.unknown_speed_m_s**2
        return PoseEstimate(t_ns, T_WI, np.zeros(3), cov, health)
