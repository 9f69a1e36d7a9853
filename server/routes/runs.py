"""Scripted runs."""

from http import HTTPStatus
from typing import Any

from fastapi import APIRouter
from starlette.responses import FileResponse, Response

from server.deps import House, Rooms
from server.problem import Problem
from server.runs import Run, RunRequest

router = APIRouter(tags=["runs"])


@router.post("/runs", status_code=HTTPStatus.ACCEPTED)
async def submit(request: RunRequest, house: Rooms, response: Response) -> dict[str, Any]:
    """Queue a run; the same as ``snakeslam run`` with these settings."""
    run = house.runs.submit(request)
    response.headers["Location"] = f"/api/v1/runs/{run.id}"
    return run.as_json()


@router.get("/runs")
async def get_runs(house: Rooms) -> list[dict[str, Any]]:
    """Every run since the server started, oldest first."""
    return [run.as_json() for run in house.runs.all()]


@router.get("/runs/{run_id}")
async def get_run(run_id: str, house: Rooms) -> dict[str, Any]:
    """State, progress and result of a run."""
    return _find(house, run_id).as_json()


@router.delete("/runs/{run_id}")
async def cancel(run_id: str, house: Rooms) -> dict[str, Any]:
    """Cancel a run that waits or runs; one that is over stays as it is."""
    run = _find(house, run_id)
    await house.runs.cancel(run)
    return run.as_json()


@router.get("/runs/{run_id}/artifacts/{name}")
async def get_artifact(run_id: str, name: str, house: Rooms) -> FileResponse:
    """One file that a run left."""
    path = _find(house, run_id).artifacts().get(name)
    if path is None:
        raise Problem(HTTPStatus.NOT_FOUND, "the run has no such artifact")
    return FileResponse(path, filename=path.name, media_type="application/octet-stream")


def _find(house: House, run_id: str) -> Run:
    run = house.runs.get(run_id)
    if run is None:
        raise Problem(HTTPStatus.NOT_FOUND, "there is no such run")
    return run
