"""The filter: a window of clones and landmarks that IMU spans move and followed features correct."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snakeslam.calibration import CameraCalibration, ImuCalibration
from snakeslam.estimation.filter.extrinsics import RATE_SPAN_S, free_mount, motion_by_time, motion_of_rows
from snakeslam.estimation.filter.gating import Innovation
from snakeslam.estimation.filter.ieskf import Measurement, update
from snakeslam.estimation.filter.imu_doubt import SILENT_ACCEL_M_S2, SILENT_RATE_RAD_S, MotionDoubt
from snakeslam.estimation.filter.preintegration import ImuSegments, preintegrate
from snakeslam.estimation.filter.state import BIAS_G, State, V
from snakeslam.estimation.frontend.tracking import FrontendFrame
from snakeslam.estimation.frontend.tracks import TrackTable, among
from snakeslam.estimation.gait.rows import Carried, GaitRows, GaitWay
from snakeslam.estimation.measurements.camera import CameraRows, Observations
from snakeslam.estimation.measurements.landmarks import Sightings
from snakeslam.estimation.measurements.projected_tracks import Features, promote
from snakeslam.estimation.measurements.zero_velocity import AtRest, Rest
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.estimation.vio.relocalisation import Place
from snakeslam.geometry.median import median
from snakeslam.messages import Float

MAX_REJECTIONS = 2
MIN_TRACK = 3
ENOUGH_WITH_DEPTH = 20
"""So many tracks with depth, and the window counts as one with depth."""


@dataclass(frozen=True, slots=True)
class Model:
    """What the filter knows of sensors and world: camera rows, IMU noise, gravity (3,), focal length in px, camera."""

    rows: CameraRows
    noise: ImuCalibration
    gravity_W: Float
    focal_px: float
    cam0: CameraCalibration

    @staticmethod
    def of(settings: EstimatorSettings, cam0: CameraCalibration, imu: ImuCalibration, focal_px: float) -> "Model":
        """Return the sensors' model with the settings' factors on the IMU's noise."""
        white, walk = settings.noise.imu_white_scale, settings.noise.imu_walk_scale
        noise = imu.model_copy(
            update={
                "gyroscope_noise_density": imu.gyroscope_noise_density * white,
                "accelerometer_noise_density": imu.accelerometer_noise_density * white,
                "gyroscope_random_walk": imu.gyroscope_random_walk * walk,
                "accelerometer_random_walk": imu.accelerometer_random_walk * walk,
            }
        )
        T_IC = cam0.T_IC
        rows = CameraRows(T_IC[:3, :3], T_IC[:3, 3], settings.noise.pixel_px / focal_px, settings.noise)
        gravity_W = np.array([0.0, 0.0, -settings.gravity_m_s2])
        return Model(rows, noise, gravity_W, focal_px, cam0)


@dataclass(frozen=True, slots=True)
class Report:
    """What one frame did: ids to follow no longer, innovations of all that was tried, what became of the gait's way."""

    refused: NDArray[np.int64]
    innovations: tuple[Innovation, ...]
    carried: Carried | None = None

    @staticmethod
    def none(carried: Carried | None = None) -> "Report":
        """Return that of a frame without a picture."""
        return Report(np.empty(0, np.int64), (), carried)


