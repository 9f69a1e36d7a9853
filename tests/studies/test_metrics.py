"""Metrics against evo, against closed forms, and the exact object of the contract."""

import json
from collections.abc import Sequence

import numpy as np
import pytest
from evo.core import metrics as evo_metrics
from evo.core.trajectory import PosePath3D, PoseTrajectory3D

from snakeslam.geometry import se3, so3
from snakeslam.messages import GroundTruth, Health, PoseEstimate, SlamUpdate, Verdict
from snakeslam.studies.metrics import HeadWindow, Metrics, evaluate, head_motion, truth_trajectory
from snakeslam.studies.trajectories import (
    Trajectory,
    align_posyaw,
    align_se3,
    ate_m,
    interpolate,
    relative_error,
)

STEP_NS = 50_000_000


def wander(seed: int, count: int = 120) -> Trajectory:
    """A smooth curve in space that also turns."""
    rng = np.random.default_rng([seed, 11])
    t = np.arange(count) * 0.05
    a, b, c = rng.uniform(0.3, 1.2, (3, 3))
    p = np.stack([t * 0.3 + a[0] * np.sin(b[0] * t), a[1] * np.sin(b[1] * t + 1), 0.2 * np.sin(b[2] * t)], axis=1)
    R = so3.exp(np.stack([0.2 * np.sin(c[0] * t), 0.3 * np.cos(c[1] * t), 0.5 * t], axis=1))
    return Trajectory(np.arange(count, dtype=np.int64) * STEP_NS + 10**18, se3.from_rt(R, p))


def disturbed(true: Trajectory, seed: int, sigma_rad: float = 0.01, sigma_m: float = 0.03) -> Trajectory:
    rng = np.random.default_rng([seed, 12])
    xi = rng.normal(size=(len(true), 6)) * ([sigma_m] * 3 + [sigma_rad] * 3)
    return Trajectory(true.t_ns, true.Ts_WI @ se3.exp(xi))


def moved(trajectory: Trajectory, T: np.ndarray) -> Trajectory:
    return Trajectory(trajectory.t_ns, T @ trajectory.Ts_WI)


def evo_trajectory(trajectory: Trajectory) -> PoseTrajectory3D:
    return PoseTrajectory3D(poses_se3=list(trajectory.Ts_WI), timestamps=(trajectory.t_ns - 10**18) / 1e9)


def updates_of(
    trajectory: Trajectory, cov: np.ndarray | None = None, verdicts: Sequence[Verdict] | None = None
) -> list[SlamUpdate]:
    cov = np.eye(9) * 1e-4 if cov is None else cov
    verdicts = verdicts or [Verdict.GOOD] * len(trajectory)
    empty = np.zeros((0, 2)), np.zeros(0, np.int64), np.zeros(0, bool)
    updates = []
    for seq, (t_ns, T, verdict) in enumerate(zip(trajectory.t_ns, trajectory.Ts_WI, verdicts, strict=True)):
        health = Health(verdict)
        pose = PoseEstimate(int(t_ns), T, np.zeros(3), cov, health)
        updates.append(SlamUpdate(int(t_ns), seq, pose, health, *empty))
    return updates


def truth_of(trajectory: Trajectory) -> list[GroundTruth]:
    return [GroundTruth(int(t_ns), T) for t_ns, T in zip(trajectory.t_ns, trajectory.Ts_WI, strict=True)]


def judge(updates: Sequence[SlamUpdate], truth: Sequence[GroundTruth], **changes: object) -> Metrics:
    options = {"duration_s": 6.0, "wall_s": 3.0, "gravity_known": True, "head": None} | changes
    return evaluate(updates, truth, [4.0] * len(updates), **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(3))
def test_ate_with_se3_agrees_with_evo(seed: int) -> None:
    true = wander(seed)
    estimate = moved(disturbed(true, seed), se3.exp(np.array([3.0, -2.0, 1.0, 0.4, -1.2, 2.0])))
    ape = evo_metrics.APE(evo_metrics.PoseRelation.translation_part)
    reference, aligned = evo_trajectory(true), evo_trajectory(estimate)
    aligned.align(reference)
    ape.process_data((reference, aligned))
    assert judge(updates_of(estimate), truth_of(true)).ate_m.se3 == pytest.approx(
        ape.get_statistic(evo_metrics.StatisticsType.rmse), rel=1e-6
    )


