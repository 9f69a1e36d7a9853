"""The head: how the neck holds it, where its line points, and how still it is."""

from typing import Annotated

from fastapi import APIRouter
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from server.deps import CallerDep, ServicesDep
from server.live import Live
from server.models import Answer, HeadControl, HeadMotion, State
from server.runs import whole
from server.state import head_control, head_motion
from snakeslam.errors import InputError
from snakeslam.gaits.catalogue import ResolvedGait, resolve
from snakeslam.gaits.command import commanded_gait
from snakeslam.head.catalogue import HEAD_CATALOGUE, HeadEntry
from snakeslam.head.command import MOST_STEERING_DEG, commanded_head
from snakeslam.head.laws import check, effect
from snakeslam.head.neck import most_neck_joints, neck_joints_of
from snakeslam.head.settings import LEAST_NECK_JOINTS, HeadController, HeadSettings
from snakeslam.messages import HeadCommand
from snakeslam.robot.model import SnakeModel, snake_model
from snakeslam.runtime.bus import topics
from snakeslam.runtime.bus.commands import SetHead

router = APIRouter(tags=["head"])


class HeadRequest(BaseModel):
    """PUT /head; what is left out or null stays as it is."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True, strict=True)

    controller: HeadController | None = None
    neck_joints: Annotated[int | None, BeforeValidator(whole)] = None
    """Yaw joints of the neck."""
    turn_by_deg: Annotated[float, Field(ge=-MOST_STEERING_DEG, le=MOST_STEERING_DEG)] | None = None
    """Turns the head's reference line, and so the robot; positive to the left."""


class HeadEntryAnswer(Answer):
    """A controller of the head, and whether it can hold it in the present gait."""

    name: HeadController
    title: str
    summary: str
    steers: bool
    """Whether the head's reference line, and so the robot, can be turned."""
    available: bool
    reason: str | None
    """Why it is not available."""


class NeckJoints(Answer):
    """How many yaw joints a neck may have on this robot."""

    min: int
    max: int
    default: int


class Limits(Answer):
    """The range of a number, both ends included."""

    min: float
    max: float


class HeadAnswer(Answer):
    """How the head is held, the controllers there are, and how still it is now."""

    current: HeadControl | None
    """Null without a robot."""
    controllers: list[HeadEntryAnswer]
    neck_joints: NeckJoints
    turn_by_deg: Limits
    stillness: HeadMotion


@router.get("/head")
async def get_head(services: ServicesDep) -> HeadAnswer:
    """How the head is held, the controllers there are, and how still it is now."""
    live = services.live
    model, gait, settings = _model(live), _gait(live), live.head()
    tick = live.view.tick
    tried = settings or live.view.config.head
    return HeadAnswer(
        current=head_control(settings),
        controllers=[_entry(entry, tried, model, gait) for entry in HEAD_CATALOGUE.values()],
        neck_joints=NeckJoints(
            min=LEAST_NECK_JOINTS,
            max=most_neck_joints(model),
            default=neck_joints_of(live.view.config.head, model),
        ),
        turn_by_deg=Limits(min=-MOST_STEERING_DEG, max=MOST_STEERING_DEG),
        stillness=head_motion(topics.HeadMotion() if tick is None else tick.head),
    )


@router.put("/head")
async def put_head(request: HeadRequest, services: ServicesDep, caller: CallerDep) -> State:
    """Change how the head is held, or turn its line; smoothly, and nothing starts to move for it. Needs control."""
    services.live.need_robot()
    services.need_control(caller)
    command = HeadCommand(0, request.controller, request.neck_joints, request.turn_by_deg)
    commanded_head(command, services.live.head() or HeadSettings(), _model(services.live), _gait(services.live))
    await services.live.command(SetHead(command))
    services.telemetry.publish_state()
    return services.state()


def _model(live: Live) -> SnakeModel:
    return snake_model(live.view.config.robot)


def _gait(live: Live) -> ResolvedGait:
    return resolve(commanded_gait(live.gait(), live.view.config.gait), _model(live))


def _entry(entry: HeadEntry, settings: HeadSettings, model: SnakeModel, gait: ResolvedGait) -> HeadEntryAnswer:
    reason = None
    try:
        check(settings.model_copy(update={"controller": entry.name}), model, gait)
    except InputError as error:
        reason = error.problem + (f" (allowed: {error.allowed})" if error.allowed else "")
    return HeadEntryAnswer(
        name=entry.name,
        title=entry.title,
        summary=effect(entry.name, gait),
        steers=entry.steers,
        available=reason is None,
        reason=reason,
    )
