"""The HTTP API without anything that runs behind it; ``python -m server.api`` prints its OpenAPI schema.

The page's TypeScript types are generated from that schema when the page is built.
"""

import json
import sys
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from importlib.metadata import version

from fastapi import Depends, FastAPI

from server import openapi
from server.routes import PREFIX, control, estop, gait, head, map, recordings, runs, session, state  # noqa: A004

ROUTES = (state, control, gait, head, estop, recordings, map, runs, session)
Lifespan = Callable[[FastAPI], AbstractAsyncContextManager[None]]


def create_api(lifespan: Lifespan | None = None) -> FastAPI:
    """Return an application with every route of the API; its handlers find what they need in ``app.state.services``."""
    app = FastAPI(
        title="snakeslam",
        version=version("snakeslam"),
        lifespan=lifespan,
        openapi_url="/api/openapi.json",
        docs_url=None,
        redoc_url=None,
    )
    for module in ROUTES:
        app.include_router(module.router, prefix=PREFIX, dependencies=[Depends(openapi.json_only)])
    openapi.install(app)
    return app


if __name__ == "__main__":
    sys.stdout.write(json.dumps(create_api().openapi(), indent=1) + "\n")