@pytest.mark.parametrize("seed", range(3))
def test_rpe_over_a_second_agrees_with_evo(seed: int) -> None:
    true = wander(seed)
    estimate = moved(disturbed(true, seed), se3.exp(np.array([3.0, -2.0, 1.0, 0.4, -1.2, 2.0])))
    metrics = judge(updates_of(estimate), truth_of(true))
    for ours, relation in (
        (metrics.rpe_1s.trans_m, evo_metrics.PoseRelation.translation_part),
        (metrics.rpe_1s.rot_deg, evo_metrics.PoseRelation.rotation_angle_deg),
    ):
        rpe = evo_metrics.RPE(relation, delta=20, delta_unit=evo_metrics.Unit.frames, all_pairs=True)
        rpe.process_data((PosePath3D(poses_se3=list(true.Ts_WI)), PosePath3D(poses_se3=list(estimate.Ts_WI))))
        assert ours == pytest.approx(rpe.get_statistic(evo_metrics.StatisticsType.rmse), rel=1e-6)


@pytest.mark.parametrize("yaw", [-3.0, -0.5, 0.0, 1.5, 3.1])
def test_posyaw_undoes_yaw_and_translation_exactly(yaw: float) -> None:
    true = wander(1)
    T = se3.from_rt(so3.from_yaw(yaw), [5.0, -1.0, 2.0])
    ate = judge(updates_of(moved(true, T)), truth_of(true)).ate_m
    assert ate.posyaw == pytest.approx(0.0, abs=1e-9)
    assert ate.se3 == pytest.approx(0.0, abs=1e-9)


def test_posyaw_is_the_best_yaw_of_all() -> None:
    true, estimate = wander(2), disturbed(wander(2), 2)
    p, p_true = estimate.Ts_WI[:, :3, 3], true.Ts_WI[:, :3, 3]
    best = align_posyaw(p, p_true)
    least = ate_m(p, p_true, best)
    for turn in (-0.02, -0.001, 0.001, 0.02):
        R = so3.from_yaw(turn) @ best[:3, :3]
        other = se3.from_rt(R, p_true.mean(axis=0) - R @ p.mean(axis=0))
        assert ate_m(p, p_true, other) > least
    assert least >= ate_m(p, p_true, align_se3(p, p_true))


def test_posyaw_does_not_hide_a_tilt() -> None:
    """An estimate that has gravity wrong by 5 deg keeps its error; with se3 it is aligned away."""
    true = wander(3)
    tilted = moved(true, se3.exp(np.array([0, 0, 0, np.deg2rad(5), 0, 0])))
    ate = judge(updates_of(tilted), truth_of(true)).ate_m
    assert ate.posyaw is not None
    assert ate.posyaw > 0.01
    assert ate.se3 == pytest.approx(0.0, abs=1e-9)


def test_a_known_error_has_its_known_size() -> None:
    """Half the poses 1 cm up, half 1 cm down: ATE 1 cm."""
    true = wander(4)
    off = true.Ts_WI.copy()
    off[::2, 2, 3] += 0.01
    off[1::2, 2, 3] -= 0.01
    ate = judge(updates_of(Trajectory(true.t_ns, off)), truth_of(true)).ate_m
    assert ate.posyaw == pytest.approx(0.01, rel=1e-3)


def test_truth_is_interpolated_along_the_motion() -> None:
    t_ns = np.arange(0, 6_000_000_001, STEP_NS)
    turns = so3.exp(np.stack([0 * t_ns, 0 * t_ns, t_ns / 1e9], axis=1).astype(float))
    straight = np.stack([t_ns / 1e9, 0 * t_ns, 0 * t_ns], axis=1)
    truth = Trajectory(t_ns, se3.from_rt(turns, straight))
    wanted = np.array([0, 12_345_678, 1_025_000_000, 5_999_999_999])
    poses, known = interpolate(truth, wanted)
    assert known.all()
    np.testing.assert_allclose(poses[:, 0, 3], wanted / 1e9, atol=1e-12)
    np.testing.assert_allclose(so3.yaw(poses[1:3, :3, :3]), wanted[1:3] / 1e9, atol=1e-12)


