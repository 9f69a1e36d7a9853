"""Who may move the robot: the operator's lease, and the teleop websocket that needs it."""

from typing import Annotated, Any

from fastapi import APIRouter, WebSocket
from pydantic import BaseModel, ConfigDict, Field

from server.deps import Rooms, Who
from server.fields import Name
from server.lease import LONGEST_S, RENEWED_S, Lease
from server.state import control_json

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


@router.get("/control/lease")
async def get_lease(house: Rooms) -> dict[str, Any]:
    """Who has control, and for how long if it is not renewed."""
    return {**control_json(house.desk), "left_s": round(house.desk.left_s, 2)}


@router.post("/control/lease")
async def take(house: Rooms, who: Who, request: LeaseRequest | None = None) -> dict[str, Any]:
    """Take control; send the key as Control-Lease with every command, and renew it in time."""
    request = LeaseRequest() if request is None else request
    before = house.desk.lease
    lease = house.desk.take(request.name, request.seconds, over=request.take_over, identity=who.identity)
    how = "taken" if before is None or before.key == who.identity else "taken over"
    house.tell_lease(lease, how, f" from {before.holder}" if before is not None and how == "taken over" else "")
    return lease_json(lease)


@router.put("/control/lease")
async def renew(house: Rooms, who: Who) -> dict[str, Any]:
    """Keep control."""
    return lease_json(house.desk.renew(who.lease_key))


@router.delete("/control/lease")
async def release(house: Rooms, who: Who) -> dict[str, Any]:
    """Give control back; the robot stops."""
    lease = house.desk.release(who.lease_key)
    await house.stop_if_moving()
    house.tell_lease(lease, "given back")
    return control_json(house.desk)


@router.websocket("/teleop")
async def teleop(socket: WebSocket, house: Rooms, who: Who) -> None:
    """Drive input as JSON: hello with the lease's key, then pings and drives; see docs/rest.md."""
    await house.sockets.serve("teleop", socket, who, house.teleop.serve)


def lease_json(lease: Lease) -> dict[str, Any]:
    """A lease for its holder."""
    return {"key": lease.key, "id": lease.id, "holder": lease.holder, "seconds": lease.seconds}