class SlidingWindow:
    """State, tracks and the order of events of one frame."""

    def __init__(self, state: State, settings: EstimatorSettings, model: Model) -> None:
        self.state = state
        self._settings = settings
        self._model = model
        self._tracks = TrackTable()
        self._rate: tuple[Float, float] | None = None
        self._doubted = False
        freed = free_mount(model.cam0, settings.calibration)
        if freed is not None:
            state.free_mount(*freed)

    def propagate(self, span: ImuSegments | None, t_ns: int, gap_s: float, doubt: MotionDoubt | None = None) -> None:
        """Move to ``t_ns`` by the IMU; less certain where that was silent for ``gap_s`` or is doubted."""
        if span is None:
            return
        state, model = self.state, self._model
        self._rate = span.last_rate(RATE_SPAN_S, model.noise)
        state.propagate(preintegrate(span, state.bias_g, state.bias_a, model.noise), t_ns, model.gravity_W)
        self._doubted = doubt is not None
        if doubt is not None:
            state.widen_motion(doubt.theta_rad**2, doubt.variance_v, doubt.lag_s)
        if gap_s > self._settings.health.max_imu_gap_s:
            blind_s = min(gap_s, float(span.dt_s.sum()))
            state.widen_motion((SILENT_RATE_RAD_S * blind_s) ** 2, (SILENT_ACCEL_M_S2 * blind_s) ** 2, 0.5 * blind_s)

    def vibrate(self, spread_m_s2: float, since_ns: int) -> None:
        """Widen the velocity by a vibration of this spread, which the noise model leaves out, for ``since_ns``."""
        variance = spread_m_s2**2 / self._model.noise.update_rate * since_ns * 1e-9
        if variance > 0.0:
            self.state.widen(V, variance)

    def correct(self, frame: FrontendFrame, rest: Rest | None = None, way: GaitWay | None = None) -> Report:
        """Take the features of a frame at the state's time, that the head is at rest when it is, the gait's way."""
        state, tracks = self.state, self._tracks
        state.add_clone(self._motion_by_time())
        state.keep_landmarks(among(state.landmarks.ids, frame.ids))
        self._let_landmarks_wander()
        free = ~among(frame.ids, state.landmarks.ids)
        flow = self._flow(frame)
        tracks.observe(frame.ids[free], frame.xy[free], frame.depth_m[free], frame.smear, flow[free])
        sightings, seen = self._sightings(frame, flow)
        lost = ~among(tracks.ids, frame.ids)
        leaving = self._leaving_clone()
        ripe = self._ripe(~lost, leaving == 0)
        if self._doubted:
            # What the camera has seen decides now on what the IMU cannot be trusted with.
            ripe |= ~lost & (tracks.lengths >= MIN_TRACK)
        chosen = (lost & (tracks.lengths >= MIN_TRACK)) | ripe
        features, tried = self._features(chosen)
        measurements: list[Measurement] = [m for m in (features, sightings) if len(m)]
        measurements += self._at_rest(rest, True)
        rows = GaitRows.of(way, len(state.clones) - 2) if way is not None else None
        taken = rows.gated(state, self._settings.gait.max_inflation) if rows is not None else None
        measurements += [taken] if taken is not None else []
        update(state, measurements, self._settings.max_iterations)
        carried = rows.carried(state, taken is not None) if rows is not None else None
        self._promote(features, tracks.ids[ripe])
        refused = self._refused(tracks.ids[ripe & tracks.has_depth], features)
        tracks.keep(~(lost | ripe))
        if leaving is not None:
            tracks.forget_column(leaving)
            state.drop_clone(leaving)
        return Report(refused, (seen, tried), carried)

    def hold(self, rest: Rest) -> None:
        """Take that the head is at rest, at a time without a picture of its own."""
        update(self.state, self._at_rest(rest, False), self._settings.max_iterations)

    def relocate(self, place: Place) -> bool:
        """Take a pose that was found again; return whether it is within its gate."""
        if not place.innovation(self.state).accepted.all():
            return False
        update(self.state, [place], self._settings.max_iterations)
        return True

    def carry(self, way: GaitWay) -> Report:
        """Take the velocity that the gait tells, at a time without a picture of its own."""
        rows = GaitRows.of(way, None)
        taken = rows.gated(self.state, self._settings.gait.max_inflation)
        if taken is not None:
            update(self.state, [taken], self._settings.max_iterations)
        return Report.none(rows.carried(self.state, taken is not None))

    def _at_rest(self, rest: Rest | None, has_clone: bool) -> list[AtRest]:
        if rest is None:
            return []
        rows = AtRest.of(rest, self.state, has_clone)
        return [rows] if rows.innovation(self.state).accepted.all() else []

    def _motion_by_time(self) -> Float | None:
        """Return how the pose changes with time, (6,), None at a start."""
        state = self.state
        if self._rate is None:
            return None
        rate_I, sigma = self._rate
        cov_rate = state.cov[BIAS_G, BIAS_G] + np.eye(3) * sigma**2
        return motion_by_time(rate_I - state.bias_g, cov_rate, state.v_W, state.cov[V, V])

    def _flow(self, frame: FrontendFrame) -> Float:
        """Return how the features of a frame move with a rolling shutter's readout, (N, 2) per second of it."""
        motion = self._motion_by_time()
        if motion is None or self.state.mount is None or not self.state.mount.frees_readout:
            return np.zeros((len(frame.ids), 2))
        return motion_of_rows(
            frame.xy, frame.px[:, 1] / self._model.cam0.resolution[1], self.state.mount.R_IC.T @ motion[:3]
        )

    def _let_landmarks_wander(self) -> None:
        """Widen landmarks by what their tracks creep from frame to frame: an error that no averaging takes away."""
        state = self.state
        far_m = np.linalg.norm(state.landmarks.p_W - state.p_WI, axis=1)
        state.widen_landmarks((self._settings.noise.track_drift_px / self._model.focal_px * far_m) ** 2)

    def _sightings(self, frame: FrontendFrame, flow: Float) -> tuple[Sightings, Innovation]:
        """Return the landmarks in view that pass the gate."""
        landmarks = self.state.landmarks
        _, at, index = np.intersect1d(frame.ids, landmarks.ids, assume_unique=True, return_indices=True)
        xyz = np.column_stack([frame.xy[at], frame.depth_m[at]])[:, None]
        rows = self._model.rows
        observed = Observations.weighed(xyz, np.ones((len(at), 1), bool), rows, frame.smear, flow[at][:, None])
        sightings = Sightings(index, observed, rows)
        if not len(at):
            return sightings, Innovation.none()
        innovation = sightings.innovation(self.state)
        inside = innovation.accepted
        landmarks.rejections[index] = np.where(inside, 0, landmarks.rejections[index] + 1)
        return sightings.pick(inside), innovation

    def _features(self, chosen: NDArray[np.bool_]) -> tuple[Features, Innovation]:
        """Return the chosen tracks as features that pass the gate."""
        tracks, rows = self._tracks, self._model.rows
        xyz, seen, flow = tracks.xyz[chosen], tracks.seen[chosen], tracks.flow[chosen]
        observed = Observations.weighed(xyz, seen, rows, tracks.smear, flow)
        features = Features.of(tracks.ids[chosen], observed, self.state, rows)
        if not len(features):
            return features, Innovation.none()
        innovation = features.innovation(self.state)
        return features.pick(innovation.accepted), innovation

    def _leaving_clone(self) -> int | None:
        """Return which clone leaves a full window.

        The last but one when little moved since the one before it, else the oldest, and with it all tracks that it saw
        are used. With depth less is enough: no far clones are needed to see a point from two sides.
        """
        if len(self.state.clones) <= self._settings.window.clones:
            return None
        tracks = self._tracks
        both = tracks.seen[:, -2] & tracks.seen[:, -3] & (tracks.lengths >= MIN_TRACK)
        if not both.any():
            return 0
        moved = tracks.xyz[both, -2, :2] - tracks.xyz[both, -3, :2]
        disparity_px = median(np.hypot(moved[:, 0], moved[:, 1])) * self._model.focal_px
        window = self._settings.window
        with_depth = np.count_nonzero(tracks.has_depth) >= ENOUGH_WITH_DEPTH
        least_px = window.keyframe_disparity_depth_px if with_depth else window.keyframe_disparity_px
        return len(self.state.clones) - 2 if disparity_px < least_px else 0

    def _ripe(self, living: NDArray[np.bool_], oldest_leaves: bool) -> NDArray[np.bool_]:
        """Return the living tracks to use now: those that the leaving clone saw, and candidates for landmarks."""
        tracks, lengths = self._tracks, self._tracks.lengths
        long = living & (lengths >= MIN_TRACK)
        ripe = long & tracks.seen[:, 0] & oldest_leaves
        room = self._settings.window.max_landmarks - len(self.state.landmarks)
        fresh = np.flatnonzero(long & ~ripe & tracks.has_depth)
        ripe[fresh[np.lexsort((tracks.ids[fresh], -lengths[fresh]))[: max(0, room)]]] = True
        return ripe

    def _promote(self, features: Features, candidates: NDArray[np.int64]) -> None:
        room = self._settings.window.max_landmarks - len(self.state.landmarks)
        chosen = among(features.ids, candidates)
        chosen &= np.cumsum(chosen) <= room
        if chosen.any():
            promote(self.state, features, chosen)

    def _refused(self, with_depth: NDArray[np.int64], features: Features) -> NDArray[np.int64]:
        """Drop landmarks that fail the gate again; return them, and the tracks with depth that were turned away."""
        landmarks = self.state.landmarks
        failing = landmarks.rejections >= MAX_REJECTIONS
        refused = np.concatenate([np.setdiff1d(with_depth, features.ids), landmarks.ids[failing]])
        self.state.keep_landmarks(~failing)
        return refused