def test_truth_is_unknown_in_gaps_and_outside() -> None:
    t_ns = np.array([0, 50_000_000, 400_000_000, 450_000_000])
    truth = Trajectory(t_ns, np.tile(np.eye(4), (4, 1, 1)))
    _, known = interpolate(
        truth, np.array([-6_000_000, -4_000_000, 200_000_000, 398_000_000, 454_000_000, 456_000_000])
    )
    assert known.tolist() == [False, True, False, True, True, False]
    assert not interpolate(Trajectory(t_ns[:0], truth.Ts_WI[:0]), t_ns)[1].any()
    assert interpolate(truth.at(np.array([0])), np.array([1_000_000, 9_000_000]))[1].tolist() == [True, False]


def test_rpe_needs_a_pair_a_second_apart() -> None:
    short = wander(1, count=15)
    assert relative_error(short, short.Ts_WI, 10**9, 30_000_000) is None
    gap = wander(1).at(np.r_[0:5, 90:95])
    assert relative_error(gap, gap.Ts_WI, 10**9, 30_000_000) is None


def test_only_poses_that_the_camera_supports_count() -> None:
    true = wander(5)
    wild = true.Ts_WI.copy()
    wild[:30, :3, 3] += 9.0
    verdicts = [Verdict.INITIALISING] * 10 + [Verdict.BLIND] * 10 + [Verdict.LOST] * 10 + [Verdict.DEGRADED] * 90
    metrics = judge(updates_of(Trajectory(true.t_ns, wild), verdicts=verdicts), truth_of(true))
    assert metrics.tracked_fraction == pytest.approx(90 / 120)
    assert metrics.frames == 120
    assert metrics.ate_m.posyaw == pytest.approx(0.0, abs=1e-9)


def test_resets_are_counted() -> None:
    update = updates_of(wander(1))[0]
    again = [SlamUpdate(update.t_ns, 0, None, update.health, *[np.zeros((0, 2))] * 3, (), e) for e in ([], ["reset"])]
    assert judge([again[0], again[1], again[1]], []).resets == 2


@pytest.mark.parametrize("gravity_known", [True, False])
@pytest.mark.parametrize("scale", [1.0, 4.0])
def test_nees_is_three_when_the_covariance_is_right(scale: float, gravity_known: bool) -> None:
    """A covariance ``scale`` times too large divides it by ``scale``; a world is known up to yaw, or not at all."""
    true = wander(6, count=4000)
    rng = np.random.default_rng(5)
    sd = np.array([0.01, 0.02, 0.03, 0.1, 0.2, 0.05])
    errors = rng.normal(size=(len(true), 6)) * sd
    errors[0] = 0.0
    R, p = true.Ts_WI[:, :3, :3], true.Ts_WI[:, :3, 3]
    estimate = Trajectory(true.t_ns, se3.from_rt(R @ so3.exp(-errors[:, :3]), p - errors[:, 3:]))
    tilt = np.zeros(3) if gravity_known else np.array([0.7, -0.4, 0.0])
    world = se3.from_rt(so3.from_yaw(2.0) @ so3.exp(tilt), [4.0, 1.0, 0.0])
    cov = np.eye(9)
    cov[:3, :3] = np.diag(scale * sd[:3] ** 2)
    cov[3:6, 3:6] = world[:3, :3] @ np.diag(scale * sd[3:] ** 2) @ world[:3, :3].T
    nees = judge(updates_of(moved(estimate, world), cov), truth_of(true), gravity_known=gravity_known).nees
    assert nees.position == pytest.approx(3.0 / scale, rel=0.08)
    assert nees.orientation == pytest.approx(3.0 / scale, rel=0.08)


@pytest.mark.parametrize("cov", [np.zeros((9, 9)), np.full((9, 9), np.nan)])
def test_nees_is_unknown_without_a_covariance(cov: np.ndarray) -> None:
    nees = judge(updates_of(wander(1), cov), truth_of(wander(1))).nees
    assert nees.position is None
    assert nees.orientation is None


def test_head_motion_of_a_known_sway() -> None:
    """Straight ahead at 10 cm/s along 30 deg, sway +-4 cm, yaw +-10 deg at .25 Hz, 4 and a half periods."""
    t_ns = np.arange(0, 18_000_000_000, 5_000_000)
    t, heading = t_ns / 1e9, np.deg2rad(30)
    swing = np.sin(2 * np.pi * 0.25 * t)
    along, across = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
    xy = 0.1 * t[:, None] * along + 0.04 * swing[:, None] * across
    R = so3.from_yaw(heading + np.deg2rad(10) * swing)
    head = head_motion(Trajectory(t_ns, se3.from_rt(R, np.c_[xy, 0 * t])), 4.0)
    assert head.yaw_rms_deg == pytest.approx(10 / np.sqrt(2), rel=1e-3)
    assert head.peak_yaw_rate_deg_s == pytest.approx(10 * 2 * np.pi * 0.25, rel=1e-2)
    assert head.sway_pp_m == pytest.approx(0.08, rel=1e-2)


