"""Puts a world's obstacles into a PyBullet client."""

from collections.abc import Sequence

import pybullet

from snakeslam.backends.sim.scenery import Obstacle

COMPOUND_SIZE = 16
"""The most shapes that PyBullet takes in one body."""


def add_obstacles(obstacles: Sequence[Obstacle], client_id: int) -> None:
    """Add ``obstacles``, several boxes as one body: a body for each makes a step of the physics five times as long."""
    for first in range(0, len(obstacles), COMPOUND_SIZE):
        _add_compound(obstacles[first : first + COMPOUND_SIZE], client_id)


def _add_compound(obstacles: Sequence[Obstacle], client_id: int) -> None:
    shape = pybullet.createCollisionShapeArray(
        shapeTypes=[pybullet.GEOM_BOX] * len(obstacles),
        halfExtents=[[side / 2.0 for side in obstacle.size_m] for obstacle in obstacles],
        collisionFramePositions=[list(obstacle.centre_W) for obstacle in obstacles],
        collisionFrameOrientations=[pybullet.getQuaternionFromEuler([0.0, 0.0, o.yaw_rad]) for o in obstacles],
        physicsClientId=client_id,
    )
    pybullet.createMultiBody(0.0, shape, physicsClientId=client_id)
