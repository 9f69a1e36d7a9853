"""The map and the trajectories of the live session."""

from asyncio import to_thread
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from fastapi import APIRouter
from starlette.responses import Response

from server.deps import Rooms
from snakeslam.mapping.export import write_ply
from snakeslam.messages import MapChunk

router = APIRouter(tags=["map"])


@router.get("/map")
async def get_map(house: Rooms) -> dict[str, int]:
    """How large the map is."""
    chunks = house.live.view.chunks.values()
    return {"chunks": len(chunks), "points": sum(len(chunk.points_K) for chunk in chunks)}


@router.get("/map.ply")
async def get_map_ply(house: Rooms) -> Response:
    """The map as a PLY file, in the estimate's world frame."""
    chunks = house.live.view.chunks
    data = await to_thread(_ply, [chunks[key] for key in sorted(chunks)])
    headers = {"Content-Disposition": 'attachment; filename="map.ply"'}
    return Response(data, headers=headers, media_type="application/octet-stream")


@router.get("/trajectory")
async def get_trajectory(house: Rooms) -> dict[str, Any]:
    """Estimate and truth as rows of t_s, x, y, z; the truth is brought to the estimate's first pose."""
    view = house.live.view
    return {"estimate": view.estimate.rows, "truth": view.truth.rows}


def _ply(chunks: list[MapChunk]) -> bytes:
    with TemporaryDirectory(prefix="snakeslam-") as folder:
        path = Path(folder) / "map.ply"
        write_ply(path, chunks)
        return path.read_bytes()
