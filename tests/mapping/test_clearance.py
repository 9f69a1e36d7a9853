"""The free distances around the head, and the steering of a patrol."""

import numpy as np
import pytest

from snakeslam.mapping.clearance import BLOCKED_M, DIRECTIONS_DEG, REACH_M, Clearance, clearance, patrol_steering
from snakeslam.messages import MapChunk

HEAD = np.array([1.0, 2.0, 0.0])
FLOOR_M = -0.1


def chunk(points: np.ndarray) -> MapChunk:
    """Points of the world, in a keyframe that is rotated and away from the origin."""
    T = np.eye(4)
    T[:3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    T[:3, 3] = [0.5, -0.3, 0.2]
    points_K = (points - T[:3, 3]) @ T[:3, :3]
    return MapChunk(1, 0, T, points_K, np.zeros_like(points_K))


def wall(x_m: float, y: tuple[float, float] = (0.0, 4.0), z: tuple[float, float] = (-0.1, 0.5)) -> np.ndarray:
    ys, zs = np.meshgrid(np.arange(*y, 0.05), np.arange(*z, 0.05))
    return np.column_stack([np.full(ys.size, x_m), ys.ravel(), zs.ravel()])


def test_an_empty_map_is_free_up_to_the_reach() -> None:
    assert clearance([], HEAD, 0.3, FLOOR_M).free_m == (REACH_M,) * len(DIRECTIONS_DEG)


def test_a_wall_ahead_is_as_far_as_it_is() -> None:
    free = clearance([chunk(wall(2.2))], HEAD, 0.0, FLOOR_M)
    assert free.ahead_m == pytest.approx(1.2, abs=0.01)
    assert free.free_m[DIRECTIONS_DEG.index(90)] == REACH_M
    behind = clearance([chunk(wall(2.2))], HEAD, np.pi, FLOOR_M)
    assert behind.ahead_m == REACH_M


def test_the_floor_a_table_and_single_points_are_no_obstacles() -> None:
    floor = np.column_stack(
        [np.repeat(np.arange(1, 4, 0.05), 40), np.tile(np.arange(1, 3, 0.05), 60), np.full(2400, -0.09)]
    )
    table = wall(2.0, z=(0.35, 0.6))
    speck = np.array([[1.6, 2.0, 0.1]])
    assert clearance([chunk(floor), chunk(table), chunk(speck)], HEAD, 0.0, FLOOR_M).ahead_m == REACH_M


def free(ahead: float, left: float = 3.0, right: float = 3.0) -> Clearance:
    return Clearance(tuple(left if at > 0 else right if at < 0 else ahead for at in DIRECTIONS_DEG))


def test_it_steers_to_the_freer_side_and_stays_with_it() -> None:
    assert patrol_steering(free(2.0), 0) == 0
    assert patrol_steering(free(1.2, left=0.5, right=2.0), 0) == -1
    assert patrol_steering(free(1.2, left=2.0, right=0.5), 0) == 1
    assert patrol_steering(free(1.2, left=2.0, right=0.5), -1) == -1, "no hesitating in a corner"
    assert patrol_steering(free(2.0), -1) == -1
    assert patrol_steering(free(2.5), -1) == 0
    assert patrol_steering(free(BLOCKED_M - 0.01, left=0.6, right=0.5), 1) == 1, "the left is still free"
    assert patrol_steering(free(BLOCKED_M - 0.01, left=0.5, right=0.6), 1) is None
    assert patrol_steering(free(BLOCKED_M - 0.01, left=0.5, right=0.5), 0) is None


def test_a_patrol_on_a_plane_stays_between_four_walls() -> None:
    """A unicycle with the robot's speed and yaw rate, for ten minutes; straight ahead it would hit a wall after one."""
    span = np.arange(-2.5, 2.51, 0.05)
    sides = [np.column_stack([np.full(span.size, s), span]) for s in (-2.5, 2.5)]
    outline = np.concatenate([*sides, *(side[:, ::-1] for side in sides)])
    walls = [chunk(np.column_stack([np.repeat(outline, 3, axis=0), np.tile([0.0, 0.1, 0.2], len(outline))]))]
    x, y, yaw, turning = 0.0, 0.0, 0.4, 0
    travelled_m, nearest_m = 0.0, np.inf
    for _ in range(600):
        chosen = patrol_steering(clearance(walls, np.array([x, y, 0.0]), yaw, FLOOR_M), turning)
        assert chosen is not None
        turning = chosen
        yaw += np.deg2rad(8.0) * turning
        x, y, travelled_m = x + 0.06 * np.cos(yaw), y + 0.06 * np.sin(yaw), travelled_m + 0.06
        nearest_m = min(nearest_m, 2.5 - abs(x), 2.5 - abs(y))
    assert travelled_m > 30.0
    assert nearest_m > 0.4
