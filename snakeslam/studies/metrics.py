"""What a run is judged by: the object that ``--json`` prints. What is unknown is None, never 0 or NaN."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from snakeslam.geometry import se3, so3
from snakeslam.messages import Float, GroundTruth, PoseEstimate, SlamUpdate
from snakeslam.studies.trajectories import (
    MIN_POSES_TO_ALIGN,
    RelativeError,
    Trajectory,
    align_posyaw,
    align_se3,
    ate_m,
    interpolate,
    relative_error,
)

RPE_DELTA_NS = 1_000_000_000
RPE_TOLERANCE_NS = 30_000_000
RATE_WINDOW_NS = 20_000_000
LEAST_TRAVEL_M = 0.05


@dataclass(frozen=True, slots=True)
class AbsoluteError:
    """ATE over the tracked poses; ``posyaw`` needs an estimate that knows gravity."""

    posyaw: float | None = None
    se3: float | None = None


@dataclass(frozen=True, slots=True)
class RelativeErrors:
    """RPE over one second."""

    trans_m: float | None = None
    rot_deg: float | None = None


@dataclass(frozen=True, slots=True)
class Consistency:
    """Mean normalised error squared, three degrees of freedom each: 3 when the covariance is right."""

    position: float | None = None
    orientation: float | None = None


@dataclass(frozen=True, slots=True)
class HeadMotion:
    """How still the robot's head is; each RMS is about the mean."""

    yaw_rms_deg: float | None = None
    peak_yaw_rate_deg_s: float | None = None
    sway_pp_m: float | None = None
    roll_rms_deg: float | None = None
    pitch_rms_deg: float | None = None


@dataclass(frozen=True, slots=True)
class HeadWindow:
    """Where the head's motion is judged: from ``from_ns`` (after the start-up), over whole gait periods."""

    from_ns: int
    period_s: float


@dataclass(frozen=True, slots=True)
class FrameTimes:
    """The estimator's time on one frame, sensors and rendering excluded."""

    mean: float | None = None
    p95: float | None = None


@dataclass(frozen=True, slots=True)
class Metrics:
    """The measured figures of one run.

    ``path_m`` is the length of the true path, of the estimated one where no truth is known then; ``speed_m_s`` is
    net displacement over time, from the same. ``islands`` is the number of maps that nothing had tied together by the
    end, ``connected_fraction`` the share of frames that were tracked in the first map, or in one tied to it, when
    published.
    """

    frames: int
    duration_s: float
    path_m: float | None
    ate_m: AbsoluteError
    rpe_1s: RelativeErrors
    tracked_fraction: float | None
    resets: int
    islands: int | None
    connected_fraction: float | None
    nees: Consistency
    head: HeadMotion
    speed_m_s: float | None
    ms_per_frame: FrameTimes
    realtime_factor: float | None

    def as_dict(self) -> dict[str, object]:
        """Return plain values for JSON."""
        return asdict(self)


def evaluate(
    updates: Sequence[SlamUpdate],
    truth: Sequence[GroundTruth],
    frame_ms: Sequence[float],
    duration_s: float,
    wall_s: float,
    gravity_known: bool,
    head: HeadWindow | None,
) -> Metrics:
    """Return the metrics of a run from what it published; ``head`` is None without a robot."""
    tracked = tracked_poses(updates)
    estimate = trajectory(tracked)
    true = truth_trajectory(truth)
    Ts_true, known = interpolate(true, estimate.t_ns)
    matched, Ts_matched = estimate.at(known), Ts_true[known]
    oriented = all(sample.orientation_known for sample in truth)
    compares = oriented and len(matched) > 1
    rpe = relative_error(matched, Ts_matched, RPE_DELTA_NS, RPE_TOLERANCE_NS) if compares else None
    within = _within(true, updates)
    walked = within if len(within) > 1 else estimate
    poses = [pose for pose, ok in zip(tracked, known, strict=True) if ok]
    return Metrics(
        frames=len(updates),
        duration_s=duration_s,
        path_m=walked.path_m if len(walked) > 1 else None,
        ate_m=absolute_error(matched, Ts_matched, gravity_known),
        rpe_1s=RelativeErrors(*rpe) if isinstance(rpe, RelativeError) else RelativeErrors(),
        tracked_fraction=len(tracked) / len(updates) if updates else None,
        islands=count_islands(updates),
        connected_fraction=(sum(pose.health.map_connected for pose in tracked) / len(updates) if updates else None),
        resets=sum(update.events.count("reset") for update in updates),
        nees=consistency(poses, Ts_matched, gravity_known) if oriented else Consistency(),
        head=HeadMotion() if head is None else head_motion(true.at(true.t_ns >= head.from_ns), head.period_s),
        speed_m_s=net_speed_m_s(walked),
        ms_per_frame=frame_times(frame_ms),
        realtime_factor=duration_s / wall_s if wall_s > 0 else None,
    )