def test_a_head_that_turns_through_180_deg_has_no_jump() -> None:
    t_ns = np.arange(0, 4_000_000_000, 5_000_000)
    R = so3.from_yaw(np.pi + 0.1 * np.sin(t_ns / 1e9))
    head = head_motion(Trajectory(t_ns, se3.from_rt(R, np.zeros((len(t_ns), 3)))), 3.0)
    assert head.peak_yaw_rate_deg_s == pytest.approx(np.rad2deg(0.1), rel=1e-2)


def test_path_and_speed_are_the_truths_and_else_the_estimates() -> None:
    t_ns = np.arange(0, 5_000_000_001, STEP_NS)
    p = np.stack([0.2 * t_ns / 1e9, 0 * t_ns, 0 * t_ns], axis=1)
    true = Trajectory(t_ns, se3.from_rt(np.eye(3), p))
    estimate = Trajectory(t_ns, se3.from_rt(np.eye(3), 2 * p))
    known, unknown = judge(updates_of(estimate), truth_of(true)), judge(updates_of(estimate), [])
    assert (known.path_m, known.speed_m_s) == (pytest.approx(1.0), pytest.approx(0.2))
    assert (unknown.path_m, unknown.speed_m_s) == (pytest.approx(2.0), pytest.approx(0.4))


def keys(value: object) -> object:
    return {key: keys(inner) for key, inner in value.items()} if isinstance(value, dict) else None


def test_the_object_of_the_contract() -> None:
    wanted = {
        "frames": None,
        "duration_s": None,
        "path_m": None,
        "ate_m": {"posyaw": None, "se3": None},
        "rpe_1s": {"trans_m": None, "rot_deg": None},
        "tracked_fraction": None,
        "resets": None,
        "islands": None,
        "connected_fraction": None,
        "nees": {"position": None, "orientation": None},
        "head": {
            "yaw_rms_deg": None,
            "peak_yaw_rate_deg_s": None,
            "sway_pp_m": None,
            "roll_rms_deg": None,
            "pitch_rms_deg": None,
        },
        "speed_m_s": None,
        "ms_per_frame": {"mean": None, "p95": None},
        "realtime_factor": None,
    }
    true = wander(1)
    full = judge(updates_of(disturbed(true, 1)), truth_of(true), head=HeadWindow(0, 1.0)).as_dict()
    assert keys(full) == wanted
    numbers = json.loads(json.dumps(full, allow_nan=False))
    assert numbers["ms_per_frame"] == {"mean": 4.0, "p95": 4.0}
    assert numbers["realtime_factor"] == 2.0
    assert None not in [*numbers.values(), *(v for n in numbers.values() if isinstance(n, dict) for v in n.values())]


def test_what_is_unknown_is_null() -> None:
    nothing = judge([], [], wall_s=0.0).as_dict()
    assert json.loads(json.dumps(nothing, allow_nan=False)) == keys(nothing) | {
        "frames": 0,
        "duration_s": 6.0,
        "resets": 0,
    }
    untracked = judge(updates_of(wander(1), verdicts=[Verdict.LOST] * 120), truth_of(wander(1)))
    assert untracked.tracked_fraction == 0.0
    assert untracked.ate_m.posyaw is None
    assert untracked.rpe_1s.trans_m is None


def test_without_gravity_there_is_no_yaw_only_alignment() -> None:
    ate = judge(updates_of(wander(1)), truth_of(wander(1)), gravity_known=False).ate_m
    assert ate.posyaw is None
    assert ate.se3 == pytest.approx(0.0, abs=1e-9)


def test_truth_becomes_a_trajectory() -> None:
    true = wander(2)
    again = truth_trajectory(truth_of(true))
    np.testing.assert_array_equal(again.t_ns, true.t_ns)
    np.testing.assert_array_equal(again.Ts_WI, true.Ts_WI)
    assert len(truth_trajectory([])) == 0
