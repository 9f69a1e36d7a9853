"""Which triangulated points are precise enough to be used."""

import numpy as np

from snakeslam.estimation.measurements.camera import Observations, Poses, ReprojectionModel, points_in_camera, predict
from snakeslam.estimation.measurements.settings import NoiseSettings
from snakeslam.estimation.measurements.triangulation import triangulate
from snakeslam.messages import Float

R_IC = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
ROWS = ReprojectionModel(R_IC, np.zeros(3), 1 / 400, NoiseSettings())


def triangulated(rng: np.random.Generator, ahead_m: Float, baseline_m: float) -> tuple[Float, np.ndarray]:
    """Return the estimated distances of points observed without depth along a lateral baseline, and which are used."""
    count = len(ahead_m)
    points = np.column_stack([ahead_m, rng.uniform(-0.5, 0.5, (count, 2)) * ahead_m[:, None]])
    p_WI = np.column_stack([np.zeros(8), np.linspace(0.0, baseline_m, 8), np.zeros(8)])
    poses = Poses(np.tile(np.eye(3), (8, 1, 1)), p_WI)
    xyz = predict(points_in_camera(points, poses, ROWS))
    xyz[..., :2] += rng.normal(0, 1 / 400, (count, 8, 2))
    xyz[..., 2] = 0.0
    found, good = triangulate(poses, Observations.weighted(xyz, np.ones((count, 8), bool), ROWS), ROWS)
    return found[:, 0], good


def test_points_are_not_selected_by_their_own_noise(rng: np.random.Generator) -> None:
    """With hardly any parallax, points that appear near by noise alone are not used."""
    for baseline_m in (0.03, 0.05, 0.1):
        _, good = triangulated(rng, np.full(400, 10.0), baseline_m)
        assert not good.any()
    far_m, good = triangulated(rng, np.full(400, 10.0), 0.4)
    assert good.mean() > 0.9
    assert abs(np.median(far_m[good]) / 10.0 - 1.0) < 0.02


def test_points_with_parallax_are_used(rng: np.random.Generator) -> None:
    far_m, good = triangulated(rng, rng.uniform(2.0, 4.0, 200), 0.6)
    assert good.mean() > 0.9
    assert np.all((far_m[good] > 1.5) & (far_m[good] < 5.5))
