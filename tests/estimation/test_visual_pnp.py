"""The pose from map points: Jacobians, robustness, covariance; bundle adjustment."""

import numpy as np
import pytest

from snakeslam.estimation.orb_map.bundle import Bundle, _jacobians, _residuals, adjust
from snakeslam.estimation.orb_map.pnp import PointObservations, jacobian, ransac_pose, refine_pose, residuals
from snakeslam.geometry import numeric, se3, so3

FOCAL_PX = 500.0
SIGMA_PX = 1.0
T_WC = se3.exp(np.array([0.3, -0.2, 0.5, 0.2, -0.4, 0.9]))


def points_ahead(rng: np.random.Generator, n: int, T: np.ndarray = T_WC) -> np.ndarray:
    """Points (n, 3) in W that the camera sees between 1 and 4 m."""
    z = rng.uniform(1.0, 4.0, n)
    xy = rng.uniform(-0.5, 0.5, (n, 2))
    return se3.act(T, np.column_stack([xy * z[:, None], z]))


def observations(
    rng: np.random.Generator, points_W: np.ndarray, T: np.ndarray = T_WC, noise: float = 1.0
) -> PointObservations:
    """What the camera measures of them, with noise; every third one has no depth."""
    q = se3.act(se3.inv(T), points_W)
    sigma_z = 0.004 + 0.004 * q[:, 2] ** 2
    weights = np.stack([np.full(len(q), FOCAL_PX / SIGMA_PX)] * 2 + [1.0 / sigma_z], axis=-1)
    xyz = np.column_stack([q[:, :2] / q[:, 2:], q[:, 2]]) + noise * rng.standard_normal((len(q), 3)) / weights
    weights[::3, 2] = 0.0
    return PointObservations(points_W, xyz, weights)


def test_pose_jacobian_against_numeric() -> None:
    rng = np.random.default_rng(0)
    seen = observations(rng, points_ahead(rng, 20))
    T = T_WC @ se3.exp(np.full(6, 0.02))
    expected = numeric.jacobian(lambda d: residuals(T @ se3.exp(d), seen), 6)
    np.testing.assert_allclose(jacobian(T, seen).reshape(-1, 6), expected, rtol=1e-5, atol=1e-4)


def test_pose_is_found_among_wrong_matches() -> None:
    rng = np.random.default_rng(1)
    seen = observations(rng, points_ahead(rng, 200))
    wrong = rng.permutation(200)[:60]
    seen.xyz[wrong, :2] += rng.uniform(0.05, 0.3, (60, 2))
    fit = refine_pose(T_WC @ se3.exp(np.full(6, 0.02)), seen)
    assert fit is not None
    assert not fit.inliers[wrong].any()
    assert fit.inliers.sum() > 120
    error = se3.log(se3.inv(T_WC) @ fit.T_WC)
    assert np.linalg.norm(error[:3]) < 0.005
    assert np.rad2deg(np.linalg.norm(error[3:])) < 0.2


def test_covariance_matches_the_spread_of_the_errors() -> None:
    """NEES of 200 fits with as many points as count as independent is chi-square with six degrees of freedom."""
    values = []
    for k in range(200):
        rng = np.random.default_rng([2, k])
        fit = refine_pose(T_WC, observations(rng, points_ahead(rng, 30)))
        assert fit is not None
        e = se3.log(se3.inv(fit.T_WC) @ T_WC)
        values.append(e @ np.linalg.solve(fit.cov, e))
    # The gates cut the tails, which makes the sample a little narrower or wider than the ideal.
    assert 4.5 < np.mean(values) < 8.0


def test_more_points_than_are_independent_do_not_shrink_the_covariance() -> None:
    rng = np.random.default_rng(3)
    few, many = (refine_pose(T_WC, observations(rng, points_ahead(rng, n))) for n in (60, 600))
    assert few is not None
    assert many is not None
    ratio = np.sqrt(np.trace(many.cov) / np.trace(few.cov))
    assert 0.7 < ratio < 1.4


def test_too_few_points_give_no_pose() -> None:
    rng = np.random.default_rng(4)
    assert refine_pose(T_WC, observations(rng, points_ahead(rng, 3))) is None
    assert ransac_pose(observations(rng, points_ahead(rng, 3)), FOCAL_PX, 4.0, 0) is None


