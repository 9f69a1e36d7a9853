"""The four worlds, each drawn from a seed.

The robot starts over the origin along x with its tail towards -x (up to 3.3 m); several metres ahead and to both sides
are free, so that it may sway, steer and roll; to the left, where sidewinding moves at 0.15 m/s, more.
"""

from collections.abc import Callable

import numpy as np

from snakeslam.backends.sim import meshes, textures
from snakeslam.backends.sim.meshes import Mesh
from snakeslam.backends.sim.scenery import BAND_GAP_M, Interior, World
from snakeslam.backends.sim.settings import WorldName

CLEAR_RIGHT_M, CLEAR_LEFT_M = 2.4, 3.4
AHEAD_M = 6.0
SIDES = ("left", "right", "back", "front")


def world(name: WorldName, rng: np.random.Generator) -> World:
    """Return the world ``name`` drawn from ``rng``."""
    makers: dict[WorldName, Callable[[np.random.Generator], World]] = {
        "corridor": corridor,
        "office": office,
        "rubble": rubble,
        "blank": blank,
    }
    return makers[name](rng)


def corridor(rng: np.random.Generator) -> World:
    """A wide hallway along x: brick and plaster walls, doors, posters, pilasters, boxes, papers on the floor."""
    hall, made = Interior(-6.5, 10.0, -3.4, 4.2, 2.8), World()
    made.obstacles += hall.barriers()
    brick = hall.walls(SIDES, 1.6, 0.0, 0.9, BAND_GAP_M)
    for k, x in enumerate(np.arange(-5.5, 10.0, 3.0).tolist()):
        y = 4.08 if k % 2 else -3.28
        brick.append(meshes.box(*made.block(x + rng.uniform(-0.3, 0.3), y, (0.35, 0.25, 2.8)), tile_m=1.6))
    made.add(textures.terrazzo(rng), [hall.floor(2.4)])
    made.add(textures.bricks(rng), brick)
    made.add(textures.plaster(rng, (190, 182, 160)), hall.walls(SIDES, 2.0, 0.0, 2.8))
    made.add(textures.ceiling(rng), [hall.ceiling(1.2)])
    doors = [hall.hang(side, x, 0.0, 0.95, 2.05) for side, x in (("left", -2.6), ("left", 3.6), ("right", 0.8))]
    made.add(
        textures.door(rng), [*doors, hall.hang("right", 6.8, 0.0, 0.95, 2.05), hall.hang("front", 1.4, 0, 0.95, 2.05)]
    )
    _hang_posters(rng, made, hall, 6, 22)
    _stack_boxes(rng, made, hall, 14)
    _drop_papers(rng, made, 40)
    return made


def office(rng: np.random.Generator) -> World:
    """A large office with carpet tiles: desks, bookshelves, drawers, chairs, boxes and notices."""
    hall, made = Interior(-6.5, 9.5, -4.4, 5.4, 2.7), World()
    made.obstacles += hall.barriers()
    made.add(textures.carpet(rng), [hall.floor(2.0)])
    made.add(textures.plaster(rng, (184, 190, 194), wear=0.6), hall.walls(SIDES, 2.4, 0.0, 2.7))
    made.add(textures.ceiling(rng), [hall.ceiling(1.2)])
    wood: list[Mesh] = hall.walls(SIDES, 0.8, 0.0, 0.1, BAND_GAP_M)
    dark: list[Mesh] = []
    for x in np.arange(-5.2, 8.5, 2.3).tolist():
        for y in (-3.3, 4.2):
            _desk(rng, made, wood, dark, x + rng.uniform(-0.25, 0.25), y + rng.uniform(-0.1, 0.1))
    made.add(textures.planks(rng, colour=(176, 142, 102)), wood)
    made.add(textures.plaster(rng, (74, 78, 86), 512), dark)
    _stand_shelves(rng, made, hall)
    _hang_posters(rng, made, hall, 6, 26)
    _stack_boxes(rng, made, hall, 12)
    _drop_papers(rng, made, 36)
    return made