def notes_on(updates: Sequence[SlamUpdate], truth: Sequence[GroundTruth], *, truth_recorded: bool) -> list[str]:
    """Return in a line each what the metrics leave open: why nothing was tracked, how far the truth reaches.

    ``truth_recorded`` is whether the recording has a truth at all, within the run's time or not.
    """
    tracked = tracked_poses(updates)
    if not tracked:
        return [_nothing_tracked(updates)]
    if not truth_recorded:
        return []
    known = interpolate(truth_trajectory(truth), trajectory(tracked).t_ns)[1]
    compared = int(np.count_nonzero(known))
    if compared == len(tracked):
        return []
    path = "" if len(_within(truth_trajectory(truth), updates)) > 1 else "; path and speed are the estimate's"
    errors = "the errors are theirs" if compared else "no error is known"
    return [f"the ground truth is known for {compared} of {len(tracked)} tracked poses, {errors}{path}"]


def _nothing_tracked(updates: Sequence[SlamUpdate]) -> str:
    if not updates:
        return "there was no image: nothing was tracked"
    reasons = Counter(reason for update in updates for reason in update.health.reasons)
    said = "; ".join(f"{reason} ({count})" for reason, count in reasons.most_common(2)) or "no reason is known"
    most = max(update.health.tracks for update in updates)
    return f"nothing was tracked in {len(updates)} images: {said}; at most {most} features in one image"


def count_islands(updates: Sequence[SlamUpdate]) -> int | None:
    """Return the number of maps in which the poses lie, those that were tied together counted once; None without."""
    islands: set[int] = set()
    for update in updates:
        if update.tie is not None:
            islands.discard(update.tie.island)
        if update.pose is not None:
            islands.add(update.island)
    return len(islands) or None


def tracked_poses(updates: Sequence[SlamUpdate]) -> list[PoseEstimate]:
    """Return the causal poses that rest on the camera, as they were published."""
    return [update.pose for update in updates if update.pose is not None and update.health.verdict.tracked]


def trajectory(poses: Sequence[PoseEstimate]) -> Trajectory:
    """Return poses as arrays."""
    t_ns = np.array([pose.t_ns for pose in poses], dtype=np.int64)
    return Trajectory(t_ns, np.array([pose.T_WI for pose in poses]).reshape(-1, 4, 4))


def truth_trajectory(truth: Sequence[GroundTruth]) -> Trajectory:
    """Return the truth as arrays."""
    t_ns = np.array([sample.t_ns for sample in truth], dtype=np.int64)
    return Trajectory(t_ns, np.array([sample.T_WI for sample in truth]).reshape(-1, 4, 4))


def absolute_error(estimate: Trajectory, Ts_true: Float, gravity_known: bool) -> AbsoluteError:
    """Return the ATE with both alignments, None below three poses."""
    if len(estimate) < MIN_POSES_TO_ALIGN:
        return AbsoluteError()
    p, p_true = estimate.Ts_WI[:, :3, 3], Ts_true[:, :3, 3]
    posyaw = ate_m(p, p_true, align_posyaw(p, p_true)) if gravity_known else None
    return AbsoluteError(posyaw=posyaw, se3=ate_m(p, p_true, align_se3(p, p_true)))


def consistency(poses: Sequence[PoseEstimate], Ts_true: Float, gravity_known: bool) -> Consistency:
    """Return mean e^T P^-1 e of position (e = p_true - p) and orientation (e = Log(R^T R_true)), [Bar-Shalom01].

    The truth is brought to the estimate's world by its first pose, which that world is defined by: by yaw and position
    where gravity is known, else by the whole pose. Poses without a positive definite covariance are left out.
    """
    if len(poses) < MIN_POSES_TO_ALIGN:
        return Consistency()
    T = _first_alignment(poses[0].T_WI, Ts_true[0], gravity_known)
    position: list[float] = []
    orientation: list[float] = []
    for pose, T_true in zip(poses[1:], T @ Ts_true[1:], strict=True):
        e_p = T_true[:3, 3] - pose.T_WI[:3, 3]
        e_theta = so3.log(pose.T_WI[:3, :3].T @ T_true[:3, :3])
        _append_nees(position, e_p, pose.cov[3:6, 3:6])
        _append_nees(orientation, e_theta, pose.cov[:3, :3])
    return Consistency(position=_mean(position), orientation=_mean(orientation))


