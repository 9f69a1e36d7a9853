"""The API without a server behind it."""

from importlib import import_module
from pkgutil import iter_modules

from server import routes
from server.api import create_api


def test_every_module_of_routes_is_part_of_the_api() -> None:
    paths = create_api().openapi()["paths"]
    modules = [import_module(f"{routes.__name__}.{module.name}") for module in iter_modules(routes.__path__)]
    http = {r.path for module in modules for r in module.router.routes if hasattr(r, "methods") and r.include_in_schema}
    assert len(http) > 15
    assert {routes.PREFIX + path for path in http} <= set(paths)
