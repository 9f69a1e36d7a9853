"""When the filter starts: from rest, or from motion once there is enough of it."""

from dataclasses import dataclass

import numpy as np

from snakeslam.estimation.frontend import FrontendFrame
from snakeslam.estimation.preintegration import ImuBuffer
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.estimation.sliding_window import ENOUGH_WITH_DEPTH, Model, SlidingWindow
from snakeslam.estimation.start_moving import start_moving
from snakeslam.estimation.start_still import start_still
from snakeslam.estimation.tracks import TrackTable

AT_REST, IN_MOTION = "initialised at rest", "initialised in motion"
STILL_DISPARITY_PX = 1.0
STILL_WINDOW_NS = 300_000_000
MOVING_START_NS = 700_000_000
MOVING_START_DEPTH_NS = 300_000_000
"""With depth the way need not be long enough to see points from two sides."""
MOVING_MEMORY_NS = 1_500_000_000


@dataclass(frozen=True, slots=True)
class Seen:
    """One frame's features at its time on the IMU's clock."""

    t_ns: int
    features: FrontendFrame


class Starter:
    """Remembers the last frames until one of the two starts succeeds."""

    def __init__(self, settings: EstimatorSettings, model: Model) -> None:
        self._settings = settings
        self._model = model
        self._history: list[Seen] = []

    def try_to_start(self, seen: Seen, imu: ImuBuffer) -> tuple[SlidingWindow, str] | None:
        """Return a filter at the frame before its correction (from rest) or after it (from motion), and how."""
        self._history = [s for s in (*self._history, seen) if s.t_ns >= seen.t_ns - MOVING_MEMORY_NS]
        imu.forget_before(self._history[0].t_ns - STILL_WINDOW_NS)
        return self._from_rest(seen, imu) or self._from_motion(seen, imu)

    def _from_rest(self, seen: Seen, imu: ImuBuffer) -> tuple[SlidingWindow, str] | None:
        disparity = seen.features.disparity_px
        if disparity is None or disparity > STILL_DISPARITY_PX:
            return None
        recent = [s for s in imu.samples if s.t_ns > seen.t_ns - STILL_WINDOW_NS]
        state = start_still(recent, seen.t_ns, self._settings.gravity_m_s2, self._model.noise)
        return None if state is None else (SlidingWindow(state, self._settings, self._model), AT_REST)

    def _from_motion(self, seen: Seen, imu: ImuBuffer) -> tuple[SlidingWindow, str] | None:
        with_depth = np.count_nonzero(seen.features.depth_m > 0.0) >= ENOUGH_WITH_DEPTH
        if seen.t_ns - self._history[0].t_ns < (MOVING_START_DEPTH_NS if with_depth else MOVING_START_NS):
            return None
        times = [past.t_ns for past in self._history]
        model = self._model
        state = start_moving(self._table(), times, imu, model.rows, model.noise, self._settings.gravity_m_s2)
        if state is None:
            return None
        window = SlidingWindow(state, self._settings, model)
        for past in self._history[:-1]:
            window.propagate(imu.segments(window.state.t_ns, past.t_ns), past.t_ns, 0.0)
            window.correct(past.features)
        return window, IN_MOTION

    def _table(self) -> TrackTable:
        tracks = TrackTable()
        for past in self._history:
            tracks.observe(past.features.ids, past.features.xy, past.features.depth_m, past.features.smear)
        return tracks
