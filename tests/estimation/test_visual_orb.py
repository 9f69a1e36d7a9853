"""ORB features, their spread and their matching; the map of points."""

import numpy as np

from snakeslam.estimation.orb_map.orb import OrbExtractor, best_pairs, hamming, spread
from snakeslam.estimation.orb_map.points import JUDGED_AFTER, PROVEN, PointMap
from snakeslam.estimation.visual.settings import VisualSettings


def test_hamming_counts_bits() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.integers(0, 256, (2, 50, 32), dtype=np.uint8)
    expected = np.unpackbits(a ^ b, axis=-1).sum(axis=-1)
    np.testing.assert_array_equal(hamming(a.view(np.uint64), b.view(np.uint64)), expected)
    ones = np.full((1, 4), 2**64 - 1, np.uint64)
    assert hamming(ones, np.zeros((1, 4), np.uint64)) == 256


def test_pairs_are_mutual_near_and_clear() -> None:
    rows = np.array([0, 0, 1, 1, 2, 3, 4, 4])
    columns = np.array([0, 1, 1, 2, 3, 4, 5, 5 + 1])
    distance = np.array([10, 50, 20, 60, 90, 30, 40, 42], np.uint16)
    # Row 2 is too far, row 4 ambiguous.
    pairs = best_pairs(rows, columns, distance, 64, 0.8)
    assert list(zip(pairs.point.tolist(), pairs.feature.tolist(), strict=True)) == [(0, 0), (1, 1), (3, 4)]


def test_of_two_points_at_one_feature_the_nearer_gets_it() -> None:
    pairs = best_pairs(np.array([0, 1]), np.array([5, 5]), np.array([30, 20], np.uint16), 64, 0.8)
    assert pairs.point.tolist() == [1]
    assert len(best_pairs(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0, np.uint16), 64, 0.8)) == 0


def test_corners_are_spread_over_the_image() -> None:
    rng = np.random.default_rng(1)
    px = np.vstack([rng.uniform(0, 100, (900, 2)), rng.uniform(0, 1, (100, 2)) * [640, 480]]).astype(np.float32)
    strong_corner = np.r_[np.full(900, 100.0), np.full(100, 1.0)]
    kept = spread(px, strong_corner, (480, 640), 120)
    assert len(kept) == 120
    assert len(np.unique(kept)) == 120
    assert np.count_nonzero(kept >= 900) > 60


def test_an_empty_image_has_no_features() -> None:
    features = OrbExtractor(VisualSettings()).extract(np.full((480, 640), 80, np.uint8))
    assert len(features) == 0
    assert features.descriptors.shape == (0, 4)


def test_features_of_an_image_match_those_of_its_rotated_copy() -> None:
    rng = np.random.default_rng(2)
    image = np.kron(rng.integers(0, 255, (60, 80)), np.ones((8, 8))).astype(np.uint8)
    extractor = OrbExtractor(VisualSettings(features=400))
    a, b = extractor.extract(image), extractor.extract(np.ascontiguousarray(image[::-1, ::-1]))
    assert 300 < len(a) <= 400
    bits = hamming(a.descriptors[:, None], b.descriptors[None])
    best = bits.argmin(axis=1)
    found = bits.min(axis=1) < 40
    rotated = np.array([639.0, 479.0]) - b.px[best]
    assert np.count_nonzero(found & (np.linalg.norm(rotated - a.px, axis=-1) < 4.0)) > 150


def filled_map(n: int) -> PointMap:
    points = PointMap()
    points.add(np.arange(3.0 * n).reshape(n, 3), np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 4), np.uint64), 0)
    return points


def test_points_that_are_seldom_matched_are_removed() -> None:
    points = filled_map(3)
    for frame in range(JUDGED_AFTER + 2):
        # 0 is found always, 1 never, 2 is never expected.
        points.count_frame(np.array([0, 1]), np.array([0]) if frame < PROVEN else np.empty(0, np.int64))
    points.shrink(100)
    assert points.ids.tolist() == [0, 2]
    np.testing.assert_array_equal(points.points_W[1], [6.0, 7.0, 8.0])
    assert points.age.tolist() == [JUDGED_AFTER + 2 - PROVEN, JUDGED_AFTER + 2]


def test_the_map_is_bounded_and_ids_are_never_used_twice() -> None:
    points = filled_map(6000)
    points.count_frame(np.array([5, 7]), np.array([5, 7]))
    points.shrink(100)
    assert points.count == 100
    assert {5, 7} <= set(points.ids.tolist())
    assert np.all(np.diff(points.ids) > 0)
    new = points.add(np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 4), np.uint64), 1)
    assert points.ids[new].tolist() == [6000, 6001]


def test_the_first_descriptor_of_a_point_is_kept() -> None:
    points = filled_map(1)
    for k in range(1, 5):
        points.add_descriptors(np.array([0]), np.full((1, 4), k, np.uint64))
    assert points.descriptors[0, :, 0].tolist() == [0, 3, 4]
