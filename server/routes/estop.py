"""The emergency stop."""

from http import HTTPStatus

from fastapi import APIRouter, Response
from pydantic import BaseModel, ConfigDict

from server.deps import Rooms, Who
from server.fields import Words
from server.models import State

router = APIRouter(tags=["estop"])
OPERATOR = "operator"


class EStopRequest(BaseModel):
    """POST /estop."""

    model_config = ConfigDict(extra="forbid", strict=True)

    reason: Words = None


class EStopAnswer(State):
    """The state, and whether the robot has confirmed the stop."""

    confirmed: bool


UNCONFIRMED = {"description": "sent, but not confirmed by the robot yet", "model": EStopAnswer}


@router.post("/estop", responses={HTTPStatus.ACCEPTED: UNCONFIRMED})
async def estop(house: Rooms, response: Response, request: EStopRequest | None = None) -> EStopAnswer:
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
    return EStopAnswer.model_construct(**dict(house.state()), confirmed=confirmed)


@router.post("/estop/reset")
async def reset(house: Rooms, who: Who) -> State:
    """Clear the latch; the robot stays where it is until it is started again. Needs control."""
    house.need_control(who)
    try:
        await house.live.reset_estop()
    finally:
        house.telemetry.tell_state()
    return house.state()
