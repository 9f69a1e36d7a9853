"""Export of the map as a PLY file."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from snakeslam.geometry import se3
from snakeslam.messages import MapChunk

VERTEX = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")])
PLY_NAMES = {"<f4": "float", "|u1": "uchar"}


def write_ply(path: Path, chunks: Sequence[MapChunk]) -> None:
    """Write all points in W (m) with their colours as a binary little-endian PLY [Turk94]; an empty map is allowed.

    The file is written beside ``path`` and then renamed, so that ``path`` is always complete.
    """
    part = path.with_name(f".{path.name}.part")
    part.write_bytes(ply_bytes([ply_vertices(chunk) for chunk in chunks]))
    part.replace(path)


def ply_bytes(vertices: Sequence[NDArray[np.void]]) -> bytes:
    """Return the PLY file of all ``vertices``, arrays of VERTEX."""
    properties = [f"property {PLY_NAMES[VERTEX[name].str]} {name}" for name in VERTEX.names or ()]
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {sum(map(len, vertices))}",
        *properties,
        "end_header",
        "",
    ]
    return b"".join(["\n".join(header).encode(), *(part.tobytes() for part in vertices)])


def ply_vertices(chunk: MapChunk) -> NDArray[np.void]:
    """Return a chunk's points in W (m) with their colours, (N,) of VERTEX."""
    points_W = se3.act(chunk.T_WK, chunk.points_K.astype(np.float64))
    out = np.empty(len(points_W), VERTEX)
    for axis, name in enumerate("xyz"):
        out[name] = points_W[:, axis]
    for channel, name in enumerate(("red", "green", "blue")):
        out[name] = chunk.rgb[:, channel]
    return out
