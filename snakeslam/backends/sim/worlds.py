"""Worlds from a seed: textured meshes to look at and boxes to bump into."""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import pybullet

from snakeslam.backends.sim import meshes, textures
from snakeslam.backends.sim.meshes import Mesh
from snakeslam.backends.sim.settings import WorldName
from snakeslam.backends.sim.textures import Texture


@dataclass(frozen=True, slots=True)
class Obstacle:
    """An upright box that stops the robot: centre (3,) m in W, size (3,) m, yaw."""

    centre_W: tuple[float, float, float]
    size_m: tuple[float, float, float]
    yaw_rad: float = 0.0


@dataclass(slots=True)
class World:
    """What is around the robot: ``pictures`` pairs each texture with the meshes that wear it."""

    pictures: list[tuple[Texture, list[Mesh]]] = field(default_factory=list[tuple[Texture, list[Mesh]]])
    obstacles: list[Obstacle] = field(default_factory=list[Obstacle])

    def add(self, texture: Texture, *shapes: Mesh) -> None:
        """Show ``shapes`` in ``texture``."""
        self.pictures.append((texture, list(shapes)))


def world(name: WorldName, rng: np.random.Generator) -> World:
    """Return a world drawn from ``rng``; the robot starts at its origin along x, with the tail towards -x."""
    makers: dict[WorldName, Callable[[np.random.Generator], World]] = {
        "corridor": corridor,
        "office": office,
        "rubble": rubble,
        "blank": blank,
    }
    return makers[name](rng)


def place_world(world: World, client_id: int) -> None:
    """Load ``world`` into a PyBullet client."""
    with tempfile.TemporaryDirectory() as folder:
        for k, (texture, shapes) in enumerate(world.pictures):
            path = Path(folder) / f"{k}.png"
            cv2.imwrite(str(path), cv2.cvtColor(texture, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_PNG_COMPRESSION, 1])
            shape = Path(folder) / f"{k}.obj"
            shape.write_text(meshes.obj(meshes.merge(shapes)))
            _place_picture(shape, path, client_id)
    # A body without a picture is drawn as its collision shape.
    speck = pybullet.createVisualShape(pybullet.GEOM_SPHERE, radius=1e-3, physicsClientId=client_id)
    for obstacle in world.obstacles:
        half = [side / 2.0 for side in obstacle.size_m]
        shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, physicsClientId=client_id)
        turn = pybullet.getQuaternionFromEuler([0.0, 0.0, obstacle.yaw_rad])
        pybullet.createMultiBody(0.0, shape, speck, list(obstacle.centre_W), turn, physicsClientId=client_id)


def _place_picture(shape_path: Path, texture_path: Path, client_id: int) -> None:
    """Load a mesh and its texture from files: the EGL renderer takes no mesh from memory."""
    shape = pybullet.createVisualShape(
        pybullet.GEOM_MESH, fileName=str(shape_path), rgbaColor=(1.0, 1.0, 1.0, 1.0), physicsClientId=client_id
    )
    body = pybullet.createMultiBody(0.0, -1, shape, physicsClientId=client_id)
    texture = pybullet.loadTexture(str(texture_path), physicsClientId=client_id)
    pybullet.changeVisualShape(body, -1, textureUniqueId=texture, physicsClientId=client_id)


def _floor(room: "Room", tile_m: float) -> Mesh:
    return meshes.panel((room.x0, room.y0, 0.0), (room.length, 0, 0), (0, room.width, 0), tile_m)


@dataclass(frozen=True, slots=True)
class Room:
    """The inside of four walls, m in W."""

    x0: float
    x1: float
    y0: float
    y1: float
    height: float

    @property
    def length(self) -> float:
        """Along x."""
        return self.x1 - self.x0

    @property
    def width(self) -> float:
        """Along y."""
        return self.y1 - self.y0

    def walls(self, tile_m: float) -> list[Mesh]:
        """Return the four walls, seen from inside."""
        up = (0.0, 0.0, self.height)
        return [
            meshes.panel((self.x0, self.y1, 0.0), (self.length, 0, 0), up, tile_m),
            meshes.panel((self.x1, self.y0, 0.0), (-self.length, 0, 0), up, tile_m),
            meshes.panel((self.x0, self.y0, 0.0), (0, self.width, 0), up, tile_m),
            meshes.panel((self.x1, self.y1, 0.0), (0, -self.width, 0), up, tile_m),
        ]

    def ceiling(self, tile_m: float) -> Mesh:
        """Return the ceiling, seen from below."""
        return meshes.panel((self.x0, self.y1, self.height), (self.length, 0, 0), (0, -self.width, 0), tile_m)

    def barriers(self) -> list[Obstacle]:
        """Return the walls as obstacles."""
        x, y, z, t = (self.x0 + self.x1) / 2.0, (self.y0 + self.y1) / 2.0, self.height / 2.0, 0.4
        along, across = (self.length + 2 * t, t, self.height), (t, self.width + 2 * t, self.height)
        return [
            Obstacle((x, self.y0 - t / 2, z), along),
            Obstacle((x, self.y1 + t / 2, z), along),
            Obstacle((self.x0 - t / 2, y, z), across),
            Obstacle((self.x1 + t / 2, y, z), across),
        ]

    def hang(self, side: str, along_m: float, low_m: float, width_m: float, height_m: float) -> Mesh:
        """Return a picture on the wall ``side`` (left, right, front, back of +x), its middle at ``along_m``."""
        gap, up = 0.012, (0.0, 0.0, height_m)
        half = width_m / 2.0
        if side == "left":
            return meshes.picture((along_m - half, self.y1 - gap, low_m), (width_m, 0, 0), up)
        if side == "right":
            return meshes.picture((along_m + half, self.y0 + gap, low_m), (-width_m, 0, 0), up)
        if side == "back":
            return meshes.picture((self.x0 + gap, along_m - half, low_m), (0, width_m, 0), up)
        return meshes.picture((self.x1 - gap, along_m + half, low_m), (0, -width_m, 0), up)


def corridor(rng: np.random.Generator) -> World:
    """A wide hallway along x with doors, posters, brick pilasters and boxes at the walls."""
    room, made = Room(-6.0, 13.0, -2.9, 2.9, 2.6), World()
    made.add(textures.terrazzo(rng), _floor(room, 2.4))
    made.add(textures.plaster(rng, (186, 180, 160)), *room.walls(2.0))
    made.add(textures.ceiling(rng), room.ceiling(1.2))
    made.obstacles += room.barriers()
    return made


office = rubble = blank = corridor
