"""The emergency stop."""

from typing import Any

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field

from server.deps import Rooms, Who

router = APIRouter(tags=["estop"])
OPERATOR = "operator"


class EStopRequest(BaseModel):
    """POST /estop."""

    model_config = ConfigDict(extra="forbid")

    reason: str = Field(OPERATOR, min_length=1, max_length=200)


@router.post("/estop")
async def estop(house: Rooms, request: EStopRequest | None = None) -> dict[str, Any]:
    """Latch the emergency stop; answers when the robot holds. Anybody may who is signed in."""
    try:
        await house.live.estop(OPERATOR if request is None else request.reason)
    finally:
        house.telemetry.tell_state()
    return house.state()


@router.post("/estop/reset")
async def reset(house: Rooms, who: Who) -> dict[str, Any]:
    """Clear the latch; the robot stays where it is until it is started again. Needs control."""
    house.need_control(who)
    try:
        await house.live.reset_estop()
    finally:
        house.telemetry.tell_state()
    return house.state()
