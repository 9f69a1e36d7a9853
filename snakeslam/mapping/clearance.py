"""How far the ground is free around the robot, from the map, and which way a patrol turns before a wall."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from snakeslam.geometry import se3
from snakeslam.messages import Float, MapChunk

DIRECTIONS_DEG = tuple(range(-90, 91, 15))
"""Directions against the heading, positive to the left."""
REACH_M = 3.0
HALF_WIDTH_M = 0.3
"""Half the width of the strip that has to be free: the body winds by 0.2 m to either side."""
LOWEST_M, HIGHEST_M = 0.06, 0.4
"""Heights above the floor between which a point is in the way: over the floor's own noise, and below a table."""
CHUNK_REACH_M = 6.0
"""A chunk has no points farther from its keyframe than a depth camera sees."""
FEWEST_POINTS = 3
"""So many points make an obstacle; fewer are noise."""
TURN_WITHIN_M, STRAIGHT_BEYOND_M = 1.5, 2.2
"""A patrol begins to turn when less than the first is free ahead, and goes straight again with the second."""
BLOCKED_M = 0.35
ASIDE_DEG = 30


@dataclass(frozen=True, slots=True)
class Clearance:
    """``free_m[k]`` is how far the ground is free in ``DIRECTIONS_DEG[k]``, REACH_M where nothing is seen."""

    free_m: tuple[float, ...]

    @property
    def ahead_m(self) -> float:
        """What is free straight ahead."""
        return self.free_m[DIRECTIONS_DEG.index(0)]

    @property
    def sides_m(self) -> tuple[float, float]:
        """Mean of what is free to the left and to the right."""
        left = [free for at, free in zip(DIRECTIONS_DEG, self.free_m, strict=True) if at > 0]
        right = [free for at, free in zip(DIRECTIONS_DEG, self.free_m, strict=True) if at < 0]
        return float(np.mean(left)), float(np.mean(right))


def clearance(chunks: Iterable[MapChunk], p_head_W: Float, heading_rad: float, floor_m: float) -> Clearance:
    """Return what is free around the head at ``p_head_W`` (3,) m; ``floor_m`` is the floor's height in W."""
    points = _obstacles(chunks, p_head_W, floor_m)
    free: list[float] = []
    for at_deg in DIRECTIONS_DEG:
        yaw = heading_rad + np.deg2rad(at_deg)
        along = points @ np.array([np.cos(yaw), np.sin(yaw)])
        across = points @ np.array([-np.sin(yaw), np.cos(yaw)])
        ahead = np.sort(along[(along > 0.0) & (np.abs(across) < HALF_WIDTH_M)])
        nearest = float(ahead[FEWEST_POINTS - 1]) if len(ahead) >= FEWEST_POINTS else REACH_M
        free.append(min(nearest, REACH_M))
    return Clearance(tuple(free))


def _obstacles(chunks: Iterable[MapChunk], p_head_W: Float, floor_m: float) -> Float:
    """Return the points that are in the way, (N, 2) m from the head."""
    near: list[Float] = []
    for chunk in chunks:
        if np.hypot(*(chunk.T_WK[:2, 3] - p_head_W[:2])) > REACH_M + CHUNK_REACH_M:
            continue
        points_W = se3.act(chunk.T_WK, np.asarray(chunk.points_K, dtype=np.float64)).reshape(-1, 3)
        offset = points_W[:, :2] - p_head_W[:2]
        height = points_W[:, 2] - floor_m
        near.append(offset[(height > LOWEST_M) & (height < HIGHEST_M) & (np.hypot(*offset.T) < REACH_M + HALF_WIDTH_M)])
    return np.concatenate(near) if near else np.zeros((0, 2))


def patrol_turn(free: Clearance, turning: int) -> int | None:
    """Return the turn of a patrol, -1 (right), 0 or 1 (left), after ``turning``; None where it can go no further.

    It turns towards the freer side and keeps to that side until the way ahead is free, so that it does not hesitate
    in a corner. It can go no further where the way ahead is blocked, and so is the one that it turns to.
    """
    if (turning == 0 and free.ahead_m > TURN_WITHIN_M) or (turning != 0 and free.ahead_m > STRAIGHT_BEYOND_M):
        return 0
    if turning == 0:
        left_m, right_m = free.sides_m
        turning = 1 if left_m >= right_m else -1
    aside_m = free.free_m[DIRECTIONS_DEG.index(ASIDE_DEG * turning)]
    return None if free.ahead_m < BLOCKED_M and aside_m < 1.5 * BLOCKED_M else turning
