"""The filter over a sliding window: the IMU propagates it, features, zero velocity and gait correct it.

``SlidingWindow.correct`` is the update of one frame, as in MSCKF with landmarks: a track that ends, or that the window
is about to lose, is used once, its point projected out; a few long tracks with depth stay in the state as landmarks.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snakeslam.calibration import CameraCalibration, ImuCalibration
from snakeslam.estimation.filter.extrinsics import RATE_SPAN_S, initial_extrinsics, pose_rate, readout_flow
from snakeslam.estimation.filter.gating import Innovation
from snakeslam.estimation.filter.ieskf import Measurement, update
from snakeslam.estimation.filter.imu_doubt import SILENT_ACCEL_M_S2, SILENT_RATE_RAD_S, MotionDoubt
from snakeslam.estimation.filter.preintegration import ImuSegments, preintegrate
from snakeslam.estimation.filter.state import BIAS_G, State, V
from snakeslam.estimation.frontend.tracking import TrackedFeatures
from snakeslam.estimation.frontend.tracks import TrackTable, among
from snakeslam.estimation.gait.measurement import FilterDisplacement, GaitDisplacement, GaitMeasurement
from snakeslam.estimation.measurements.camera import Observations, ReprojectionModel
from snakeslam.estimation.measurements.landmarks import LandmarkObservations
from snakeslam.estimation.measurements.projected_tracks import ProjectedTracks, promote
from snakeslam.estimation.measurements.zero_velocity import StationaryPeriod, ZeroVelocity
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.estimation.vio.relocalisation import MeasuredPosition
from snakeslam.geometry.median import median
from snakeslam.messages import Float

MAX_REJECTIONS = 2
"""A landmark that fails its gate so often in succession leaves the state, and its feature is tracked no longer."""
MIN_TRACK = 3
"""Frames that a track must have for its point to be triangulated with some redundancy."""
ENOUGH_WITH_DEPTH = 20
"""With so many tracks with depth the camera counts as an RGB-D camera."""


@dataclass(frozen=True, slots=True)
class SensorModel:
    """What the filter assumes of sensors and world: camera, its focal length in px, IMU noise, gravity (3,)."""

    camera: ReprojectionModel
    noise: ImuCalibration
    gravity_W: Float
    focal_px: float
    cam0: CameraCalibration

    @staticmethod
    def of(settings: EstimatorSettings, cam0: CameraCalibration, imu: ImuCalibration, focal_px: float) -> "SensorModel":
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
        camera = ReprojectionModel(T_IC[:3, :3], T_IC[:3, 3], settings.noise.pixel_px / focal_px, settings.noise)
        gravity_W = np.array([0.0, 0.0, -settings.gravity_m_s2])
        return SensorModel(camera, noise, gravity_W, focal_px, cam0)


@dataclass(frozen=True, slots=True)
class WindowUpdate:
    """Result of one frame: ids to track no longer, innovations of all features, what the filter made of the gait's."""

    refused: NDArray[np.int64]
    innovations: tuple[Innovation, ...]
    filter_displacement: FilterDisplacement | None = None

    @staticmethod
    def none(filter_displacement: FilterDisplacement | None = None) -> "WindowUpdate":
        """Return the result of a frame without an image of its own."""
        return WindowUpdate(np.empty(0, np.int64), (), filter_displacement)


