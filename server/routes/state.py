"""GET /state and the telemetry websocket."""

from fastapi import APIRouter, WebSocket

from server.deps import CallerDep, ServicesDep
from server.models import State

router = APIRouter(tags=["state"])


@router.get("/state")
async def get_state(services: ServicesDep) -> State:
    """What runs, how it moves, and what the estimator says of itself."""
    return services.state()


@router.websocket("/telemetry")
async def telemetry(socket: WebSocket, services: ServicesDep, caller: CallerDep) -> None:
    """State, ticks, events as JSON text; camera frames as binary messages."""
    await services.sockets.serve("telemetry", socket, caller, services.telemetry.serve)
