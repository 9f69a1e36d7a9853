"""The HTTP API without anything that runs behind it; ``python -m server.api`` prints its OpenAPI schema.

The page's TypeScript types are generated from that schema when the page is built.
"""

import json
import sys
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from importlib import import_module
from importlib.metadata import version
from pkgutil import iter_modules

from fastapi import APIRouter, Depends, FastAPI

from server import openapi, routes

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
    for router in _routers():
        app.include_router(router, prefix=routes.PREFIX, dependencies=[Depends(openapi.json_only)])
    openapi.install(app)
    return app


def _routers() -> list[APIRouter]:
    """Return the router of every module in ``server.routes``, by the modules' names."""
    modules = [import_module(f"{routes.__name__}.{module.name}") for module in iter_modules(routes.__path__)]
    return [module.router for module in modules]


if __name__ == "__main__":
    sys.stdout.write(json.dumps(create_api().openapi(), indent=1) + "\n")
