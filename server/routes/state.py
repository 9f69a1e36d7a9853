"""GET /state and the telemetry websocket."""

from fastapi import APIRouter, WebSocket

from server.deps import Rooms, Who
from server.models import State

router = APIRouter(tags=["state"])


@router.get("/state")
async def get_state(house: Rooms) -> State:
    """What runs, how it moves, and what the estimator says of itself."""
    return house.state()


@router.websocket("/telemetry")
async def telemetry(socket: WebSocket, house: Rooms, who: Who) -> None:
    """State, ticks, events as JSON text; camera frames as binary messages."""
    await house.sockets.serve("telemetry", socket, who, house.telemetry.serve)