class SlidingWindow:
    """State and tracks, and the updates of the one by the other."""

    def __init__(self, state: State, settings: EstimatorSettings, model: SensorModel) -> None:
        self.state = state
        self._settings = settings
        self._model = model
        self._tracks = TrackTable()
        self._rate: tuple[Float, float] | None = None
        """Mean angular rate at the end of the last IMU span, (3,) rad/s, and its sigma."""
        self._doubted = False
        freed = initial_extrinsics(model.cam0, settings.calibration)
        if freed is not None:
            state.add_extrinsics(*freed)

    # -- Propagation --------------------------------------------------------------------------------------------------

    def propagate(self, span: ImuSegments | None, t_ns: int, gap_s: float, doubt: MotionDoubt | None = None) -> None:
        """Propagate the state to ``t_ns`` by the IMU, Eq. (23)-(26).

        Where the IMU was silent for ``gap_s``, or its samples are doubted, the motion may have been any within the
        limits of a snake robot: Q grows by (w_max t)^2, (a_max t)^2 and what those make of the position.
        """
        if span is None:
            return
        state, model = self.state, self._model
        self._rate = span.last_rate(RATE_SPAN_S, model.noise)
        state.propagate(preintegrate(span, state.bias_g, state.bias_a, model.noise), t_ns, model.gravity_W)
        self._doubted = doubt is not None
        if doubt is not None:
            state.inflate_motion(doubt.theta_rad**2, doubt.variance_v, doubt.lag_s)
        if gap_s > self._settings.health.max_imu_gap_s:
            silent_s = min(gap_s, float(span.dt_s.sum()))
            state.inflate_motion(
                (SILENT_RATE_RAD_S * silent_s) ** 2, (SILENT_ACCEL_M_S2 * silent_s) ** 2, 0.5 * silent_s
            )

    def add_vibration(self, spread_m_s2: float, dt_ns: int) -> None:
        """Widen the velocity by a vibration of ``dt_ns``: white in each sample, sigma_v^2 = sigma_a^2 dt / f_IMU."""
        variance = spread_m_s2**2 / self._model.noise.update_rate * dt_ns * 1e-9
        if variance > 0.0:
            self.state.inflate(V, variance)

    # -- Correction ---------------------------------------------------------------------------------------------------

    def correct(
        self,
        frame: TrackedFeatures,
        stationary: StationaryPeriod | None = None,
        displacement: GaitDisplacement | None = None,
    ) -> WindowUpdate:
        """Correct the state by the features of a frame at the state's time, zero velocity and the gait."""
        state, tracks, settings = self.state, self._tracks, self._settings

        # 1. Clone the pose: x <- (x, T_WI), P <- J P J^T. Landmarks whose feature is no longer tracked leave the state.
        motion = self._pose_rate()
        state.add_clone(motion)
        state.keep_landmarks(among(state.landmarks.ids, frame.ids))

        # 2. A tracked feature drifts over its surface from frame to frame, an error that no averaging removes:
        #    P_landmark += (sigma_drift / f |p - p_WI|)^2 I.
        range_m = np.linalg.norm(state.landmarks.p_W - state.p_WI, axis=1)
        state.inflate_landmarks((settings.noise.track_drift_px / self._model.focal_px * range_m) ** 2)

        # 3. Features that are no landmarks go into the table of tracks, with the image motion of the rolling shutter.
        flow = self._readout_flow(frame, motion)
        is_track = ~among(frame.ids, state.landmarks.ids)
        tracks.add_frame(
            frame.ids[is_track], frame.xy[is_track], frame.depth_m[is_track], frame.motion_blur_rad, flow[is_track]
        )

        # 4. Choose the tracks to use: those that ended, those that the leaving clone sees, those to become landmarks.
        #    After doubtful IMU samples all of them, for the camera decides then.
        leaving = self._leaving_clone()
        ended = ~among(tracks.ids, frame.ids)
        long = tracks.lengths >= MIN_TRACK
        used = self._tracks_to_use(~ended, leaving == 0) | (~ended & long & self._doubted)

        # 5. Gate. r^T (H P H^T + R)^-1 r below the chi-square limit, for each track and each landmark.
        features, of_tracks = self._gated_tracks((ended & long) | used)
        landmarks, of_landmarks = self._gated_landmarks(frame, flow)
        measurements: list[Measurement] = [m for m in (features, landmarks) if len(m)]
        measurements += self._zero_velocity(stationary, True)
        gait = GaitMeasurement.of(displacement, len(state.clones) - 2) if displacement is not None else None
        gated_gait = gait.gated(state, settings.gait.max_inflation) if gait is not None else None
        measurements += [gated_gait] if gated_gait is not None else []

        # 6. Iterated update, Eq. (41), with all of them.
        update(state, measurements, settings.max_iterations)
        filter_displacement = gait.filter_displacement(state, gated_gait is not None) if gait is not None else None

        # 7. Long tracks with depth become landmarks while there is room; features that failed their gate are dropped.
        self._make_landmarks(features, tracks.ids[used])
        refused = self._drop_failing(tracks.ids[used & tracks.has_depth], features)

        # 8. Marginalise: forget the used tracks, and the clone that leaves a full window.
        tracks.keep(~(ended | used))
        if leaving is not None:
            tracks.drop_clone(leaving)
            state.drop_clone(leaving)
        return WindowUpdate(refused, (of_landmarks, of_tracks), filter_displacement)

    def correct_stationary(self, stationary: StationaryPeriod) -> None:
        """Correct by zero velocity alone, at a time without an image of its own."""
        update(self.state, self._zero_velocity(stationary, False), self._settings.max_iterations)

    def correct_gait(self, displacement: GaitDisplacement) -> WindowUpdate:
        """Correct by the gait's velocity alone, R^T v = v_I, at a time without an image of its own."""
        measurement = GaitMeasurement.of(displacement, None)
        gated = measurement.gated(self.state, self._settings.gait.max_inflation)
        if gated is not None:
            update(self.state, [gated], self._settings.max_iterations)
        return WindowUpdate.none(measurement.filter_displacement(self.state, gated is not None))

    def correct_position(self, position: MeasuredPosition) -> bool:
        """Correct by a position that was recognised; return whether it passed its gate."""
        if not position.innovation(self.state).accepted.all():
            return False
        update(self.state, [position], self._settings.max_iterations)
        return True

    # -- Measurements -------------------------------------------------------------------------------------------------

    def _zero_velocity(self, stationary: StationaryPeriod | None, has_clone: bool) -> list[ZeroVelocity]:
        if stationary is None:
            return []
        measurement = ZeroVelocity.of(stationary, self.state, has_clone)
        return [measurement] if measurement.innovation(self.state).accepted.all() else []

    def _pose_rate(self) -> Float | None:
        """Return the rate of the pose with time, d(theta, p)/dt (6,), for the camera's time offset; None at a start."""
        state = self.state
        if self._rate is None:
            return None
        rate_I, sigma = self._rate
        cov_rate = state.cov[BIAS_G, BIAS_G] + np.eye(3) * sigma**2
        return pose_rate(rate_I - state.bias_g, cov_rate, state.v_W, state.cov[V, V])

    def _readout_flow(self, frame: TrackedFeatures, motion: Float | None) -> Float:
        """Return how far a rolling shutter's readout of 1 s would move each feature, (N, 2) per second."""
        extrinsics = self.state.extrinsics
        if motion is None or extrinsics is None or not extrinsics.estimates_readout:
            return np.zeros((len(frame.ids), 2))
        row_share = frame.px[:, 1] / self._model.cam0.resolution[1]
        return readout_flow(frame.xy, row_share, extrinsics.R_IC.T @ motion[:3])

    def _gated_landmarks(self, frame: TrackedFeatures, flow: Float) -> tuple[LandmarkObservations, Innovation]:
        """Return the landmarks in view that pass their gate, and the innovations of all in view."""
        landmarks, camera = self.state.landmarks, self._model.camera
        _, at, index = np.intersect1d(frame.ids, landmarks.ids, assume_unique=True, return_indices=True)
        xyz = np.column_stack([frame.xy[at], frame.depth_m[at]])[:, None]
        observed = Observations.weighted(
            xyz, np.ones((len(at), 1), bool), camera, frame.motion_blur_rad, flow[at][:, None]
        )
        observations = LandmarkObservations(index, observed, camera)
        if not len(at):
            return observations, Innovation.none()
        innovation = observations.innovation(self.state)
        landmarks.rejections[index] = np.where(innovation.accepted, 0, landmarks.rejections[index] + 1)
        return observations.pick(innovation.accepted), innovation

    def _gated_tracks(self, chosen: NDArray[np.bool_]) -> tuple[ProjectedTracks, Innovation]:
        """Return the chosen tracks that pass their gate, and the innovations of all of them."""
        tracks, camera = self._tracks, self._model.camera
        xyz, seen, flow = tracks.xyz[chosen], tracks.seen[chosen], tracks.flow[chosen]
        observed = Observations.weighted(xyz, seen, camera, tracks.motion_blur_rad, flow)
        features = ProjectedTracks.of(tracks.ids[chosen], observed, self.state, camera)
        if not len(features):
            return features, Innovation.none()
        innovation = features.innovation(self.state)
        return features.pick(innovation.accepted), innovation

    # -- The window ---------------------------------------------------------------------------------------------------

    def _leaving_clone(self) -> int | None:
        """Return which clone leaves a full window; None while there is room.

        The last but one when the image moved little since the one before it, else the oldest, and with it all tracks
        that it sees are used. With depth a smaller motion is enough: triangulation needs no distant clones.
        """
        if len(self.state.clones) <= self._settings.window.clones:
            return None
        tracks = self._tracks
        in_both = tracks.seen[:, -2] & tracks.seen[:, -3] & (tracks.lengths >= MIN_TRACK)
        if not in_both.any():
            return 0
        moved = tracks.xyz[in_both, -2, :2] - tracks.xyz[in_both, -3, :2]
        disparity_px = median(np.hypot(moved[:, 0], moved[:, 1])) * self._model.focal_px
        window = self._settings.window
        with_depth = np.count_nonzero(tracks.has_depth) >= ENOUGH_WITH_DEPTH
        least_px = window.keyframe_disparity_depth_px if with_depth else window.keyframe_disparity_px
        return len(self.state.clones) - 2 if disparity_px < least_px else 0

    def _tracks_to_use(self, tracked: NDArray[np.bool_], oldest_leaves: bool) -> NDArray[np.bool_]:
        """Return the tracked ones to use now: what the oldest clone sees when it leaves, and the next landmarks."""
        tracks, lengths = self._tracks, self._tracks.lengths
        long = tracked & (lengths >= MIN_TRACK)
        used = long & tracks.seen[:, 0] & oldest_leaves
        capacity = self._settings.window.max_landmarks - len(self.state.landmarks)
        candidates = np.flatnonzero(long & ~used & tracks.has_depth)
        used[candidates[np.lexsort((tracks.ids[candidates], -lengths[candidates]))[: max(0, capacity)]]] = True
        return used

    def _make_landmarks(self, features: ProjectedTracks, candidates: NDArray[np.int64]) -> None:
        capacity = self._settings.window.max_landmarks - len(self.state.landmarks)
        chosen = among(features.ids, candidates)
        chosen &= np.cumsum(chosen) <= capacity
        if chosen.any():
            promote(self.state, features, chosen)

    def _drop_failing(self, with_depth: NDArray[np.int64], features: ProjectedTracks) -> NDArray[np.int64]:
        """Drop landmarks that fail their gate again; return their ids and those of the refused tracks with depth."""
        landmarks = self.state.landmarks
        failing = landmarks.rejections >= MAX_REJECTIONS
        refused = np.concatenate([np.setdiff1d(with_depth, features.ids), landmarks.ids[failing]])
        self.state.keep_landmarks(~failing)
        return refused