def _first_alignment(T_estimate: Float, T_true: Float, gravity_known: bool) -> Float:
    if not gravity_known:
        return T_estimate @ se3.inv(T_true)
    R = so3.from_yaw(_yaw_between(T_true[:3, :3], T_estimate[:3, :3]))
    return se3.from_rt(R, T_estimate[:3, 3] - R @ T_true[:3, 3])


def head_motion(head: Trajectory, period_s: float) -> HeadMotion:
    """Return the RMS of the head's yaw, roll and pitch, its peak yaw rate over 20 ms, and its sway across the path.

    Whole periods only, counted back from the end, so that a swing has no part in the mean direction.
    """
    head = whole_periods(head, period_s)
    if len(head) < MIN_POSES_TO_ALIGN:
        return HeadMotion()
    yaw_rad = np.unwrap(so3.yaw(head.Ts_WI[:, :3, :3]))
    t_s = (head.t_ns - head.t_ns[0]) / 1e9
    stride = max(1, round(RATE_WINDOW_NS / float(np.median(np.diff(head.t_ns)))))
    rates = (yaw_rad[stride:] - yaw_rad[:-stride]) / (t_s[stride:] - t_s[:-stride])
    xy = head.Ts_WI[:, :2, 3]
    travel = xy[-1] - xy[0]
    mean_yaw = float(np.mean(yaw_rad))
    moves = float(np.linalg.norm(travel)) >= LEAST_TRAVEL_M
    along = travel / np.linalg.norm(travel) if moves else np.array([np.cos(mean_yaw), np.sin(mean_yaw)])
    return HeadMotion(
        yaw_rms_deg=_rms_deg(yaw_rad),
        peak_yaw_rate_deg_s=float(np.rad2deg(np.max(np.abs(rates)))) if rates.size else None,
        sway_pp_m=float(np.ptp(xy @ np.array([-along[1], along[0]]))),
        roll_rms_deg=_rms_deg(np.arctan2(head.Ts_WI[:, 2, 1], head.Ts_WI[:, 2, 2])),
        pitch_rms_deg=_rms_deg(-np.arcsin(np.clip(head.Ts_WI[:, 2, 0], -1.0, 1.0))),
    )


def _rms_deg(angles_rad: Float) -> float:
    return float(np.rad2deg(np.std(np.unwrap(angles_rad))))


def whole_periods(head: Trajectory, period_s: float) -> Trajectory:
    """Return the longest end of the motion that is a whole number of periods; all of it below one."""
    if not len(head):
        return head
    whole_s = float(head.t_ns[-1] - head.t_ns[0]) / 1e9 // period_s * period_s
    return head.at(head.t_ns >= head.t_ns[-1] - round(whole_s * 1e9)) if whole_s > 0 else head


def net_speed_m_s(path: Trajectory) -> float | None:
    """Return net displacement over time."""
    if len(path) < 2:
        return None
    return float(np.linalg.norm(path.Ts_WI[-1, :3, 3] - path.Ts_WI[0, :3, 3])) / (
        float(path.t_ns[-1] - path.t_ns[0]) / 1e9
    )


def frame_times(frame_ms: Sequence[float]) -> FrameTimes:
    """Return mean and 95th percentile."""
    if not frame_ms:
        return FrameTimes()
    return FrameTimes(mean=float(np.mean(frame_ms)), p95=float(np.percentile(frame_ms, 95)))


def _within(truth: Trajectory, updates: Sequence[SlamUpdate]) -> Trajectory:
    """Return the truth from the first camera frame to the last."""
    if not updates:
        return truth
    return truth.at((truth.t_ns >= updates[0].t_ns) & (truth.t_ns <= updates[-1].t_ns))


def _yaw_between(R_from: Float, R_to: Float) -> float:
    """Return the yaw of the rotation about z nearest to R_to R_from^T."""
    R = R_to @ R_from.T
    return float(np.arctan2(R[1, 0] - R[0, 1], R[0, 0] + R[1, 1]))


def _append_nees(values: list[float], error: Float, cov: Float) -> None:
    if not np.all(np.isfinite(cov)) or np.linalg.eigvalsh(cov)[0] <= 0.0:
        return
    values.append(float(error @ np.linalg.solve(cov, error)))


def _mean(values: list[float]) -> float | None:
    return float(np.mean(values)) if values else None