def rubble(rng: np.random.Generator) -> World:
    """Open ground between broken walls, with stones and lumps of masonry; no ceiling.

    Pebbles under 4 cm lie about too, loose: they do not stop the robot.
    """
    hall, made = Interior(-8.0, 10.5, -7.0, 7.0, 4.5), World()
    made.obstacles += hall.barriers()
    made.add(textures.gravel(rng), [hall.floor(2.6)])
    made.add(textures.stone(rng), hall.walls(("left", "front"), 3.0, 0.0, 4.5))
    masonry = hall.walls(("right", "back"), 2.4, 0.0, 4.5)
    heaps: tuple[list[Mesh], list[Mesh]] = ([], [])
    for k in range(130):
        size = float(np.exp(rng.uniform(np.log(0.1), np.log(1.3))))
        x, y = _free_spot(rng, hall, size / 2.0 + 0.1)
        shape_m = (size, size * rng.uniform(0.6, 1.0), size * rng.uniform(0.4, 1.1))
        heaps[k % 2].append(meshes.rock(rng, (x, y, shape_m[2] * 0.25), shape_m, 0.9))
        made.block(x, y, (size * 0.75, shape_m[1] * 0.75, shape_m[2] * 0.7))
    for _ in range(9):
        x, y = _free_spot(rng, hall, 0.9)
        masonry.append(
            meshes.box(*made.block(x, y, (1.4, 0.3, rng.uniform(0.3, 1.6)), rng.uniform(0, np.pi)), tile_m=1.6)
        )
    for k in range(260):
        size = rng.uniform(0.012, 0.035)
        spot = (rng.uniform(-4.0, AHEAD_M + 2.0), rng.uniform(-3.0, 3.6), 0.1 * size)
        heaps[k % 2].append(meshes.rock(rng, spot, (size, 0.8 * size, 0.7 * size), 0.5, 2))
    made.add(textures.bricks(rng), masonry)
    made.add(textures.stone(rng, (146, 138, 126)), heaps[0])
    made.add(textures.stone(rng, (124, 106, 92)), heaps[1])
    return made


def blank(rng: np.random.Generator) -> World:
    """A hall of smooth paint and one floor covering: a skirting, two doors, few notices and little else to see."""
    hall, made = Interior(-6.5, 10.0, -3.4, 4.2, 2.6), World()
    made.obstacles += hall.barriers()
    made.add(textures.plaster(rng, (150, 152, 150), wear=0.15), [hall.floor(3.0)])
    made.add(textures.plaster(rng, (196, 196, 190), wear=0.0), hall.walls(SIDES, 4.0, 0.0, 2.6))
    made.add(textures.plaster(rng, (204, 204, 202), wear=0.0), [hall.ceiling(4.0)])
    made.add(textures.plaster(rng, (96, 92, 88), 512, wear=0.0), hall.walls(SIDES, 2.0, 0.0, 0.12, BAND_GAP_M))
    made.add(textures.door(rng), [hall.hang("left", 2.5, 0.0, 0.95, 2.05), hall.hang("front", -1.0, 0.0, 0.95, 2.05)])
    _hang_posters(rng, made, hall, 2, 9)
    return made


def _hang_posters(rng: np.random.Generator, made: World, hall: Interior, kinds: int, count: int) -> None:
    sheets = [textures.poster(rng) for _ in range(kinds)]
    placed: list[list[Mesh]] = [[] for _ in sheets]
    taken: list[tuple[str, float, float]] = []
    for k in range(count):
        width = rng.uniform(0.35, 0.75)
        side, along = _free_wall(rng, hall, taken, width)
        placed[k % kinds].append(hall.hang(side, along, rng.uniform(0.25, 1.35), width, width * 1.5))
    for sheet, shapes in zip(sheets, placed, strict=True):
        made.add(sheet, shapes)


def _free_wall(
    rng: np.random.Generator, hall: Interior, taken: list[tuple[str, float, float]], width_m: float
) -> tuple[str, float]:
    """Return a side and a position on it that no other sheet has, and add it to ``taken``; if none is left, any."""
    side, along = "left", 0.0
    for _ in range(20):
        side = SIDES[int(rng.choice(4, p=[0.36, 0.36, 0.06, 0.22]))]
        low, high = (hall.x0, hall.x1) if side in ("left", "right") else (hall.y0, hall.y1)
        along = rng.uniform(low + 0.6, high - 0.6)
        if all(side != s or abs(along - a) > (width_m + w) / 2.0 + 0.05 for s, a, w in taken):
            break
    taken.append((side, along, width_m))
    return side, along


