"""What a world is made of: textured meshes, boxes that stop the robot, and buildings' interiors."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from snakeslam.backends.sim import meshes
from snakeslam.backends.sim.meshes import Mesh
from snakeslam.backends.sim.textures import Texture

POSTER_GAP_M = 0.04
"""Far enough from the wall for the depth buffer to tell them apart at 10 m."""
BAND_GAP_M = 0.02
WALL_THICKNESS_M = 0.4
UNDERLAY_M = 0.06


@dataclass(frozen=True, slots=True)
class Obstacle:
    """An upright box that stops the robot: centre (3,) m in W, size (3,) m, yaw."""

    centre_W: tuple[float, float, float]
    size_m: tuple[float, float, float]
    yaw_rad: float = 0.0


@dataclass(slots=True)
class World:
    """What is around the robot: ``surfaces`` pairs each texture with the meshes that wear it."""

    surfaces: list[tuple[Texture, list[Mesh]]] = field(default_factory=list[tuple[Texture, list[Mesh]]])
    obstacles: list[Obstacle] = field(default_factory=list[Obstacle])

    def add(self, texture: Texture, shapes: Sequence[Mesh]) -> None:
        """Show ``shapes`` in ``texture``."""
        if shapes:
            self.surfaces.append((texture, list(shapes)))

    def block(
        self, x_m: float, y_m: float, size_m: tuple[float, float, float], yaw_rad: float = 0.0, low_m: float = 0.0
    ) -> tuple[tuple[float, float, float], tuple[float, float, float], float]:
        """Add an obstacle that stands ``low_m`` over the ground; return its centre, size and yaw for ``meshes.box``."""
        centre_W = (x_m, y_m, low_m + size_m[2] / 2.0)
        self.obstacles.append(Obstacle(centre_W, size_m, yaw_rad))
        return centre_W, size_m, yaw_rad


@dataclass(frozen=True, slots=True)
class Interior:
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

    def floor(self, tile_m: float) -> Mesh:
        """Return the ground at z = 0, and once more just below.

        The second is what a camera close over the ground sees where its near plane cuts the first away.
        """
        right, up = (self.length, 0, 0), (0, self.width, 0)
        return meshes.merge([meshes.panel((self.x0, self.y0, z), right, up, tile_m) for z in (0.0, -UNDERLAY_M)])

    def ceiling(self, tile_m: float) -> Mesh:
        """Return the ceiling, seen from below."""
        return meshes.panel((self.x0, self.y1, self.height), (self.length, 0, 0), (0, -self.width, 0), tile_m)

    def walls(self, sides: Sequence[str], tile_m: float, low_m: float, high_m: float, gap_m: float = 0.0) -> list[Mesh]:
        """Return a band of the walls ``sides`` (left, right, front, back of +x), seen from inside."""
        band: list[Mesh] = []
        for side in sides:
            corner, right = self._wall(side, gap_m)
            band.append(meshes.panel((*corner, low_m), (*right, 0.0), (0, 0, high_m - low_m), tile_m))
        return band

    def barriers(self) -> list[Obstacle]:
        """Return the walls as obstacles."""
        x, y, z, t = (self.x0 + self.x1) / 2.0, (self.y0 + self.y1) / 2.0, self.height / 2.0, WALL_THICKNESS_M
        along, across = (self.length + 2 * t, t, self.height), (t, self.width + 2 * t, self.height)
        return [
            Obstacle((x, self.y0 - t / 2, z), along),
            Obstacle((x, self.y1 + t / 2, z), along),
            Obstacle((self.x0 - t / 2, y, z), across),
            Obstacle((self.x1 + t / 2, y, z), across),
        ]

    def hang(self, side: str, along_m: float, low_m: float, width_m: float, height_m: float) -> Mesh:
        """Return a poster on the wall ``side``, its middle at ``along_m`` (x, or y at front and back)."""
        corner, right = self._wall(side, POSTER_GAP_M)
        unit = np.asarray(right) / np.linalg.norm(right)
        start = abs(along_m - (corner[0] if side in ("left", "right") else corner[1])) - width_m / 2.0
        x, y = np.asarray(corner) + unit * start
        return meshes.poster((float(x), float(y), low_m), (*(unit * width_m).tolist(), 0.0), (0.0, 0.0, height_m))

    def _wall(self, side: str, gap_m: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return a wall's lower left corner seen from inside and its run to the right, (x, y)."""
        x0, x1, y0, y1 = self.x0 + gap_m, self.x1 - gap_m, self.y0 + gap_m, self.y1 - gap_m
        return {
            "left": ((x0, y1), (x1 - x0, 0.0)),
            "right": ((x1, y0), (x0 - x1, 0.0)),
            "back": ((x0, y0), (0.0, y1 - y0)),
            "front": ((x1, y1), (0.0, y0 - y1)),
        }[side]
