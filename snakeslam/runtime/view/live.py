"""The live view's sink: turns what slam's runner gives into state, features, chunks and events for the host."""

from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Sequence
from time import monotonic

import numpy as np

from snakeslam.estimation.health import NEW_MAP
from snakeslam.geometry import se3
from snakeslam.messages import (
    CameraFrame,
    Float,
    GroundTruth,
    Health,
    ImuSample,
    JointState,
    JointTarget,
    Packet,
    SlamUpdate,
    Verdict,
)
from snakeslam.robot.kinematics import link_poses_from_imu
from snakeslam.robot.model import SnakeModel
from snakeslam.runtime.bus.topics import Event, Features, Report, SlamState
from snakeslam.runtime.slam.continuation import yaw_alignment
from snakeslam.runtime.slam.sensor_watch import CAMERA, JOINTS, SensorFault, with_faults
from snakeslam.runtime.view.head_motion import HeadMotionMeter

NS = 1e-9
PERIOD_S = 0.05
TRUTH_KEPT = 400
LEAST_STEP_M = 0.01


class TruthView:
    """Aligns the ground truth with the estimate's first pose, for display and a simple error.

    The alignment is by yaw and translation, or by a full pose where the estimate does not know where down is.
    """

    def __init__(self, *, gravity_known: bool = True) -> None:
        self._gravity_known = gravity_known
        self._recent: deque[GroundTruth] = deque(maxlen=TRUTH_KEPT)
        self._align_T_WG: Float | None = None

    def on_truth(self, truth: Sequence[GroundTruth]) -> None:
        """Add new truth, in time order."""
        self._recent.extend(sample for sample in truth if sample.orientation_known)

    def at(self, t_ns: int, T_WI: Float | None) -> Float | None:
        """Return the aligned truth nearest to ``t_ns`` (within 20 ms), (4, 4); the first estimate aligns it."""
        nearest = self._nearest(t_ns)
        if nearest is None or abs(nearest.t_ns - t_ns) * NS > 0.02:
            return None
        if self._align_T_WG is None:
            if T_WI is None:
                return None
            align = yaw_alignment if self._gravity_known else _full_alignment
            self._align_T_WG = align(T_WI, nearest.T_WI)
        return self._align_T_WG @ nearest.T_WI

    def _nearest(self, t_ns: int) -> GroundTruth | None:
        after = bisect_left(self._recent, t_ns, key=lambda truth: truth.t_ns)
        around = [self._recent[k] for k in (after - 1, after) if 0 <= k < len(self._recent)]
        return min(around, key=lambda truth: abs(truth.t_ns - t_ns), default=None)


def _full_alignment(T_WI: Float, T_GI: Float) -> Float:
    return T_WI @ se3.inv(T_GI)


