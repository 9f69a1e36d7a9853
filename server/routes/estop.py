"""The emergency stop."""

from http import HTTPStatus

from fastapi import APIRouter, Response
from pydantic import BaseModel, ConfigDict

from server.deps import CallerDep, ServicesDep
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
async def estop(services: ServicesDep, response: Response, request: EStopRequest | None = None) -> EStopAnswer:
    """Latch the emergency stop; anybody may who is signed in.

    Answers 200 when the robot has confirmed it, and 202 with "confirmed" false without its confirmation within half a
    second: the stop has been sent, is latched in the server, and is sent again to a robot node that comes back.
    """
    before = services.live.estop_reason
    confirmed = await services.live.estop((request and request.reason) or OPERATOR)
    if before is None:
        services.telemetry.publish_state()
    if not confirmed:
        response.status_code = HTTPStatus.ACCEPTED
    return EStopAnswer.model_construct(**dict(services.state()), confirmed=confirmed)


@router.post("/estop/reset")
async def reset(services: ServicesDep, caller: CallerDep) -> State:
    """Clear the latch; the robot stays where it is until it is started again. Needs control."""
    services.need_control(caller)
    try:
        await services.live.reset_estop()
    finally:
        services.telemetry.publish_state()
    return services.state()
