"""When the filter starts: from a stationary head, or from a moving one once the motion is large enough.

Both starts integrate the IMU, so that only those frames count since which its samples have had no gap.
"""

from dataclasses import dataclass

import numpy as np

from snakeslam.estimation.filter.preintegration import ImuBuffer
from snakeslam.estimation.frontend.tracking import TrackedFeatures
from snakeslam.estimation.frontend.tracks import TrackTable
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.estimation.start.moving import start_moving
from snakeslam.estimation.start.plausibility import UNEXPLAINED, accelerometer_fault, gyro_fault, image_rotation
from snakeslam.estimation.start.stationary import TREMOR_S, StationaryImage, start_stationary
from snakeslam.estimation.vio.window import ENOUGH_WITH_DEPTH, SensorModel, SlidingWindow
from snakeslam.geometry.median import median
from snakeslam.messages import Float

STATIONARY_START, MOVING_START = "initialised, stationary", "initialised, in motion"
STATIONARY_PX, TREMOR_PX = 0.3, 3.0
"""Median motion of the features that a stationary camera may have: between two frames, and within STILL_WINDOW_NS."""
STATIONARY_WINDOW_NS = 450_000_000
MIN_COMMON = 10
"""Features that two frames must share for their median motion to count."""
MOVING_START_NS = 700_000_000
MOVING_START_DEPTH_NS = 300_000_000
"""Duration of the motion from which the start is computed. With depth it need not contain a baseline."""
MOVING_MEMORY_NS = 1_500_000_000
"""Frames older than this are not used: the gyro's bias and the tracks are not constant for longer."""
DOUBTS_AFTER_FRAMES, FRAMES_PER_DOUBT = 10, 5
"""After so many frames whose start in motion failed, units and axes are checked, once in so many frames."""
MISSED_SAMPLES = 3.0
"""So many sample periods without a sample are a gap, where that is longer than the settings' limit."""


@dataclass(frozen=True, slots=True)
class FrameFeatures:
    """One frame's features at its time on the IMU's clock."""

    t_ns: int
    features: TrackedFeatures


