"""Who may move the robot: the operator's lease, and the teleop websocket that needs it."""

from typing import Annotated

from fastapi import APIRouter, WebSocket
from pydantic import BaseModel, ConfigDict, Field

from server.deps import CallerDep, ServicesDep
from server.fields import Name
from server.lease import LONGEST_S, RENEWED_S, Lease
from server.models import Answer, Control
from server.state import control

router = APIRouter(tags=["control"])


class LeaseRequest(BaseModel):
    """POST /control/lease."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True, strict=True)

    name: Name = "a script"
    """Shown to all."""
    seconds: Annotated[float, Field(ge=1, le=LONGEST_S)] = RENEWED_S
    """It lapses so long after the last renewal or command, and the robot stops."""
    take_over: bool = False
    """Take it from whom has it."""


class LeaseState(Control):
    """Who has control, and for how long if it is not renewed; 0 while nobody has."""

    left_s: float


class LeaseAnswer(Answer):
    """A lease for its holder."""

    key: str
    """Secret: sent as Control-Lease with every command."""
    id: int
    holder: str
    seconds: float
    """It lapses so long after the last renewal or command."""


@router.get("/control/lease")
async def get_lease(services: ServicesDep) -> LeaseState:
    """Who has control, and for how long if it is not renewed."""
    return LeaseState(**dict(control(services.desk)), left_s=round(services.desk.left_s, 2))


@router.post("/control/lease")
async def grant(services: ServicesDep, caller: CallerDep, request: LeaseRequest | None = None) -> LeaseAnswer:
    """Take control; send the key as Control-Lease with every command, and renew it in time."""
    request = LeaseRequest() if request is None else request
    before = services.desk.lease
    lease = services.desk.grant(request.name, request.seconds, over=request.take_over, identity=caller.identity)
    how = "taken" if before is None or before.key == caller.identity else "taken over"
    services.publish_lease(lease, how, f" from {before.holder}" if before is not None and how == "taken over" else "")
    return _answer(lease)


@router.put("/control/lease")
async def renew(services: ServicesDep, caller: CallerDep) -> LeaseAnswer:
    """Keep control."""
    return _answer(services.desk.renew(caller.lease_key))


@router.delete("/control/lease")
async def release(services: ServicesDep, caller: CallerDep) -> Control:
    """Give control back; the robot stops."""
    lease = services.desk.release(caller.lease_key)
    await services.stop_if_moving()
    services.publish_lease(lease, "given back")
    return control(services.desk)


@router.websocket("/teleop")
async def teleop(socket: WebSocket, services: ServicesDep, caller: CallerDep) -> None:
    """Drive input as JSON: hello with the lease's key, then pings and drives; see docs/rest.md."""
    await services.sockets.serve("teleop", socket, caller, services.teleop.serve)


def _answer(lease: Lease) -> LeaseAnswer:
    return LeaseAnswer(key=lease.key, id=lease.id, holder=lease.holder, seconds=lease.seconds)
