"""Scripted runs."""

from asyncio import to_thread
from http import HTTPStatus

from fastapi import APIRouter
from starlette.responses import FileResponse, Response

from server.deps import Services, ServicesDep
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
async def submit(request: RunRequest, services: ServicesDep, response: Response) -> RunAnswer:
    """Queue a run; the same as ``snakeslam run`` with these settings."""
    run = services.runs.submit(request)
    response.headers["Location"] = f"/api/v1/runs/{run.id}"
    return run.answer()


@router.get("/runs")
def get_runs(services: ServicesDep) -> list[RunAnswer]:
    """Every run on disk, those from before the server started too, oldest first."""
    return services.runs.all()


@router.get("/runs/{run_id}")
def get_run(run_id: str, services: ServicesDep) -> RunAnswer:
    """State, progress and result of a run."""
    return _find(services, run_id)


@router.delete("/runs/{run_id}")
async def cancel(run_id: str, services: ServicesDep) -> RunAnswer:
    """Cancel a run that is queued or runs; one that has ended stays as it is."""
    run = services.runs.own(run_id)
    if run is not None:
        await services.runs.cancel(run)
    shown = await to_thread(_find, services, run_id)
    if shown.state in ("queued", "running"):
        raise Problem(HTTPStatus.CONFLICT, "another server runs it")
    return shown


@router.get("/runs/{run_id}/artifacts/{name}")
def get_artifact(run_id: str, name: str, services: ServicesDep) -> FileResponse:
    """One file that a run left."""
    _find(services, run_id)
    path = services.runs.artifact(run_id, name)
    if path is None:
        raise Problem(HTTPStatus.NOT_FOUND, "the run has no such artifact")
    return FileResponse(path, filename=path.name, media_type=MEDIA_TYPES.get(path.suffix, BINARY))


def _find(services: Services, run_id: str) -> RunAnswer:
    shown = services.runs.get(run_id)
    if shown is None:
        raise Problem(HTTPStatus.NOT_FOUND, "there is no such run")
    return shown