def _stack_boxes(rng: np.random.Generator, made: World, hall: Interior, count: int) -> None:
    """Put cardboard boxes along the walls, some on top of others."""
    kinds = [textures.cardboard(rng) for _ in range(2)]
    placed: tuple[list[Mesh], list[Mesh]] = ([], [])
    for k in range(count):
        size = rng.uniform(0.22, 0.42, 3)
        x, y = _free_spot(rng, hall, 0.3)
        block = made.block(x, y, (float(size[0]), float(size[1]), float(size[2])), rng.uniform(0, np.pi))
        placed[k % 2].append(meshes.box(*block))
        if rng.random() < 0.5:
            upper = (float(size[0]) * 0.8, float(size[1]) * 0.8, float(size[2]) * 0.7)
            placed[(k + 1) % 2].append(meshes.box(*made.block(x, y, upper, rng.uniform(0, np.pi), float(size[2]))))
    for texture, shapes in zip(kinds, placed, strict=True):
        made.add(texture, shapes)


def _drop_papers(rng: np.random.Generator, made: World, count: int) -> None:
    """Leave flat sheets, tape and wrappers on the floor; they are too thin to bump into."""
    kinds = [textures.poster(rng, 512, 512) for _ in range(3)]
    placed: list[list[Mesh]] = [[] for _ in kinds]
    for k in range(count):
        size, yaw = rng.uniform(0.05, 0.22), rng.uniform(0, 2 * np.pi)
        right = (size * np.cos(yaw), size * np.sin(yaw), 0.0)
        up = (-0.7 * size * np.sin(yaw), 0.7 * size * np.cos(yaw), 0.0)
        corner = (rng.uniform(-4.0, 8.5), rng.uniform(-3.0, 3.6), 0.0015 + 0.0002 * k)
        placed[k % len(kinds)].append(meshes.poster(corner, right, up))
    for texture, shapes in zip(kinds, placed, strict=True):
        made.add(texture, shapes)


def _stand_shelves(rng: np.random.Generator, made: World, hall: Interior) -> None:
    texture, shapes = textures.bookshelf(rng), list[Mesh]()
    for x in (-3.5, 0.2, 3.9, 7.0):
        for y in (hall.y0 + 0.16, hall.y1 - 0.16):
            shapes.append(meshes.box(*made.block(x + rng.uniform(-0.4, 0.4), y, (1.2, 0.3, rng.uniform(1.5, 2.1)))))
    for y in (-2.9, 0.3, 2.9):
        shapes.append(meshes.box(*made.block(hall.x1 - 0.16, y + rng.uniform(-0.3, 0.3), (0.3, 1.3, 1.9))))
    made.add(texture, shapes)


def _desk(rng: np.random.Generator, made: World, wood: list[Mesh], dark: list[Mesh], x_m: float, y_m: float) -> None:
    """Add a desk with legs, a drawer unit and, mostly, a chair's foot and seat."""
    wood.append(meshes.box(*made.block(x_m, y_m, (1.5, 0.75, 0.04), low_m=0.7), tile_m=0.9))
    feet = [(x_m + dx, y_m + dy) for dx in (-0.7, 0.7) for dy in (-0.33, 0.33)]
    dark += [meshes.box(*made.block(x, y, (0.05, 0.05, 0.7)), tile_m=0.5) for x, y in feet]
    wood.append(meshes.box(*made.block(x_m + rng.uniform(-0.4, 0.4), y_m, (0.42, 0.55, 0.6)), tile_m=0.9))
    if rng.random() < 0.7:
        x, y = x_m + rng.uniform(-0.5, 0.5), y_m - np.sign(y_m) * 0.3
        dark.append(meshes.box(*made.block(x, y, (0.06, 0.06, 0.45)), tile_m=0.5))
        dark.append(meshes.box(*made.block(x, y, (0.42, 0.4, 0.06), rng.uniform(0, 1.0), 0.45), tile_m=0.5))


def _free_spot(rng: np.random.Generator, hall: Interior, margin_m: float) -> tuple[float, float]:
    """Return a position inside the hall and outside the part that is kept clear."""
    while True:
        x, y = rng.uniform(hall.x0 + margin_m, hall.x1 - margin_m), rng.uniform(hall.y0 + margin_m, hall.y1 - margin_m)
        if y < -CLEAR_RIGHT_M - margin_m or y > CLEAR_LEFT_M + margin_m or x > AHEAD_M + margin_m:
            return x, y