class LiveSink:
    """Keeps the newest state; ``put`` gets features, chunks and events as they come."""

    def __init__(
        self,
        model: SnakeModel | None,
        put: Callable[[Report], None],
        R_IC: Float,
        *,
        gravity_known: bool = True,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        self._model, self._put, self._R_IC, self._clock = model, put, R_IC, clock
        self._truth, self._head_motion = TruthView(gravity_known=gravity_known), HeadMotionMeter()
        self._health = Health(Verdict.INITIALISING)
        self._newest_T_WI: Float | None = None
        self._true_T_WI: Float | None = None
        self._q_measured: Float | None = None
        self._points: dict[int, int] = {}
        self._distance_m: float | None = None
        self._last_p_W: Float | None = None
        self._frames: deque[float] = deque(maxlen=40)
        self._state_s = -np.inf
        self._t_frame_ns = 0
        self._faults: tuple[SensorFault, ...] = ()

    def set_period(self, period_s: float) -> None:
        """Set the gait's period, over which the head's motion is measured."""
        self._head_motion.period_s = period_s

    def on_target(self, target: JointTarget) -> None:
        """Ignore the commanded angles."""

    def on_packet(self, packet: Packet) -> None:
        """Keep joint angles, and pass IMU samples to the measure of the head's motion."""
        if isinstance(packet, JointState):
            self._q_measured = packet.q_rad
        elif isinstance(packet, ImuSample):
            self._head_motion.on_imu(packet)

    def on_truth(self, truth: Sequence[GroundTruth]) -> None:
        """Align new truth with the estimate."""
        self._truth.on_truth(truth)
        # The truth at a frame may arrive with the control period's packets, after the frame.
        if self._t_frame_ns:
            self._true_T_WI = self._truth.at(self._t_frame_ns, self._newest_T_WI)

    def on_update(self, update: SlamUpdate, frame: CameraFrame, slam_ms: float) -> None:
        """Keep an update and pass on what it brings."""
        del frame, slam_ms
        self._frames.append(self._clock())
        self._health, self._t_frame_ns = update.health, update.t_ns
        self._newest_T_WI = None if update.pose is None else update.pose.T_WI
        if update.pose is not None:
            self._head_motion.on_pose(update.pose)
            self._add_distance(update.pose.T_WI[:3, 3])
        self._true_T_WI = self._truth.at(update.t_ns, self._newest_T_WI)
        for chunk in update.chunks:
            self._points[chunk.key] = len(chunk.points_K)
            self._put(chunk)
        if "reset" in update.events:
            self._head_motion.restart()
        for text in update.events:
            self._put(Event(update.t_ns, "warning" if text in ("reset", NEW_MAP) else "info", text))
        self._report_features(update)

    def due(self) -> bool:
        """Return whether the state is to be published."""
        return self._clock() - self._state_s >= PERIOD_S

    def state(self, boot: str, mode: str, faults: tuple[SensorFault, ...] = ()) -> SlamState:
        """Return the newest state of the estimate; ``faults`` are the sensors that are silent now."""
        self._state_s = self._clock()
        self._report_faults(faults)
        silent_camera = any(fault.name == CAMERA for fault in faults)
        return SlamState(
            boot=boot,
            mode=mode,
            health=with_faults(self._health, faults),
            frame_rate_hz=None if silent_camera else self._frame_rate_hz(),
            T_WI=self._newest_T_WI,
            Ts_WL=self._links(),
            T_WI_truth=self._true_T_WI,
            head=self._head_motion.motion(),
            error_m=self._error_m(),
            distance_m=self._distance_m,
            map_points=sum(self._points.values()),
        )

    def _report_faults(self, faults: tuple[SensorFault, ...]) -> None:
        before, now = ({fault.name: fault.words for fault in some} for some in (self._faults, faults))
        self._faults = faults
        for name in now.keys() - before.keys():
            self._put(Event(self._t_frame_ns, "error", now[name]))
        for name in before.keys() - now.keys():
            self._put(
                Event(self._t_frame_ns, "info", f"the {name} {'are' if name == JOINTS else 'is'} no longer silent")
            )

    def _add_distance(self, p_W: Float) -> None:
        """Add to the distance in steps of at least LEAST_STEP_M, so that the estimate's noise does not count."""
        if self._last_p_W is None:
            self._last_p_W, self._distance_m = p_W, 0.0
        step_m = float(np.linalg.norm(p_W - self._last_p_W))
        if step_m >= LEAST_STEP_M:
            self._last_p_W, self._distance_m = p_W, (self._distance_m or 0.0) + step_m

    def _links(self) -> Float | None:
        if self._model is None or self._newest_T_WI is None or self._q_measured is None:
            return None
        return link_poses_from_imu(self._model, self._q_measured, self._newest_T_WI)

    def _error_m(self) -> float | None:
        if self._newest_T_WI is None or self._true_T_WI is None:
            return None
        return float(np.linalg.norm(self._newest_T_WI[:3, 3] - self._true_T_WI[:3, 3]))

    def _frame_rate_hz(self) -> float | None:
        if len(self._frames) < 2 or self._clock() - self._frames[-1] > 2.0:
            return None
        return (len(self._frames) - 1) / max(self._frames[-1] - self._frames[0], 1e-6)

    def _report_features(self, update: SlamUpdate) -> None:
        px = np.round(update.tracks_px.astype(np.float64), 1).reshape(-1, 2).T.tolist()
        tracks = tuple(zip(*px, update.track_inliers.astype(int).tolist(), update.track_ids.tolist(), strict=True))
        roll_rad = None if update.pose is None else camera_roll_rad(update.pose.T_WI[:3, :3] @ self._R_IC)
        self._put(Features(update.t_ns, update.seq, tracks, roll_rad))


def camera_roll_rad(R_WC: Float) -> float:
    """Return a camera's roll about its optical axis, clockwise; 0 when the bottom of its image points down."""
    return float(np.arctan2(-R_WC[2, 0], -R_WC[2, 1]))
