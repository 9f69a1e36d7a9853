"""Loads a world into a PyBullet client."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

import cv2
import pybullet

from snakeslam.backends.sim import meshes
from snakeslam.backends.sim.scenery import Obstacle, World

COMPOUND_SIZE = 16
"""The most shapes that PyBullet takes in one body."""


def place_world(world: World, client_id: int, pictures: bool = True) -> None:
    """Add the pictures (where they are wanted) and obstacles of ``world``.

    The (uncompressed) files they go through are removed again.
    """
    with tempfile.TemporaryDirectory() as folder:
        for k, (texture, shapes) in enumerate(world.pictures if pictures else ()):
            picture, shape = Path(folder) / f"{k}.bmp", Path(folder) / f"{k}.obj"
            cv2.imwrite(str(picture), cv2.cvtColor(texture, cv2.COLOR_RGB2BGR))
            shape.write_text(meshes.obj(meshes.merge(shapes)))
            _place_picture(shape, picture, client_id)
    for first in range(0, len(world.obstacles), COMPOUND_SIZE):
        _place_obstacles(world.obstacles[first : first + COMPOUND_SIZE], client_id)


def _place_obstacles(obstacles: Sequence[Obstacle], client_id: int) -> None:
    """Load several boxes as one body: a body for each makes a step of the physics five times as long."""
    shape = pybullet.createCollisionShapeArray(
        shapeTypes=[pybullet.GEOM_BOX] * len(obstacles),
        halfExtents=[[side / 2.0 for side in obstacle.size_m] for obstacle in obstacles],
        collisionFramePositions=[list(obstacle.centre_W) for obstacle in obstacles],
        collisionFrameOrientations=[pybullet.getQuaternionFromEuler([0.0, 0.0, o.yaw_rad]) for o in obstacles],
        physicsClientId=client_id,
    )
    # A body without a picture would be drawn as its collision shape.
    speck = pybullet.createVisualShape(
        pybullet.GEOM_SPHERE, radius=1e-3, visualFramePosition=[0.0, 0.0, -1.0], physicsClientId=client_id
    )
    pybullet.createMultiBody(0.0, shape, speck, physicsClientId=client_id)


def _place_picture(shape_path: Path, texture_path: Path, client_id: int) -> None:
    """Load a mesh and its texture from files: the EGL renderer takes no mesh from memory."""
    shape = pybullet.createVisualShape(
        pybullet.GEOM_MESH, fileName=str(shape_path), rgbaColor=(1.0, 1.0, 1.0, 1.0), physicsClientId=client_id
    )
    body = pybullet.createMultiBody(0.0, -1, shape, physicsClientId=client_id)
    texture = pybullet.loadTexture(str(texture_path), physicsClientId=client_id)
    pybullet.changeVisualShape(body, -1, textureUniqueId=texture, physicsClientId=client_id)
