"""Recordings to watch, and the return to the simulator."""

from dataclasses import replace
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from server.deps import CallerDep, ServicesDep
from server.models import Playback, State
from server.problem import Problem
from server.recordings import RecordingAnswer, printable, recording_answer
from server.runs import Scalar, checked_overrides
from server.state import playback
from snakeslam.config import override_config
from snakeslam.estimation.settings import Mode
from snakeslam.runtime.bus.commands import ControlPlayback

SLOWEST, FASTEST = 0.1, 16.0
router = APIRouter(tags=["source"])


class PlayRequest(BaseModel):
    """POST /recordings/{id}/play."""

    model_config = ConfigDict(extra="forbid", strict=True)

    mode: Mode | None = None


class SimRequest(BaseModel):
    """POST /sim/start."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)

    overrides: dict[str, Scalar] = Field(default_factory=dict, max_length=64)


@router.get("/recordings")
async def get_recordings(services: ServicesDep) -> list[RecordingAnswer]:
    """The recordings that can be played; the list is at most two seconds old."""
    return [recording_answer(key, summary) for key, summary in (await services.recordings.get()).items()]


@router.post("/recordings/{recording_id}/play")
async def play(
    recording_id: str, services: ServicesDep, caller: CallerDep, request: PlayRequest | None = None
) -> State:
    """Play a recording in the live view; without a mode, the one that its sensors allow. Needs control.

    A mode that they do not allow ends the session with a line that says so.
    """
    summary = (await services.recordings.get()).get(recording_id)
    if summary is None:
        raise Problem(HTTPStatus.NOT_FOUND, "there is no such recording; GET /recordings lists them")
    services.need_control(caller)
    mode = None if request is None else request.mode
    spec = replace(services.spec, recording=summary.path, estimator_mode=mode, autostart=False, build=None)
    await services.live.start(spec, "recording", printable(summary.name))
    services.telemetry.publish_state()
    return services.state()


def _whole(value: object) -> object:
    """JSON Schema counts 2.0 among the integers."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


class PlaybackRequest(BaseModel):
    """PUT /playback: what is left out stays as it is."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True, strict=True)

    paused: bool | None = None
    """Playing at the end begins anew."""
    speed: Annotated[float, Field(ge=SLOWEST, le=FASTEST)] | None = None
    """A multiple of real time; the machine may be slower."""
    position_s: Annotated[float, Field(ge=0)] | None = None
    """Seconds from the first frame; past the end it is the last frame. What is ahead has to be computed first."""
    step: Annotated[int, Field(ge=-1000, le=1000), BeforeValidator(_whole)] = 0
    """So many frames on (negative: back), then paused."""


@router.get("/playback")
async def get_playback(services: ServicesDep) -> Playback | None:
    """How the recording that is open plays; null where none is."""
    tick = services.live.view.tick
    return None if tick is None else playback(tick.playback)


@router.put("/playback")
async def put_playback(services: ServicesDep, caller: CallerDep, request: PlaybackRequest) -> Playback | None:
    """Pause, seek, step through, or change the speed of the recording that is open. Needs control."""
    services.need_control(caller)
    await services.live.control_playback(ControlPlayback(**request.model_dump()))
    return await get_playback(services)


@router.post("/sim/start")
async def start_sim(services: ServicesDep, caller: CallerDep, request: SimRequest | None = None) -> State:
    """Start the simulator anew, with settings changed as in --set. Needs control."""
    overrides = checked_overrides({} if request is None else request.overrides)
    spec = replace(services.spec, config=override_config(services.config, overrides), recording=None)
    services.need_control(caller)
    await services.live.start(spec, "sim", "simulator")
    services.telemetry.publish_state()
    return services.state()
