"""Who may move the robot: the operator's lease, and the teleop websocket that needs it."""

from typing import Annotated

from fastapi import APIRouter, WebSocket
from pydantic import BaseModel, ConfigDict, Field

from server.deps import Rooms, Who
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
async def get_lease(house: Rooms) -> LeaseState:
    """Who has control, and for how long if it is not renewed."""
    return LeaseState(**dict(control(house.desk)), left_s=round(house.desk.left_s, 2))


@router.post("/control/lease")
async def take(house: Rooms, who: Who, request: LeaseRequest | None = None) -> LeaseAnswer:
    """Take control; send the key as Control-Lease with every command, and renew it in time."""
    request = LeaseRequest() if request is None else request
    before = house.desk.lease
    lease = house.desk.take(request.name, request.seconds, over=request.take_over, identity=who.identity)
    how = "taken" if before is None or before.key == who.identity else "taken over"
    house.tell_lease(lease, how, f" from {before.holder}" if before is not None and how == "taken over" else "")
    return _answer(lease)


@router.put("/control/lease")
async def renew(house: Rooms, who: Who) -> LeaseAnswer:
    """Keep control."""
    return _answer(house.desk.renew(who.lease_key))


@router.delete("/control/lease")
async def release(house: Rooms, who: Who) -> Control:
    """Give control back; the robot stops."""
    lease = house.desk.release(who.lease_key)
    await house.stop_if_moving()
    house.tell_lease(lease, "given back")
    return control(house.desk)


@router.websocket("/teleop")
async def teleop(socket: WebSocket, house: Rooms, who: Who) -> None:
    """Drive input as JSON: hello with the lease's key, then pings and drives; see docs/rest.md."""
    await house.sockets.serve("teleop", socket, who, house.teleop.serve)


def _answer(lease: Lease) -> LeaseAnswer:
    return LeaseAnswer(key=lease.key, id=lease.id, holder=lease.holder, seconds=lease.seconds)
