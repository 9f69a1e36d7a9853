"""The map and the trajectories of the live session."""

from typing import Annotated, Literal

import numpy as np
from fastapi import APIRouter, Query
from pydantic import Field
from starlette.responses import Response

from server.body import heading_rad
from server.bulk import BulkResponse
from server.deps import CallerDep, ServicesDep
from server.models import Answer
from snakeslam.mapping.clearance import DIRECTIONS_DEG, clearance, patrol_steering

router = APIRouter(tags=["map"])


class MapAnswer(Answer):
    """How large the map is."""

    chunks: int
    points: int


class ClearanceAnswer(Answer):
    """How far the ground is known to be free around the head, and what a patrol does next."""

    directions_deg: list[int]
    """Against the heading, positive to the left."""
    free_m: list[float] | None
    """For each direction; null where the robot's pose is unknown."""
    turn: Literal[-1, 0, 1] | None
    """To the right, straight on, to the left; null where a patrol can go no further."""
    reason: str | None
    """Why it can go no further."""


Row = Annotated[list[float], Field(min_length=4, max_length=4)]


class TrajectoryAnswer(Answer):
    """Positions of the IMU in the estimate's world as rows of t_s, x, y, z; the truth is brought to the first pose."""

    estimate: list[Row]
    truth: list[Row]


@router.get("/map")
async def get_map(services: ServicesDep) -> MapAnswer:
    """How large the map is."""
    chunks = services.live.view.chunks.values()
    return MapAnswer(chunks=len(chunks), points=sum(len(chunk.points_K) for chunk in chunks))


@router.get("/map.ply", response_class=Response)
async def get_map_ply(services: ServicesDep, caller: CallerDep) -> Response:
    """The map as a PLY file, in the estimate's world frame; at most a second old."""
    return BulkResponse(services.bulk, caller, services.map_file.get, "application/octet-stream", "map.ply")


@router.get("/map/clearance")
async def get_clearance(services: ServicesDep, turning: Annotated[int, Query(ge=-1, le=1)] = 0) -> ClearanceAnswer:
    """How far the ground is known to be free around the head, and the turn of a patrol that turned as ``turning``.

    ``turn`` is -1 (right), 0 or 1 (left); null where a patrol can go no further: ``reason`` says why.
    """
    view = services.live.view
    tick = view.tick
    Ts_WL = None if tick is None else tick.Ts_WL
    if tick is None or Ts_WL is None or view.started is None or view.started.robot is None:
        return _clearance(None, None, "the robot's pose is unknown")
    floor_m = float(np.median(Ts_WL[:, 2, 3])) - view.started.robot.radius_m
    chunks, heading = list(view.chunks.values()), heading_rad(tick, Ts_WL)
    free = await services.bulk.make(lambda: clearance(chunks, Ts_WL[-1, :3, 3], heading, floor_m))
    turn = patrol_steering(free, turning)
    reason = f"the path is blocked {free.ahead_m:.1f} m ahead" if turn is None else None
    free_m = [round(distance_m, 2) for distance_m in free.free_m]
    return _clearance(free_m, turn, reason)


def _clearance(free_m: list[float] | None, turn: int | None, reason: str | None) -> ClearanceAnswer:
    answer = {"directions_deg": DIRECTIONS_DEG, "free_m": free_m, "turn": turn, "reason": reason}
    return ClearanceAnswer.model_validate(answer)


@router.get("/trajectory", response_model=TrajectoryAnswer)
async def get_trajectory(services: ServicesDep, caller: CallerDep) -> Response:
    """Estimate and truth as rows of t_s, x, y, z; the truth is brought to the estimate's first pose."""

    async def text() -> bytes:
        view = services.live.view
        return f'{{"estimate":[{view.estimate.text()}],"truth":[{view.truth.text()}]}}'.encode()

    return BulkResponse(services.bulk, caller, text, "application/json")
