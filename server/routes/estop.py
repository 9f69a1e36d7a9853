"""The emergency stop."""

from http import HTTPStatus
from typing import Any

from fastapi import APIRouter, Response
from pydantic import BaseModel, ConfigDict

from server.deps import Rooms, Who
from server.fields import Words

router = APIRouter(tags=["estop"])
OPERATOR = "operator"


class EStopRequest(BaseModel):
    """POST /estop."""

    model_config = ConfigDict(extra="forbid", strict=True)

    reason: Words = None


@router.post("/estop", responses={HTTPStatus.ACCEPTED: {"description": "sent, but not confirmed by the robot yet"}})
async def estop(house: Rooms, response: Response, request: EStopRequest | None = None) -> dict[str, Any]:
    """Latch the emergency stop; anybody may who is signed in.

    Answers 200 when the robot has confirmed it. Without its word within half a second it answers 202 with "confirmed"
    false: the stop has been sent, is latched in the server, and is sent again to a robot node that comes back.
    """
    before = house.live.estop_reason
    confirmed = await house.live.estop((request and request.reason) or OPERATOR)
    if before is None:
        house.telemetry.tell_state()
    if not confirmed:
        response.status_code = HTTPStatus.ACCEPTED
    return {**house.state(), "confirmed": confirmed}


@router.post("/estop/reset")
async def reset(house: Rooms, who: Who) -> dict[str, Any]:
    """Clear the latch; the robot stays where it is until it is started again. Needs control."""
    house.need_control(who)
    try:
        await house.live.reset_estop()
    finally:
        house.telemetry.tell_state()
    return house.state()