class Starter:
    """Collects the last frames until one of the two starts succeeds."""

    def __init__(self, settings: EstimatorSettings, model: SensorModel) -> None:
        self._settings = settings
        self._model = model
        self._max_gap_s = max(settings.health.max_imu_gap_s, MISSED_SAMPLES / model.noise.update_rate)
        self._history: list[FrameFeatures] = []
        self._stationary_since = 0
        """Index into the history: since that frame the image has not moved."""
        self.bias_g: Float | None = None
        """Mean gyro rate since the frame before, (3,) rad/s, where the image did not move: about the gyro's bias."""
        self.fault: str | None = None
        """The contradiction between IMU, extrinsics, image and gravity, for the operator; None while there is none."""
        self._waited_frames = 0

    @property
    def waits_long(self) -> bool:
        """Whether the start has failed so long that the gyro may be wrong and is not used to predict the image."""
        return self._waited_frames > DOUBTS_AFTER_FRAMES

    def try_to_start(self, observed: FrameFeatures, imu: ImuBuffer) -> tuple[SlidingWindow, str] | None:
        """Return a filter at the frame before its correction (stationary) or after it (in motion), and the event."""
        self._history.append(observed)
        covered_ns = imu.covered_since_ns(observed.t_ns, self._max_gap_s)
        if covered_ns is None:
            self._forget_before(observed.t_ns + 1)
        else:
            # The first sample also serves for the few periods before it.
            covered_ns -= round(MISSED_SAMPLES / self._model.noise.update_rate * 1e9)
            self._forget_before(max(observed.t_ns - MOVING_MEMORY_NS, covered_ns))
        if not self._history:
            imu.forget_before(observed.t_ns - STATIONARY_WINDOW_NS)
            return None
        imu.forget_before(self._history[0].t_ns - STATIONARY_WINDOW_NS)
        self._update_stationary_time(imu)
        if self._find_fault(observed, imu):
            return None
        return self._start_stationary(observed, imu) or self._start_moving(observed, imu)

    def _find_fault(self, observed: FrameFeatures, imu: ImuBuffer) -> bool:
        """Check units, signs and axes of the IMU; return whether no start is possible with them."""
        fault = accelerometer_fault(imu.recent(self._history[0].t_ns), self._settings.gravity_m_s2)
        self._waited_frames += observed.t_ns - self._history[0].t_ns >= MOVING_START_NS
        if fault is not None:
            self.fault = fault
        elif self._waited_frames > DOUBTS_AFTER_FRAMES and self._waited_frames % FRAMES_PER_DOUBT == 0:
            self.fault = self._gyro_fault(imu) or self._sign_fault(imu)
        elif self._waited_frames <= DOUBTS_AFTER_FRAMES:
            self.fault = None
        return fault is not None

    def _gyro_fault(self, imu: ImuBuffer) -> str | None:
        """Compare the gyro's rotation with the image's, over spans of the history."""
        R_CI, history = self._model.camera.R_IC.T, self._history
        stride = max(1, len(history) // 6)
        by_image: list[Float] = []
        by_gyro: list[Float] = []
        spans_s: list[float] = []
        for before, now in zip(history[::stride], history[stride::stride], strict=False):
            a, b = before.features, now.features
            _, then, at = np.intersect1d(a.ids, b.ids, assume_unique=True, return_indices=True)
            rotation = image_rotation(a.xy[then], b.xy[at])
            span = imu.segments(before.t_ns, now.t_ns)
            if rotation is None or span is None:
                continue
            by_image.append(rotation)
            # The sum of w dt is about the rotation vector over a fraction of a second, and also holds in another unit.
            by_gyro.append(R_CI @ (span.dt_s @ span.gyro_I))
            spans_s.append(float(span.dt_s.sum()))
        if not spans_s:
            return None
        return gyro_fault(np.array(by_image), np.array(by_gyro), R_CI, float(np.mean(spans_s)))

    def _sign_fault(self, imu: ImuBuffer) -> str | None:
        """Try the start in motion with the accelerometer's sign reversed."""
        model, times = self._model, [past.t_ns for past in self._history]
        gravity = self._settings.gravity_m_s2
        state = start_moving(self._table(), times, imu, model.camera, model.noise, gravity, accel_sign=-1.0)
        return None if state is None else "the image moves against the accelerometer: is its sign reversed?"

    def _forget_before(self, t_ns: int) -> None:
        kept = [s for s in self._history if s.t_ns >= t_ns]
        self._stationary_since = max(0, self._stationary_since - (len(self._history) - len(kept)))
        self._history = kept

    def _update_stationary_time(self, imu: ImuBuffer) -> None:
        """Find since when the image has not moved; the gyro's rotation is not removed from that motion."""
        self.bias_g = None
        if len(self._history) < 2:
            self._stationary_since = 0
            return
        last, before = self._history[-1], self._history[-2]
        newest = len(self._history) - 1
        step_px = self._moved_px(before, last)
        if step_px is None or step_px > TREMOR_PX:
            self._stationary_since = newest
            return
        between = [s.gyro_I for s in imu.recent(before.t_ns) if s.t_ns <= last.t_ns]
        self.bias_g = np.mean(between, axis=0) if between else None
        while self._stationary_since < newest:
            moved_px = self._moved_px(self._history[self._stationary_since], last)
            long = last.t_ns - self._history[self._stationary_since].t_ns > STATIONARY_WINDOW_NS
            if not long and moved_px is not None and moved_px <= TREMOR_PX:
                break
            self._stationary_since += 1

    def _moved_px(self, before: FrameFeatures, now: FrameFeatures) -> float | None:
        """Return the median motion in px of the features that two frames share; None when they are too few."""
        a, b = before.features, now.features
        if b.frozen:
            return 0.0
        _, at, then = np.intersect1d(b.ids, a.ids, assume_unique=True, return_indices=True)
        if len(at) < MIN_COMMON:
            return None
        step = b.xy[at] - a.xy[then]
        return median(np.hypot(step[:, 0], step[:, 1])) * self._model.focal_px

    def _start_stationary(self, observed: FrameFeatures, imu: ImuBuffer) -> tuple[SlidingWindow, str] | None:
        since = self._history[self._stationary_since]
        moved_px = self._moved_px(since, observed)
        age_s = (observed.t_ns - since.t_ns) / 1e9
        if since is observed or moved_px is None or (moved_px > STATIONARY_PX and age_s < TREMOR_S):
            return None
        recent = [s for s in imu.recent(since.t_ns) if s.t_ns <= observed.t_ns]
        stationary = StationaryImage(age_s, moved_px / self._model.focal_px)
        state = start_stationary(recent, observed.t_ns, self._settings.gravity_m_s2, self._model.noise, stationary)
        return None if state is None else (SlidingWindow(state, self._settings, self._model), STATIONARY_START)

    def _may_be_stationary(self, observed: FrameFeatures) -> bool:
        """Return whether the image may be that of a stationary head, for which the time is not long enough yet.

        With depth a start in motion needs less time than that, and would fit a motion to the noise.
        """
        since = self._history[self._stationary_since]
        return self._stationary_since == 0 and observed.t_ns - since.t_ns < TREMOR_S * 1e9

    def _start_moving(self, observed: FrameFeatures, imu: ImuBuffer) -> tuple[SlidingWindow, str] | None:
        if self.waits_long and self._waited_frames % FRAMES_PER_DOUBT:
            # The search takes longest when it fails; after many failures it is not repeated in every frame.
            return None
        if self._may_be_stationary(observed):
            return None
        with_depth = np.count_nonzero(observed.features.depth_m > 0.0) >= ENOUGH_WITH_DEPTH
        if observed.t_ns - self._history[0].t_ns < (MOVING_START_DEPTH_NS if with_depth else MOVING_START_NS):
            return None
        times = [past.t_ns for past in self._history]
        model = self._model
        state = start_moving(self._table(), times, imu, model.camera, model.noise, self._settings.gravity_m_s2)
        if state is None:
            return None
        fault = self._gyro_fault(imu)
        if fault is not None and fault != UNEXPLAINED:
            # Slow rotations about wrong axes are mistaken for a bias of the gyro.
            self.fault = fault
            return None
        window = SlidingWindow(state, self._settings, model)
        for past in self._history[:-1]:
            window.propagate(imu.segments(window.state.t_ns, past.t_ns), past.t_ns, 0.0)
            window.correct(past.features)
        return window, MOVING_START

    def _table(self) -> TrackTable:
        tracks = TrackTable()
        for past in self._history:
            tracks.add_frame(past.features.ids, past.features.xy, past.features.depth_m, past.features.motion_blur_rad)
        return tracks
