"""Triangle meshes with their own texture coordinates; lengths in m, faces seen from outside."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snakeslam.messages import Float


@dataclass(frozen=True, slots=True)
class Mesh:
    """``vertices_W`` and ``normals_W`` (V, 3), ``uvs`` (V, 2) in texture widths, ``triangles`` (T, 3)."""

    vertices_W: Float
    normals_W: Float
    uvs: Float
    triangles: NDArray[np.int64]


def merge(meshes: Sequence[Mesh]) -> Mesh:
    """Return all ``meshes`` as one."""
    offsets = np.cumsum([0, *(len(mesh.vertices_W) for mesh in meshes[:-1])])
    return Mesh(
        np.concatenate([mesh.vertices_W for mesh in meshes]),
        np.concatenate([mesh.normals_W for mesh in meshes]),
        np.concatenate([mesh.uvs for mesh in meshes]),
        np.concatenate([mesh.triangles + k for mesh, k in zip(meshes, offsets, strict=True)]),
    )


def quad(corner_W: Sequence[float], right_W: Sequence[float], up_W: Sequence[float], uv: Float) -> Mesh:
    """Return a rectangle seen from right x up; lower left ``corner_W``, ``uv`` [[u0, v0], [u1, v1]]."""
    corner, right, up = (np.asarray(a, dtype=np.float64) for a in (corner_W, right_W, up_W))
    normal = np.cross(right, up)
    (u0, v0), (u1, v1) = np.asarray(uv, dtype=np.float64)
    return Mesh(
        np.array([corner, corner + right, corner + right + up, corner + up]),
        np.tile(normal / np.linalg.norm(normal), (4, 1)),
        np.array([[u0, v0], [u1, v0], [u1, v1], [u0, v1]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )


def panel(corner_W: Sequence[float], right_W: Sequence[float], up_W: Sequence[float], tile_m: float) -> Mesh:
    """Return a rectangle whose texture repeats every ``tile_m``, phased by its position so that neighbours differ."""
    size = np.array([np.linalg.norm(right_W), np.linalg.norm(up_W)]) / tile_m
    phase = np.modf(np.abs(np.asarray(corner_W)) @ np.array([[0.37, 0.0], [0.61, 0.0], [0.0, 1.0 / tile_m]]))[0]
    return quad(corner_W, right_W, up_W, np.array([phase, phase + size], dtype=np.float64))


def poster(corner_W: Sequence[float], right_W: Sequence[float], up_W: Sequence[float]) -> Mesh:
    """Return a rectangle that shows its texture once."""
    return quad(corner_W, right_W, up_W, np.array([[0.0, 0.0], [1.0, 1.0]]))


def box(centre_W: Sequence[float], size_m: Sequence[float], yaw_rad: float = 0.0, tile_m: float | None = None) -> Mesh:
    """Return an upright box; each side shows the texture once, or repeats it every ``tile_m``."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    x, y, z = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) * np.asarray(size_m)[:, None]
    faces = [(x, -y, z), (-x, y, z), (y, x, z), (-y, -x, z), (z, -y, x), (-z, -y, -x)]
    sides: list[Mesh] = []
    for outward, right, up in faces:
        right = right if np.dot(np.cross(right, up), outward) > 0 else -right
        corner = np.asarray(centre_W) + (outward - right - up) / 2.0
        sides.append(poster(corner, right, up) if tile_m is None else panel(corner, right, up, tile_m))
    return merge(sides)


def cylinder(radius_m: float, x0_m: float, x1_m: float, sides: int) -> Mesh:
    """Return a closed cylinder about the x axis, round to the light; its texture shows one colour."""
    turn = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    outward = np.stack([np.zeros(sides), np.cos(turn), np.sin(turn)], axis=-1)
    back, front = (radius_m * outward + [x_m, 0.0, 0.0] for x_m in (x0_m, x1_m))
    along = np.array([1.0, 0.0, 0.0])
    first, second = np.arange(sides), np.roll(np.arange(sides), -1)
    mantle = [(first, second, second + sides), (first, second + sides, first + sides)]
    fan = np.arange(1, sides - 1)
    ends = [(0 * fan, fan + 1, fan), (0 * fan + sides, sides + fan, sides + fan + 1)]
    return Mesh(
        np.concatenate([back, front, back, front]),
        np.concatenate([outward, outward, np.tile(-along, (sides, 1)), np.tile(along, (sides, 1))]),
        np.zeros((4 * sides, 2)),
        np.concatenate([np.stack(t, axis=-1) for t in mantle] + [np.stack(t, axis=-1) + 2 * sides for t in ends]),
    )


def rock(
    rng: np.random.Generator, centre_W: Sequence[float], size_m: Sequence[float], tile_m: float, cells: int = 6
) -> Mesh:
    """Return a broken stone: a box-mapped sphere flattened by random planes, flat shaded, inside ``size_m``."""
    grid = np.linspace(-1.0, 1.0, cells + 1)
    a, b = np.meshgrid(np.tan(grid * np.pi / 4), np.tan(grid * np.pi / 4), indexing="ij")
    directions = rng.normal(size=(9, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    cuts = rng.uniform(0.55, 0.95, 9)
    half, yaw = np.asarray(size_m) / 2.0, rng.uniform(0.0, 2.0 * np.pi)
    c, s = np.cos(yaw), np.sin(yaw)
    spin = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    faces: list[Mesh] = []
    for axis in range(3):
        for sign in (1.0, -1.0):
            n = np.full_like(a, sign)
            p = np.roll(np.stack([n, a * sign, b], axis=-1), axis, axis=-1)
            p /= np.linalg.norm(p, axis=-1, keepdims=True)
            reach = np.min(cuts / np.maximum(p @ directions.T, 1e-3), axis=-1)
            p = p * np.minimum(reach, 1.0)[..., None] * half
            faces.append(_facets(p @ spin.T + np.asarray(centre_W), a, b, tile_m / float(np.max(half)), rng))
    return merge(faces)


def _facets(grid_W: Float, a: Float, b: Float, tile: float, rng: np.random.Generator) -> Mesh:
    """Return the flat shaded triangles of a grid of points (n, n, 3), texture mapped by its two coordinates."""
    uv = np.stack([a, b], axis=-1) / tile / 2.0 + rng.uniform(size=2)
    corners = [(slice(None, -1), slice(None, -1)), (slice(1, None), slice(None, -1))]
    corners += [(slice(1, None), slice(1, None)), (slice(None, -1), slice(1, None))]
    points, coords = [grid_W[c].reshape(-1, 3) for c in corners], [uv[c].reshape(-1, 2) for c in corners]
    order = [0, 1, 2, 0, 2, 3]
    vertices = np.stack([points[k] for k in order], axis=1).reshape(-1, 3, 3)
    normals = np.cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return Mesh(
        vertices.reshape(-1, 3),
        np.repeat(normals, 3, axis=0),
        np.stack([coords[k] for k in order], axis=1).reshape(-1, 2),
        np.arange(len(vertices) * 3).reshape(-1, 3),
    )
