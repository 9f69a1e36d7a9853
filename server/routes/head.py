"""The head: how the neck holds it, where its line points, and how still it is."""

from typing import Annotated, Any

from fastapi import APIRouter
from pydantic import BaseModel, ConfigDict, Field

from server.deps import Rooms, Who
from server.live import Live
from server.state import head_control_json, head_json
from snakeslam.errors import InputError
from snakeslam.gaits.catalogue import ResolvedGait, resolve
from snakeslam.gaits.command import commanded_gait
from snakeslam.head.catalogue import HEAD_CATALOGUE, HeadEntry
from snakeslam.head.command import MOST_TURN_DEG, commanded_head
from snakeslam.head.laws import check, effect
from snakeslam.head.neck import most_neck_joints, neck_joints_of
from snakeslam.head.settings import LEAST_NECK_JOINTS, HeadController, HeadSettings
from snakeslam.messages import HeadCommand
from snakeslam.robot.model import SnakeModel, snake_model
from snakeslam.runtime.bus.commands import SetHead
from snakeslam.runtime.bus.topics import HeadMotion

router = APIRouter(tags=["head"])


class HeadRequest(BaseModel):
    """PUT /head; what is left out or null stays as it is."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True, strict=True)

    controller: HeadController | None = None
    neck_joints: int | None = None
    """Yaw joints of the neck."""
    turn_by_deg: Annotated[float, Field(ge=-MOST_TURN_DEG, le=MOST_TURN_DEG)] | None = None
    """Turns the head's reference line, and so the robot; positive to the left."""


@router.get("/head")
async def get_head(house: Rooms) -> dict[str, Any]:
    """How the head is held, the controllers there are, and how still it is now."""
    live = house.live
    model, gait, settings = _model(live), _gait(live), live.head()
    tick = live.view.tick
    tried = settings or live.view.config.head
    return {
        "current": head_control_json(settings),
        "controllers": [_entry_json(entry, tried, model, gait) for entry in HEAD_CATALOGUE.values()],
        "neck_joints": {
            "min": LEAST_NECK_JOINTS,
            "max": most_neck_joints(model),
            "default": neck_joints_of(live.view.config.head, model),
        },
        "turn_by_deg": {"min": -MOST_TURN_DEG, "max": MOST_TURN_DEG},
        "stillness": head_json(HeadMotion() if tick is None else tick.head),
    }


@router.put("/head")
async def put_head(request: HeadRequest, house: Rooms, who: Who) -> dict[str, Any]:
    """Change how the head is held, or turn its line; smoothly, and nothing starts to move for it. Needs control."""
    house.live.need_robot()
    house.need_control(who)
    command = HeadCommand(0, request.controller, request.neck_joints, request.turn_by_deg)
    commanded_head(command, house.live.head() or HeadSettings(), _model(house.live), _gait(house.live))
    await house.live.command(SetHead(command))
    house.telemetry.tell_state()
    return house.state()


def _model(live: Live) -> SnakeModel:
    return snake_model(live.view.config.robot)


def _gait(live: Live) -> ResolvedGait:
    return resolve(commanded_gait(live.gait(), live.view.config.gait), _model(live))


def _entry_json(entry: HeadEntry, settings: HeadSettings, model: SnakeModel, gait: ResolvedGait) -> dict[str, Any]:
    reason = None
    try:
        check(settings.model_copy(update={"controller": entry.name}), model, gait)
    except InputError as error:
        reason = error.problem + (f" (allowed: {error.allowed})" if error.allowed else "")
    return {
        "name": entry.name,
        "title": entry.title,
        "summary": effect(entry.name, gait),
        "steers": entry.steers,
        "available": reason is None,
        "reason": reason,
    }
