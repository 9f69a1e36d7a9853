"""A first part of a chunk's points is the whole chunk, coarser."""

import numpy as np

from snakeslam.mapping.detail import CELLS_M, coarse_to_fine


def wall(count: int = 4000) -> np.ndarray:
    rng = np.random.default_rng(3)
    return np.column_stack([np.full(count, 1.5), rng.uniform(-1.0, 1.0, count), rng.uniform(0.0, 1.2, count)])


def test_it_is_a_permutation_and_always_the_same_one() -> None:
    points = wall()
    order = coarse_to_fine(points)
    assert sorted(order.tolist()) == list(range(len(points)))
    np.testing.assert_array_equal(order, coarse_to_fine(points))
    assert coarse_to_fine(points[:0]).shape == (0,)


def test_a_first_part_covers_the_surface_evenly() -> None:
    """Random thinning leaves holes at the same count, which shows that the comparison can fail."""
    points = wall()
    n = 120
    ordered, random = points[coarse_to_fine(points)][:n], points[np.random.default_rng(1).permutation(len(points))][:n]

    def farthest_m(kept: np.ndarray) -> float:
        return float(np.max(np.min(np.linalg.norm(points[:, None] - kept[None], axis=2), axis=1)))

    assert farthest_m(ordered) < np.sqrt(2.0) * 0.32
    assert farthest_m(ordered) < 0.8 * farthest_m(random)


def test_each_level_has_one_point_in_each_of_its_cubes() -> None:
    points = wall()
    ordered = points[coarse_to_fine(points)]
    for cell in CELLS_M:
        cubes = np.unique(np.floor(points / cell).astype(int), axis=0)
        first = np.unique(np.floor(ordered[: 3 * len(cubes)] / cell).astype(int), axis=0)
        assert len(first) == len(cubes), cell
