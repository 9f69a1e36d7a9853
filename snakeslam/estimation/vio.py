"""estimator.mode = vio: tightly coupled vision and IMU in an iterated error-state filter over a window of clones.

For each frame: propagate by the pre-integrated IMU, follow features, clone the pose, update with what left the window
or was lost and with the landmarks in view, shrink the window, judge.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snakeslam.calibration import ImuCalibration, SensorRig
from snakeslam.errors import InputError
from snakeslam.estimation.base import FrameEstimate
from snakeslam.estimation.camera import PinholeCamera
from snakeslam.estimation.frontend import Frontend, FrontendFrame
from snakeslam.estimation.health import Evidence, judge
from snakeslam.estimation.ieskf import Features, LandmarkSightings, promote, update
from snakeslam.estimation.initialise import start_moving, start_still
from snakeslam.estimation.measurements import CameraRows, Observations
from snakeslam.estimation.preintegration import ImuBuffer, preintegrate
from snakeslam.estimation.roll import RollPrior, with_roll
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.estimation.state import THETA, State, V
from snakeslam.estimation.tracks import Track, TrackStore
from snakeslam.geometry import so3
from snakeslam.messages import CameraFrame, Float, Health, ImuSample, Packet, PoseEstimate, Verdict

POSE_AND_VELOCITY = slice(0, 9)
STILL_DISPARITY_PX = 1.0
STILL_WINDOW_NS = 300_000_000
MOVING_START_NS = 700_000_000
MOVING_MEMORY_NS = 1_500_000_000
MAX_REJECTIONS = 2
MIN_TRACK = 3
GAP_ACCEL_M_S2 = 2.0
GAP_RATE_RAD_S = 1.0


@dataclass(frozen=True, slots=True)
class _Seen:
    """One frame's features at its time on the IMU's clock."""

    t_ns: int
    features: FrontendFrame


class VisualInertialOdometry:
    """Packets in, one estimate a frame out."""

    def __init__(self, settings: EstimatorSettings, rig: SensorRig, seed: int) -> None:
        if rig.imu0 is None:
            raise InputError("estimator.mode", "'vio' needs an IMU, and this recording has none", "visual")
        self._settings = settings
        self._noise = _scaled(rig.imu0, settings)
        self._camera = PinholeCamera(rig.cam0)
        T_IC = rig.cam0.T_IC
        self._rows = CameraRows(
            T_IC[:3, :3], T_IC[:3, 3], settings.noise.pixel_px / self._camera.focal_px, settings.noise
        )
        self._shift_ns = round(rig.cam0.timeshift_cam_imu * 1e9)
        self._gravity_W = np.array([0.0, 0.0, -settings.gravity_m_s2])
        self._frontend = Frontend(settings.frontend, self._camera, seed)
        self._imu = ImuBuffer(rig.imu0)
        self._tracks = TrackStore()
        self._state: State | None = None
        self._history: list[_Seen] = []
        self._last_ns: int | None = None
        self._last_imu_ns: int | None = None
        self._roll = RollPrior()
        self._bias_g = np.zeros(3)
        self._supported_ns = 0
        self._bad_samples = 0
        self._anchor: tuple[float, Float] = (0.0, np.zeros(3))

    def expect_roll(self, t_ns: int, roll_rad: float | None) -> None:
        """Take the roll that the gait is to give the head: a prior for features where the gyro fails."""
        self._roll.add(t_ns, roll_rad)

    def process(self, packet: Packet) -> FrameEstimate | None:
        """Take one packet; return an estimate for a camera frame."""
        if isinstance(packet, ImuSample):
            self._take_imu(packet)
        return self._take_frame(packet) if isinstance(packet, CameraFrame) else None

    def _take_imu(self, sample: ImuSample) -> None:
        late = self._last_imu_ns is not None and sample.t_ns <= self._last_imu_ns
        if late or not (np.all(np.isfinite(sample.gyro_I)) and np.all(np.isfinite(sample.accel_I))):
            self._bad_samples += 1
            return
        self._last_imu_ns = sample.t_ns
        self._imu.add(sample)

    def _take_frame(self, frame: CameraFrame) -> FrameEstimate:
        t_ns = frame.t_ns + self._shift_ns
        if self._last_ns is not None and t_ns <= self._last_ns:
            health = Health(Verdict.BLIND, ("the frame's time goes back",))
            return self._estimate(frame, None, None, health, ())
        gap_s = self._imu.longest_gap_s(self._last_ns, t_ns) if self._last_ns is not None else 0.0
        seen = _Seen(t_ns, self._frontend.process(frame, self._turn(t_ns)))
        self._last_ns = t_ns
        events: list[str] = []
        state = self._state
        used = self._try_to_start(seen, events) if state is None else self._advance(state, seen, gap_s)
        return self._conclude(frame, seen, used, gap_s, events)

    def _conclude(self, frame: CameraFrame, seen: _Seen, used: int, gap_s: float, events: list[str]) -> FrameEstimate:
        """Judge the frame; start anew when the filter is lost."""
        bad, self._bad_samples = self._bad_samples, 0
        state = self._state
        if state is None:
            return self._estimate(frame, seen, None, Health(Verdict.INITIALISING, ("waiting for a start",)), events)
        if used >= self._settings.health.min_features:
            self._supported_ns = seen.t_ns
        evidence = Evidence(
            used=used,
            rejected=len(seen.features.rejected_ids),
            cov_v=state.cov[V, V],
            blind_s=(seen.t_ns - self._supported_ns) / 1e9,
            frozen=seen.features.frozen,
            imu_gap_s=gap_s,
            bad_samples=bad,
        )
        health = judge(evidence, self._settings.health)
        self._imu.forget_before(state.t_ns)
        estimate = self._estimate(frame, seen, state, health, events)
        if health.verdict is Verdict.LOST:
            self._reset(state)
            return self._estimate(frame, seen, None, health, ("reset",))
        return estimate

    def _reset(self, state: State) -> None:
        """Forget everything but where the robot was last."""
        self._anchor = (float(so3.yaw(state.R_WI)), state.p_WI)
        self._bias_g = state.bias_g
        self._state = None
        self._history.clear()
        self._tracks.clear()

    def _turn(self, t_ns: int) -> Float:
        """Return how the camera has turned since the frame before, from the gyro."""
        span = self._imu.segments(self._last_ns, t_ns) if self._last_ns is not None else None
        if span is None:
            roll_rad = None if self._last_ns is None else self._roll.between(self._last_ns, t_ns)
            return np.eye(3) if roll_rad is None else with_roll(np.eye(3), -roll_rad)
        bias_g = self._bias_g if self._state is None else self._state.bias_g
        R_I0I1 = np.eye(3)
        for step in so3.exp((span.gyro_I - bias_g) * span.dt_s[:, None]):
            R_I0I1 = R_I0I1 @ step
        return self._rows.R_IC.T @ R_I0I1.T @ self._rows.R_IC

    # -- Start --------------------------------------------------------------------------------------------------------

    def _try_to_start(self, seen: _Seen, events: list[str]) -> int:
        """Start from rest, or from motion once there is enough of it; return the number of features in use."""
        self._history.append(seen)
        self._history = [s for s in self._history if s.t_ns >= seen.t_ns - MOVING_MEMORY_NS]
        self._imu.forget_before(self._history[0].t_ns - STILL_WINDOW_NS)
        still = self._start_still(seen)
        if still is not None:
            self._begin(still, events, "initialised at rest")
            return self._advance(still, seen, 0.0)
        return self._start_moving(seen, events)

    def _start_still(self, seen: _Seen) -> State | None:
        disparity = seen.features.disparity_px
        if disparity is None or disparity > STILL_DISPARITY_PX:
            return None
        recent = [s for s in self._imu.samples if s.t_ns > seen.t_ns - STILL_WINDOW_NS]
        return start_still(recent, seen.t_ns, self._settings.gravity_m_s2, self._noise)

    def _start_moving(self, seen: _Seen, events: list[str]) -> int:
        if seen.t_ns - self._history[0].t_ns < MOVING_START_NS:
            return 0
        store = TrackStore()
        for past in self._history:
            store.observe(past.t_ns, past.features.ids, past.features.xy, past.features.depth_m)
        times = [past.t_ns for past in self._history]
        state = start_moving(store.all(), times, self._imu, self._rows, self._noise, self._settings.gravity_m_s2)
        if state is None:
            return 0
        self._begin(state, events, "initialised in motion")
        used = 0
        for past in self._history:
            used = self._advance(state, past, 0.0)
        self._history.clear()
        return used

    def _begin(self, state: State, events: list[str], event: str) -> None:
        yaw_rad, p_W = self._anchor
        R = so3.from_yaw(yaw_rad)
        state.turn_world(R, p_W)
        self._state = state
        self._tracks.clear()
        events.append(event)
        self._supported_ns = state.t_ns

    # -- One frame ----------------------------------------------------------------------------------------------------

    def _advance(self, state: State, seen: _Seen, gap_s: float) -> int:
        """Bring the state to a frame and update it; return how many features support it."""
        self._propagate(state, seen.t_ns, gap_s)
        features = seen.features
        if features.frozen:
            return 0
        state.add_clone()
        alive = set(features.ids.tolist())
        in_state = {m.track_id: k for k, m in enumerate(state.landmarks)}
        gone = {track_id for track_id in in_state if track_id not in alive}
        state.drop_landmarks(gone)
        in_state = {m.track_id: k for k, m in enumerate(state.landmarks)}
        free = np.array([i not in in_state for i in features.ids.tolist()], dtype=bool)
        lost = [t for t in self._tracks.take_lost(alive) if t.length >= MIN_TRACK]
        self._tracks.observe(seen.t_ns, features.ids[free], features.xy[free], features.depth_m[free])
        sightings = self._sightings(state, features, in_state)
        return self._update(state, sightings, lost, len(features.ids))

    def _propagate(self, state: State, t_ns: int, gap_s: float) -> None:
        span = self._imu.segments(state.t_ns, t_ns)
        if span is None:
            return
        state.propagate(preintegrate(span, state.bias_g, state.bias_a, self._noise), t_ns, self._gravity_W)
        if gap_s > self._settings.health.max_imu_gap_s:
            blind_s = min(gap_s, span.dt_s.sum())
            state.widen(THETA, (GAP_RATE_RAD_S * blind_s) ** 2)
            state.widen(V, (GAP_ACCEL_M_S2 * blind_s) ** 2)

    def _sightings(self, state: State, features: FrontendFrame, in_state: dict[int, int]) -> LandmarkSightings:
        """Return the landmarks in view that pass the gate; one that fails twice is dropped."""
        where = [(k, in_state[i]) for k, i in enumerate(features.ids.tolist()) if i in in_state]
        if not where:
            return LandmarkSightings.none()
        at = np.array([k for k, _ in where])
        xyz = np.hstack([features.xy[at], features.depth_m[at, None]])[:, None]
        index = np.array([k for _, k in where], dtype=np.int64)
        sightings = LandmarkSightings(index, Observations.weighed(xyz, np.ones((len(at), 1), bool), self._rows))
        inside = sightings.within_gate(state, self._rows)
        for ok, k in zip(inside, index.tolist(), strict=True):
            landmark = state.landmarks[k]
            landmark.rejections = 0 if ok else landmark.rejections + 1
        return sightings.pick(inside)

    def _update(self, state: State, sightings: LandmarkSightings, lost: list[Track], in_view: int) -> int:
        full = len(state.clones) > self._settings.window.clones
        leaving = self._leaving_clone(state) if full else None
        ripe = self._ripe(state, 0 if leaving == 0 else None)
        chosen = [*lost, *ripe]
        features = Features.of(chosen, state, self._rows) if chosen else _no_features()
        update(state, features, sightings, self._rows, self._settings.max_iterations)
        self._promote(state, features, {t.track_id for t in ripe})
        self._drop_used(state, ripe, features)
        if leaving is not None:
            self._tracks.forget(state.clones[leaving].t_ns)
            state.drop_clone(leaving)
        return len(sightings.index) + len(features.tracks) or self._expected_support(in_view)

    def _expected_support(self, in_view: int) -> int:
        """Return what supports a frame on which no track has ended yet: the tracks that will."""
        return in_view if len(self._state.clones if self._state else ()) <= self._settings.window.clones else 0

    def _leaving_clone(self, state: State) -> int:
        """Return which clone leaves: the last but one when little moved since the one before it, else the oldest."""
        second, third = state.clones[-2].t_ns, state.clones[-3].t_ns
        moved: list[float] = []
        for track in self._tracks.all():
            if len(track.t_ns) >= 3 and second in track.t_ns and third in track.t_ns:
                a, b = track.xyz[track.t_ns.index(second)], track.xyz[track.t_ns.index(third)]
                moved.append(float(np.hypot(a[0] - b[0], a[1] - b[1])))
        if not moved:
            return 0
        disparity_px = float(np.median(moved)) * self._camera.focal_px
        return len(state.clones) - 2 if disparity_px < self._settings.window.keyframe_disparity_px else 0

    def _ripe(self, state: State, leaving: int | None) -> list[Track]:
        """Return the living tracks to use now: those that the leaving clone saw, and candidates for landmarks."""
        room = self._settings.window.max_landmarks - len(state.landmarks)
        oldest = state.clones[0].t_ns if leaving is not None else None
        ripe = [t for t in self._tracks.all() if t.length >= MIN_TRACK and oldest in t.t_ns]
        names = {t.track_id for t in ripe}
        with_depth = (t for t in self._tracks.all() if t.length >= MIN_TRACK and t.has_depth)
        fresh = sorted((t for t in with_depth if t.track_id not in names), key=lambda t: (-t.length, t.track_id))
        return ripe + fresh[: max(0, room)]

    def _promote(self, state: State, features: Features, candidates: set[int]) -> None:
        room = self._settings.window.max_landmarks - len(state.landmarks)
        chosen = np.array([t.track_id in candidates for t in features.tracks], dtype=bool)
        chosen &= np.cumsum(chosen) <= room
        if chosen.any():
            promote(state, features, chosen, self._rows)

    def _drop_used(self, state: State, ripe: list[Track], features: Features) -> None:
        """Forget observations that were used, and stop following what the gate turned away."""
        used = {t.track_id for t in features.tracks}
        refused = {t.track_id for t in ripe if t.track_id not in used and t.has_depth}
        failing = {m.track_id for m in state.landmarks if m.rejections >= MAX_REJECTIONS}
        state.drop_landmarks(failing)
        self._tracks.drop({t.track_id for t in ripe})
        self._frontend.drop(refused | failing)

    # -- Output -------------------------------------------------------------------------------------------------------

    def _estimate(
        self,
        frame: CameraFrame,
        seen: _Seen | None,
        state: State | None,
        health: Health,
        events: list[str] | tuple[str, ...],
    ) -> FrameEstimate:
        pose = None
        if state is not None:
            pose = PoseEstimate(
                frame.t_ns, state.T_WI, state.v_W, state.cov[POSE_AND_VELOCITY, POSE_AND_VELOCITY], health
            )
        px, ids, inliers = _overlay(seen.features if seen is not None else None)
        return FrameEstimate(frame.t_ns, frame.seq, pose, health, px, ids, inliers, tuple(events))


def _overlay(
    features: FrontendFrame | None,
) -> tuple[NDArray[np.float32], NDArray[np.int64], NDArray[np.bool_]]:
    if features is None:
        return np.empty((0, 2), np.float32), np.empty(0, np.int64), np.empty(0, bool)
    px = np.vstack([features.px, features.rejected_px])
    ids = np.concatenate([features.ids, features.rejected_ids])
    return px, ids, np.arange(len(ids)) < len(features.ids)


def _no_features() -> Features:
    return Features(
        [], Observations(np.empty((0, 0, 3)), np.empty((0, 0), bool), np.empty((0, 0, 3))), np.empty((0, 3))
    )


def _scaled(imu: ImuCalibration, settings: EstimatorSettings) -> ImuCalibration:
    """Return the IMU's noise with the settings' factors."""
    white, walk = settings.noise.imu_white_scale, settings.noise.imu_walk_scale
    return imu.model_copy(
        update={
            "gyroscope_noise_density": imu.gyroscope_noise_density * white,
            "accelerometer_noise_density": imu.accelerometer_noise_density * white,
            "gyroscope_random_walk": imu.gyroscope_random_walk * walk,
            "accelerometer_random_walk": imu.accelerometer_random_walk * walk,
        }
    )
