"""The application: every part of the server put together."""

import asyncio
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from time import monotonic

from fastapi import APIRouter, FastAPI, Request
from starlette.exceptions import HTTPException
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.staticfiles import StaticFiles
from uvicorn.middleware.proxy_headers import ProxyHeadersMiddleware

from server import docs, openapi, problem
from server.api import create_api
from server.auth import Auth, HostRule, checked_proxies, login_response, tokens_by_role
from server.bulk import Bulk, Made
from server.deps import Services, ServicesDep
from server.guard import Guard
from server.keeper import Keeper
from server.lease import Desk
from server.limits import DEFAULT_RATES, Limiter, Rates
from server.live import Live
from server.map_file import MapFile
from server.metrics import Metrics
from server.observe import Observe
from server.recordings import Library, printable
from server.runs import Runs
from server.sessions import Sessions, state_folder
from server.sockets import Sockets
from server.telemetry import Telemetry
from server.teleop import Teleop
from server.viewer import Viewer
from server.viewer_proxy import ViewerProxy
from snakeslam.runtime.assembly.spec import SessionSpec

PAGE = Path(__file__).resolve().parents[1] / "web" / "dist"
RECORDINGS_AGE_S = 2.0
"""The list of recordings is at most so old; looking through them takes a good part of a second."""
NO_PAGE = (
    "<!doctype html><title>snakeslam</title><p>The page is not built: run <code>make setup</code>. The API is at "
    "<a href=/api/docs>/api/docs</a>, the 3D view at <a href=/viewer/>/viewer/</a>."
)


@dataclass(frozen=True, slots=True)
class ServerSettings:
    """What a server is started with; ``private`` is a folder that only this user may enter."""

    spec: SessionSpec
    token: str
    host: str
    private: Path
    recordings: tuple[Path, ...] = ()
    runs: Path = Path("runs/api")
    page: Path = PAGE
    viewer_token: str | None = None
    rates: Rates = DEFAULT_RATES


def create_app(settings: ServerSettings, announce: Callable[[str], None]) -> FastAPI:
    """Return the application; ``announce`` gets the next one-time code after each use of one."""
    config = settings.spec.config.server
    tokens = tokens_by_role(settings.token, settings.viewer_token)
    sessions = Sessions(tokens, state_folder(config.state_dir), config.session_hours * 3600.0)
    auth = Auth(settings.token, announce, sessions, settings.viewer_token)
    metrics, limiter = Metrics(), Limiter(settings.rates)
    socket = settings.private / "viewer.sock"
    proxy = ViewerProxy(socket)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncGenerator[None]:
        services = await asyncio.to_thread(_build, settings, auth, metrics, socket, limiter)
        app.state.services = services
        services.live.subscribe(services.viewer.on_report)
        recording = services.spec.recording
        if recording is None:
            await services.live.start(services.spec, "sim", "simulator")
        else:
            await services.live.start(services.spec, "recording", printable(recording.resolve().name))
        app.state.keeper = keeper = Keeper(services)
        watching = [asyncio.create_task(keeper.watch()), asyncio.create_task(keeper.watch_sessions())]
        try:
            yield
        finally:
            await keeper.hold()
            for task in watching:
                task.cancel()
            await asyncio.gather(services.runs.close(), services.live.stop())
            await proxy.close()
            await asyncio.to_thread(services.viewer.close)
            services.bulk.close()
            sessions.close()

    app = create_api(lifespan)
    problem.install(app, lambda path: openapi.methods_at(app, path))
    app.add_middleware(Guard, auth=auth, hosts=HostRule(settings.host, config.hosts), limiter=limiter, metrics=metrics)
    app.add_middleware(Observe, metrics=metrics)
    if config.trusted_proxies:
        app.add_middleware(ProxyHeadersMiddleware, trusted_hosts=checked_proxies(config.trusted_proxies))
    app.include_router(proxy.router)
    app.include_router(_own_pages(app, auth))
    if settings.page.is_dir():
        app.mount("/", StaticFiles(directory=settings.page, html=True))
    else:
        app.add_api_route("/", lambda: HTMLResponse(NO_PAGE), include_in_schema=False)
    app.state.auth = auth
    return app


def _build(settings: ServerSettings, auth: Auth, metrics: Metrics, socket: Path, limiter: Limiter) -> Services:
    live, desk, bulk = Live(settings.spec.config), Desk(), Bulk()
    library = Library.of(list(settings.recordings))
    telemetry = Telemetry(live, desk, metrics)
    return Services(
        auth=auth,
        config=settings.spec.config,
        spec=settings.spec,
        live=live,
        desk=desk,
        teleop=Teleop(live, desk, metrics, settings.rates.teleop),
        telemetry=telemetry,
        viewer=Viewer(socket),
        runs=Runs(settings.runs, telemetry.say),
        library=library,
        metrics=metrics,
        bulk=bulk,
        sockets=Sockets(metrics),
        limiter=limiter,
        map_file=MapFile(live, bulk),
        recordings=Made(bulk, library.all, monotonic, RECORDINGS_AGE_S),
    )


def _own_pages(app: FastAPI, auth: Auth) -> APIRouter:
    """Return what is neither API nor static file."""
    router = APIRouter(include_in_schema=False)

    @router.get("/login")
    async def _(request: Request, code: str = "") -> Response:  # pyright: ignore[reportUnusedFunction]
        return await login_response(auth, code, request)

    @router.get("/healthz")
    async def _(services: ServicesDep) -> Response:  # pyright: ignore[reportUnusedFunction]
        well = services.live.view.phase == "running" and services.live.view.message is None
        return Response("well\n" if well else "not well\n", HTTPStatus.OK if well else HTTPStatus.SERVICE_UNAVAILABLE)

    @router.get("/metrics")
    async def _(services: ServicesDep) -> Response:  # pyright: ignore[reportUnusedFunction]
        return Response(services.metrics.text(), media_type="text/plain; version=0.0.4; charset=utf-8")

    @router.get("/api/docs")
    async def _() -> Response:  # pyright: ignore[reportUnusedFunction]
        return HTMLResponse(docs.page(app.openapi()))

    @router.get("/api/{path:path}")
    async def _(path: str) -> JSONResponse:  # pyright: ignore[reportUnusedFunction]
        if openapi.methods_at(app, f"/api/{path}"):
            raise HTTPException(HTTPStatus.METHOD_NOT_ALLOWED)
        return problem.problem_response(HTTPStatus.NOT_FOUND, f"there is nothing at /api/{path}")

    return router
