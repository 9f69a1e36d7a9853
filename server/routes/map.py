"""The map and the trajectories of the live session."""

from fastapi import APIRouter
from starlette.responses import JSONResponse, Response

from server.bulk import BulkResponse
from server.deps import Rooms, Who

router = APIRouter(tags=["map"])


@router.get("/map")
async def get_map(house: Rooms) -> dict[str, int]:
    """How large the map is."""
    chunks = house.live.view.chunks.values()
    return {"chunks": len(chunks), "points": sum(len(chunk.points_K) for chunk in chunks)}


@router.get("/map.ply", response_class=Response)
async def get_map_ply(house: Rooms, who: Who) -> Response:
    """The map as a PLY file, in the estimate's world frame; at most a second old."""
    return BulkResponse(house.bulk, who, house.map_file.get, "application/octet-stream", "map.ply")


@router.get("/trajectory", response_class=JSONResponse)
async def get_trajectory(house: Rooms, who: Who) -> Response:
    """Estimate and truth as rows of t_s, x, y, z; the truth is brought to the estimate's first pose."""

    async def text() -> bytes:
        view = house.live.view
        return f'{{"estimate":[{view.estimate.text()}],"truth":[{view.truth.text()}]}}'.encode()

    return BulkResponse(house.bulk, who, text, "application/json")
