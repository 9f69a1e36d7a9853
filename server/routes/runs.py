"""Scripted runs."""

from asyncio import to_thread
from http import HTTPStatus

from fastapi import APIRouter
from starlette.responses import FileResponse, Response

from server.deps import House, Rooms
from server.problem import Problem
from server.runs import RunAnswer, RunRequest

router = APIRouter(tags=["runs"])
BINARY = "application/octet-stream"
MEDIA_TYPES = {
    ".json": "application/json",
    ".csv": "text/csv; charset=utf-8",
    ".tum": "text/plain; charset=utf-8",
    ".png": "image/png",
}


@router.post("/runs", status_code=HTTPStatus.ACCEPTED)
async def submit(request: RunRequest, house: Rooms, response: Response) -> RunAnswer:
    """Queue a run; the same as ``snakeslam run`` with these settings."""
    run = house.runs.submit(request)
    response.headers["Location"] = f"/api/v1/runs/{run.id}"
    return run.answer()


@router.get("/runs")
def get_runs(house: Rooms) -> list[RunAnswer]:
    """Every run on disk, those from before the server started too, oldest first."""
    return house.runs.all()


@router.get("/runs/{run_id}")
def get_run(run_id: str, house: Rooms) -> RunAnswer:
    """State, progress and result of a run."""
    return _find(house, run_id)


@router.delete("/runs/{run_id}")
async def cancel(run_id: str, house: Rooms) -> RunAnswer:
    """Cancel a run that waits or runs; one that is over stays as it is."""
    run = house.runs.own(run_id)
    if run is not None:
        await house.runs.cancel(run)
    shown = await to_thread(_find, house, run_id)
    if shown.state in ("queued", "running"):
        raise Problem(HTTPStatus.CONFLICT, "another server runs it")
    return shown


@router.get("/runs/{run_id}/artifacts/{name}")
def get_artifact(run_id: str, name: str, house: Rooms) -> FileResponse:
    """One file that a run left."""
    _find(house, run_id)
    path = house.runs.artifact(run_id, name)
    if path is None:
        raise Problem(HTTPStatus.NOT_FOUND, "the run has no such artifact")
    return FileResponse(path, filename=path.name, media_type=MEDIA_TYPES.get(path.suffix, BINARY))


def _find(house: House, run_id: str) -> RunAnswer:
    shown = house.runs.get(run_id)
    if shown is None:
        raise Problem(HTTPStatus.NOT_FOUND, "there is no such run")
    return shown
