"""The gait: which, how, and whether it moves."""

from functools import lru_cache
from http import HTTPStatus
from typing import Annotated

import numpy as np
from fastapi import APIRouter, Query
from pydantic import ConfigDict, Field

from server.deps import CallerDep, ServicesDep
from server.live import Live
from server.models import Answer, GaitState, ParameterKey, State
from server.problem import Problem
from server.state import gait_state
from snakeslam.errors import InputError
from snakeslam.gaits.catalogue import GAITS, GaitName, GaitSettings, resolve
from snakeslam.gaits.command import commanded_gait
from snakeslam.gaits.drawing import draw
from snakeslam.gaits.gait import Gait, ResolvedGait
from snakeslam.messages import GaitCommand
from snakeslam.robot.model import SnakeModel, snake_model
from snakeslam.runtime.bus.commands import SetGait, Stop

router = APIRouter(tags=["gait"])


class GaitRequest(GaitSettings):
    """PUT /gait; a parameter that is left out or null takes the gait's own default, ``turn`` stays as it is."""

    model_config = ConfigDict(strict=True)

    name: GaitName  # pyright: ignore[reportGeneralTypeIssues]
    turn: Annotated[float, Field(ge=-1, le=1)] | None = None


class GaitParameter(Answer):
    """A number of a gait that the operator may set."""

    key: ParameterKey
    label: str
    unit: str
    min: float
    max: float
    step: float
    default: float


class GaitEntry(Answer):
    """A gait of the catalogue."""

    name: GaitName
    title: str
    summary: str
    turns: bool
    """Whether it can be steered."""
    parameters: list[GaitParameter]


class GaitAnswer(Answer):
    """The gait as it is, and all there are."""

    current: GaitState
    catalogue: list[GaitEntry]


class GaitDrawing(Answer):
    """The body over one period of a gait, seen in its own level frame: x ahead, y to its left, z up from the ground."""

    points: list[list[float]]
    """For each of equal steps of the period: x, y, z in turn, tail to head, in joint lengths."""
    backs: list[list[float]]
    """For each step, how far each link's back faces up: 1, or down: -1."""


class GaitPreview(Answer):
    """What a gait with these parameters looks like, without commanding it."""

    reason: str | None
    """Why the robot cannot do it; null when it can."""
    drawing: GaitDrawing | None
    """Null when the robot cannot do it."""
    remark: str | None
    """What helps to choose the parameters."""


@router.get("/gait")
async def get_gait(services: ServicesDep) -> GaitAnswer:
    """The gait as it is, and all there are."""
    entries = [_entry(gait, _model(services.live)) for gait in GAITS.values()]
    return GaitAnswer(current=gait_state(services.live.gait()), catalogue=entries)


@router.get("/gait/preview")
async def get_preview(services: ServicesDep, settings: Annotated[GaitSettings, Query()]) -> GaitPreview:
    """What a gait with these parameters looks like on this robot; a parameter that is left out takes its default."""
    model = _model(services.live)
    try:
        gait = resolve(settings, model)
    except InputError as error:
        return GaitPreview(reason=str(error), drawing=None, remark=None)
    drawing = await services.bulk.make(lambda: _drawing(gait, model))
    return GaitPreview(reason=None, drawing=drawing, remark=gait.remark)


@router.put("/gait")
async def put_gait(request: GaitRequest, services: ServicesDep, caller: CallerDep) -> State:
    """Change the gait; the change is smooth, and nothing starts to move for it. Needs control."""
    services.live.need_robot()
    services.need_control(caller)
    current = services.live.gait()
    turn = current.turn if request.turn is None else request.turn
    settings = GaitSettings(**request.model_dump(exclude={"turn"}))
    command = _command(settings, turn)
    resolve(commanded_gait(command, services.live.view.config.gait), _model(services.live), turn)
    await services.live.command(SetGait(command))
    services.telemetry.publish_state()
    return services.state()


@router.post("/gait/start")
async def start(services: ServicesDep, caller: CallerDep) -> State:
    """Set the robot going, until it is stopped or control is lost. Needs control."""
    services.need_control(caller)
    await services.live.move()
    if not services.live.moving:
        raise Problem(HTTPStatus.CONFLICT, "the robot did not start; its E-stop was latched meanwhile")
    return services.state()


@router.post("/gait/back-up")
async def back_up(services: ServicesDep, caller: CallerDep) -> State:
    """Play the gait backwards for ``safety.back_up_s``, then stop: away from what the robot cannot see past.

    It goes on however blind the robot is; all else that holds a robot holds it. Needs control.
    """
    services.need_control(caller)
    await services.live.back_up()
    return services.state()


@router.post("/gait/stop")
async def stop(services: ServicesDep) -> State:
    """Stop the robot smoothly. Any operator may, with control or without."""
    services.live.need_robot()
    await services.live.command(Stop())
    return services.state()


def _model(live: Live) -> SnakeModel:
    return snake_model(live.view.config.robot)


@lru_cache(maxsize=64)
def _drawing(gait: ResolvedGait, model: SnakeModel) -> GaitDrawing:
    """Return a gait's drawing; the same few are asked for by every page."""
    drawn = draw(gait, model)
    points = np.round(drawn.points, 3).reshape(len(drawn.points), -1)
    return GaitDrawing(points=points.tolist(), backs=np.round(drawn.backs, 2).tolist())


def _command(settings: GaitSettings, turn: float) -> GaitCommand:
    return GaitCommand(t_ns=0, gait=settings.name, turn=turn, parameters=settings.given())


def _entry(gait: Gait, model: SnakeModel) -> GaitEntry:
    return GaitEntry(
        name=gait.name,
        title=gait.title,
        summary=gait.summary,
        turns=gait.steers,
        parameters=[
            GaitParameter(
                key=parameter.key,
                label=parameter.kind.label,
                unit=parameter.kind.unit,
                min=parameter.minimum,
                max=parameter.maximum,
                step=parameter.kind.step,
                default=parameter.default,
            )
            for parameter in gait.parameters_for(model)
        ],
    )
