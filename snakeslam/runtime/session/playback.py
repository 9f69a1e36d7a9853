"""How a recording plays: pause, speed, single frames and seeking; pure, with the clock given.

The estimator runs through a recording once. Its result at each frame is kept, so that seeking back shows exactly what
was computed, and seeking ahead computes up to the frame as fast as the machine can.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import monotonic

import numpy as np
from numpy.typing import NDArray

from snakeslam.messages import Float
from snakeslam.robot.kinematics import link_poses_from_imu
from snakeslam.robot.model import SnakeModel
from snakeslam.runtime.bus.commands import ControlPlayback
from snakeslam.runtime.bus.topics import Features, PlaybackState, SlamState

NS = 1e-9
SLACK_S = 0.5
"""A machine that is later than this no longer catches up: playback goes on from where it is."""
PACE_FRAMES = 40
"""Frames over which the pace is measured."""
MOMENTS_KEPT = 40_000
"""Frames that can be shown again, about 5 kB each: half an hour at 20 Hz. Seeking goes back no further."""


class Player:
    """Which frame of a recording is shown next, and when; frames count from 0.

    ``stamps_ns`` (N,) are the frames' times in ascending order; ``oldest`` is the first frame that can be shown again.
    """

    def __init__(self, stamps_ns: Sequence[int], clock: Callable[[], float] = monotonic) -> None:
        self._stamps_ns, self._clock = list(stamps_ns), clock
        self.paused, self.speed = False, 1.0
        self.shown, self.computed, self.oldest = -1, -1, 0
        self.seeks = 0
        self._goal: int | None = None
        self._anchor_s, self._anchor_ns = clock(), self._stamps_ns[0]
        self._paced: deque[tuple[float, int]] = deque(maxlen=PACE_FRAMES)

    @property
    def count(self) -> int:
        """How many frames there are."""
        return len(self._stamps_ns)

    @property
    def seeking(self) -> bool:
        """Whether frames are computed without waiting, on the way to the frame that was asked for."""
        return self._goal is not None

    @property
    def at_end(self) -> bool:
        """Whether the last frame is shown and nothing else is asked for."""
        return self.shown == len(self._stamps_ns) - 1 and self._goal is None

    @property
    def pace(self) -> float | None:
        """Recorded time over wall time in the last frames; None until it is known."""
        if len(self._paced) < 2 or self._paced[-1][0] - self._paced[0][0] < SLACK_S:
            return None
        (wall_0_s, t_0_ns), (wall_1_s, t_1_ns) = self._paced[0], self._paced[-1]
        return (t_1_ns - t_0_ns) * NS / (wall_1_s - wall_0_s)

    def control(self, command: ControlPlayback) -> None:
        """Apply a request; a position outside the recording is its first or last frame."""
        if command.speed is not None:
            self.speed = command.speed
        if command.position_s is not None:
            self._seek(bisect_right(self._stamps_ns, self._stamps_ns[0] + round(command.position_s / NS)) - 1)
        if command.step:
            self.paused = True
            self._seek((self.shown if self._goal is None else self._goal) + command.step)
        if command.paused is not None:
            if not command.paused and command.position_s is None and self.at_end:
                self._seek(0)  # Play at the end begins again at the first frame, as in video players.
            self.paused = command.paused
        self._paced.clear()
        self._anchor()

    def next(self) -> int | None:
        """Return the frame to show or, on the way to a goal, to compute; None while paused or at the end."""
        if self._goal is not None:
            return min(self._goal, self.computed + 1)
        if self.paused or self.at_end:
            return None
        return self.shown + 1

    def on_shown(self, frame: int) -> None:
        """Note that ``frame`` is shown, and has been computed if it was new."""
        self.shown, self.computed = frame, max(frame, self.computed)
        self._paced.append((self._clock(), self._stamps_ns[frame]))
        if self._goal is not None and frame == self._goal:
            self._goal = None
            self._paced.clear()
            self._anchor()

    def wait_s(self) -> float:
        """Return the seconds until the next frame is due; 0 when it is late or computed without waiting."""
        if self._goal is not None or self.paused or self.at_end:
            return 0.0
        now_s = self._clock()
        due_s = self._anchor_s + (self._stamps_ns[self.shown + 1] - self._anchor_ns) * NS / self.speed
        if now_s - due_s > SLACK_S:
            self._anchor()
        return max(0.0, due_s - now_s)

    def state(self) -> PlaybackState:
        """Return what the page shows."""
        return PlaybackState(
            paused=self.paused,
            speed=self.speed,
            position_s=self._seconds(self.shown),
            computed_s=self._seconds(self.computed),
            duration_s=self._seconds(len(self._stamps_ns) - 1),
            seeking=self.seeking,
            at_end=self.at_end,
            seeks=self.seeks,
        )

    def _seek(self, frame: int) -> None:
        self._goal = min(max(frame, self.oldest), len(self._stamps_ns) - 1)
        self.seeks += 1

    def _anchor(self) -> None:
        """Count the time of playback from the frame that is shown now."""
        self._anchor_s, self._anchor_ns = self._clock(), self._stamps_ns[max(self.shown, 0)]

    def _seconds(self, frame: int) -> float:
        return (self._stamps_ns[max(frame, 0)] - self._stamps_ns[0]) * NS


@dataclass(frozen=True, slots=True)
class Moment:
    """What was computed for one frame: the state without its link poses, which follow from pose and joint angles.

    ``tracks_px`` (N, 2) are the features' positions, ``marks`` (N, 2) whether each is an inlier, and its id.
    """

    t_ns: int
    seq: int
    state: SlamState
    q_measured_rad: Float | None
    tracks_px: NDArray[np.float32]
    marks: NDArray[np.int32]
    roll_rad: float | None

    @classmethod
    def of(cls, state: SlamState, q_measured_rad: Float | None, features: Features) -> "Moment":
        """Return the moment of a frame whose ``features`` were followed."""
        tracks = np.array(features.tracks, dtype=np.float64).reshape(-1, 4)
        position_px, marks = tracks[:, :2].astype(np.float32), tracks[:, 2:].astype(np.int32)
        t_ns, seq, roll_rad = features.t_ns, features.seq, features.roll_rad
        return cls(t_ns, seq, replace(state, Ts_WL=None), q_measured_rad, position_px, marks, roll_rad)

    def features(self) -> Features:
        """Return the features as they were."""
        positions_px = np.round(self.tracks_px.astype(np.float64), 1).T.tolist()
        tracks = tuple(zip(*positions_px, *self.marks.T.tolist(), strict=True))
        return Features(self.t_ns, self.seq, tracks, self.roll_rad)

    def full_state(self, model: SnakeModel | None) -> SlamState:
        """Return the state with the link poses (N + 1, 4, 4) of the robot ``model``, where both are known."""
        T_WI = self.state.T_WI
        if model is None or T_WI is None or self.q_measured_rad is None:
            return self.state
        return replace(self.state, Ts_WL=link_poses_from_imu(model, self.q_measured_rad, T_WI))
