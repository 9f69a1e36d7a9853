"""The free distance around the robot, from the map, and the steering of a patrol in front of a wall."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from snakeslam.geometry import se3
from snakeslam.messages import Float, MapChunk

DIRECTIONS_DEG = tuple(range(-90, 91, 15))
"""Directions against the heading, positive to the left."""
REACH_M = 3.0
"""Distances are measured up to here."""
HALF_WIDTH_M = 0.3
"""Half the width of the strip that must be free: the body swings by 0.2 m to either side."""
LOWEST_M, HIGHEST_M = 0.06, 0.4
"""Heights above the floor between which a point is an obstacle: above the noise of the floor, below a table."""
CHUNK_REACH_M = 6.0
"""Largest distance of a chunk's points from its keyframe: the range of a depth camera."""
FEWEST_POINTS = 3
"""Points that make an obstacle; fewer are noise."""
STEER_WITHIN_M, STRAIGHT_BEYOND_M = 1.5, 2.2
"""A patrol begins to steer when less than the first is free ahead, and goes straight again with the second."""
BLOCKED_M = 0.35
"""With less free ahead the robot cannot go on."""
BLOCKED_ASIDE = 1.5
"""Factor on BLOCKED_M for the direction to which it steers."""
ASIDE_DEG = 30
"""That direction, from straight ahead."""


@dataclass(frozen=True, slots=True)
class Clearance:
    """``free_m[k]`` is the free distance in ``DIRECTIONS_DEG[k]``, REACH_M where there is no obstacle."""

    free_m: tuple[float, ...]

    @property
    def ahead_m(self) -> float:
        """The free distance straight ahead."""
        return self.free_m[DIRECTIONS_DEG.index(0)]

    @property
    def sides_m(self) -> tuple[float, float]:
        """Mean free distance to the left and to the right."""
        left = [free for at, free in zip(DIRECTIONS_DEG, self.free_m, strict=True) if at > 0]
        right = [free for at, free in zip(DIRECTIONS_DEG, self.free_m, strict=True) if at < 0]
        return float(np.mean(left)), float(np.mean(right))


def clearance(chunks: Iterable[MapChunk], p_head_W: Float, heading_rad: float, floor_m: float) -> Clearance:
    """Return the free distances around the head at ``p_head_W`` (3,) m; ``floor_m`` is the floor's height in W.

    In each direction it is the distance of the third nearest obstacle point within a strip of HALF_WIDTH_M.
    """
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
    """Return the horizontal positions of the obstacle points, (N, 2) m from the head."""
    near: list[Float] = []
    for chunk in chunks:
        if np.hypot(*(chunk.T_WK[:2, 3] - p_head_W[:2])) > REACH_M + CHUNK_REACH_M:
            continue
        points_W = se3.act(chunk.T_WK, np.asarray(chunk.points_K, dtype=np.float64)).reshape(-1, 3)
        offset = points_W[:, :2] - p_head_W[:2]
        height = points_W[:, 2] - floor_m
        near.append(offset[(height > LOWEST_M) & (height < HIGHEST_M) & (np.hypot(*offset.T) < REACH_M + HALF_WIDTH_M)])
    return np.concatenate(near) if near else np.zeros((0, 2))


def patrol_steering(free: Clearance, turning: int) -> int | None:
    """Return the steering of a patrol, -1 (right), 0 or 1 (left), after ``turning``; None where it is blocked.

    It steers to the freer side and stays with that side until the way ahead is free, so that it does not alternate in
    a corner. It is blocked where there is an obstacle ahead and one in the direction to which it steers.
    """
    if (turning == 0 and free.ahead_m > STEER_WITHIN_M) or (turning != 0 and free.ahead_m > STRAIGHT_BEYOND_M):
        return 0
    if turning == 0:
        left_m, right_m = free.sides_m
        turning = 1 if left_m >= right_m else -1
    aside_m = free.free_m[DIRECTIONS_DEG.index(ASIDE_DEG * turning)]
    return None if free.ahead_m < BLOCKED_M and aside_m < BLOCKED_ASIDE * BLOCKED_M else turning