def test_ransac_needs_no_start_and_repeats_itself() -> None:
    rng = np.random.default_rng(5)
    seen = observations(rng, points_ahead(rng, 100))
    seen.xyz[:50, :2] = rng.uniform(-0.5, 0.5, (50, 2))
    first, again = (ransac_pose(seen, FOCAL_PX, 4.0, 7) for _ in range(2))
    assert first is not None
    assert first.tobytes() == again.tobytes()
    error = se3.log(se3.inv(T_WC) @ first)
    assert np.linalg.norm(error[:3]) < 0.05
    assert np.rad2deg(np.linalg.norm(error[3:])) < 1.5


def bundle(rng: np.random.Generator, noise: float) -> tuple[Bundle, np.ndarray, np.ndarray]:
    """Four keyframes that see 120 points, the last one fixed; the true poses and points beside it."""
    Ts = np.stack([T_WC @ se3.exp(0.1 * rng.standard_normal(6)) for _ in range(4)])
    points = points_ahead(rng, 120)
    keyframe = np.repeat(np.arange(4), 120)
    point = np.tile(np.arange(120), 4)
    seen = [observations(rng, points, T, noise) for T in Ts]
    xyz, weights = (np.concatenate([getattr(s, name) for s in seen]) for name in ("xyz", "weights"))
    return Bundle(Ts, 3, points, keyframe, point, xyz, weights), Ts, points


def test_bundle_jacobians_against_numeric() -> None:
    rng = np.random.default_rng(6)
    b, Ts, points = bundle(rng, 1.0)
    J_c, J_p = _jacobians(b, Ts, points)
    n = 250
    k, p = b.keyframe[n], b.point[n]

    def moved_pose(d: np.ndarray) -> np.ndarray:
        Ts_moved = Ts.copy()
        Ts_moved[k] = Ts[k] @ se3.exp(d)
        return _residuals(b, Ts_moved, points)[n]

    def moved_point(d: np.ndarray) -> np.ndarray:
        points_moved = points.copy()
        points_moved[p] += d
        return _residuals(b, Ts, points_moved)[n]

    np.testing.assert_allclose(J_c[n], numeric.jacobian(moved_pose, 6), rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(J_p[n], numeric.jacobian(moved_point, 3), rtol=1e-5, atol=1e-4)


def test_bundle_adjustment_finds_poses_and_points_and_leaves_the_fixed_one() -> None:
    rng = np.random.default_rng(7)
    exact, Ts, points = bundle(rng, 0.0)
    Ts_start = Ts.copy()
    Ts_start[:3] = Ts[:3] @ se3.exp(0.01 * rng.standard_normal((3, 6)))
    start = Bundle(
        Ts_start,
        3,
        points + 0.02 * rng.standard_normal(points.shape),
        exact.keyframe,
        exact.point,
        exact.xyz,
        exact.weights,
    )
    result = adjust(start, 10)
    np.testing.assert_array_equal(result.Ts_WK[3], Ts[3])
    np.testing.assert_allclose(result.Ts_WK, Ts, atol=1e-5)
    np.testing.assert_allclose(result.points_W, points, atol=1e-4)
    assert result.inliers.all()


def test_bundle_adjustment_marks_a_wrong_sighting() -> None:
    rng = np.random.default_rng(8)
    b, _, _ = bundle(rng, 0.5)
    b.xyz[7, 0] += 0.1
    result = adjust(b, 6)
    assert not result.inliers[7]
    assert result.inliers.mean() > 0.97


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_bundle_adjustment_never_ends_worse_than_it_began(noise: float) -> None:
    rng = np.random.default_rng(9)
    b, Ts, points = bundle(rng, noise)
    result = adjust(b, 4)
    before = np.median(np.abs(_residuals(b, Ts, points)))
    after = np.median(np.abs(_residuals(b, result.Ts_WK, result.points_W)))
    assert after <= before + 1e-9
    assert np.allclose(so3.log(result.Ts_WK[:, :3, :3]), so3.log(Ts[:, :3, :3]), atol=0.01)
