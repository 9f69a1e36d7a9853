"""The OpenAPI schema as it is answered: one rule for the refusals of every operation, instead of words on each route.

What stands before the routes (``guard``) may refuse anything; what commands the session may conflict with it, or find
it silent; a body may be too large, of another kind, or wrong. All of these are problem+json.
"""

import json
import re
from collections.abc import Iterator
from http import HTTPStatus
from typing import Any, Literal, cast

from fastapi import FastAPI, Request
from fastapi.openapi.utils import get_openapi
from pydantic import BaseModel, TypeAdapter
from starlette.requests import HTTPConnection

from server.auth import COOKIE, LEASE_HEADER
from server.models import ImageHeader, TelemetryMessage
from server.problem import MEDIA_TYPE, Problem
from server.routes import PREFIX
from server.runs import FROM_REQUEST, PATH_KEYS
from server.teleop import TeleopAnswer, TeleopInput
from snakeslam.config import Config
from snakeslam.paths import configs_dir
from snakeslam.runtime.robot.deadman import DEADMAN_S
from snakeslam.studies.metrics import Metrics

WRITES = ("post", "put", "delete", "patch")
ALWAYS = (HTTPStatus.UNAUTHORIZED, HTTPStatus.MISDIRECTED_REQUEST, HTTPStatus.TOO_MANY_REQUESTS, 503)
WRITING = (HTTPStatus.FORBIDDEN, HTTPStatus.CONFLICT, HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
WITH_BODY = (HTTPStatus.BAD_REQUEST, HTTPStatus.UNSUPPORTED_MEDIA_TYPE, HTTPStatus.UNPROCESSABLE_ENTITY)
WITH_QUERY = (HTTPStatus.UNPROCESSABLE_ENTITY,)
WITH_PARAMETER = (HTTPStatus.NOT_FOUND,)
WITH_QUERY = (HTTPStatus.UNPROCESSABLE_ENTITY,)
BINARY = {"type": "string", "format": "binary"}
TEXT = {"type": "string"}
FILES: dict[str, dict[str, Any]] = {
    f"{PREFIX}/map.ply": {"application/octet-stream": BINARY},
    f"{PREFIX}/runs/{{run_id}}/artifacts/{{name}}": {
        "application/octet-stream": BINARY,
        "application/json": {},
        "text/csv; charset=utf-8": TEXT,
        "text/plain; charset=utf-8": TEXT,
        "image/png": BINARY,
    },
    "/metrics": {"text/plain; version=0.0.4; charset=utf-8": TEXT},
}
"""What an operation answers that is no JSON of the API's own."""
OPEN = {(f"{PREFIX}/session", "post")}
"""Operations for those who have not signed in."""
WEBSOCKETS = {
    f"{PREFIX}/telemetry": {
        "description": "State, ticks, events and features as JSON text, camera images as binary messages.",
        "sends": {"$ref": "#/components/schemas/TelemetryMessage"},
    },
    f"{PREFIX}/teleop": {
        "description": "Drive input: hello with the lease's key, then pings and drives. Operators only.",
        "sends": {"$ref": "#/components/schemas/TeleopAnswer"},
        "receives": {"$ref": "#/components/schemas/TeleopInput"},
    },
}
MESSAGES: dict[str, tuple[Any, Literal["validation", "serialization"]]] = {
    "TelemetryMessage": (TelemetryMessage, "serialization"),
    "ImageHeader": (ImageHeader, "serialization"),
    "TeleopInput": (TeleopInput, "validation"),
    "TeleopAnswer": (TeleopAnswer, "serialization"),
}
"""What goes over the websockets, which OpenAPI cannot describe: components of the schema."""
PROBLEM: dict[str, Any] = {
    "title": "Problem",
    "description": "RFC 9457; detail is one line: where, what, and what is allowed.",
    "type": "object",
    "required": ["type", "title", "status", "detail"],
    "properties": {
        "type": TEXT,
        "title": TEXT,
        "status": {"type": "integer", "minimum": 400, "maximum": 599},
        "detail": TEXT,
    },
}


def messages_schema() -> dict[str, Any]:
    """Return the schemas of the websockets' messages and of what they are made of, by name."""
    found: dict[str, Any] = {}
    for name, (kind, mode) in MESSAGES.items():
        schema = TypeAdapter(kind).json_schema(mode=mode, ref_template="#/components/schemas/{model}")
        found |= schema.pop("$defs", {}) | {name: schema}
    return found


def metrics_schema() -> dict[str, Any]:
    """Return the schema of a run's metrics; any may be missing in a run that another version of the program wrote."""
    schema = TypeAdapter(Metrics).json_schema()
    return _inlined(schema, schema.pop("$defs"))


def _inlined(form: Any, kinds: dict[str, Any]) -> Any:
    """Return a schema with its references replaced by what they name, and without required keys."""
    if isinstance(form, list):
        return [_inlined(part, kinds) for part in cast("list[Any]", form)]
    if not isinstance(form, dict):
        return form
    known = cast("dict[str, Any]", form)
    if "$ref" in known:
        return _inlined(kinds[known["$ref"].rpartition("/")[2]], kinds)
    return {key: _inlined(value, kinds) for key, value in known.items() if key not in ("required", "default")}


def overrides_schema(without: tuple[str, ...] = ()) -> dict[str, Any]:
    """Return the schema of ``overrides``: every setting by its dotted name, those of file names and ``without`` not."""
    known = {key: form for key, form in _settings(Config, "") if key not in (*PATH_KEYS, *without)}
    return {"type": "object", "additionalProperties": False, "maxProperties": 64, "properties": known}


def _settings(group: type[BaseModel], prefix: str) -> Iterator[tuple[str, dict[str, Any]]]:
    forms = group.model_json_schema()["properties"]
    for name, info in group.model_fields.items():
        kind: Any = info.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            yield from _settings(kind, f"{prefix}{name}.")
            continue
        form = forms[name]
        if not any(part in json.dumps(form) for part in ('"array"', '"object"', '"$ref"')):
            yield prefix + name, form


def install(app: FastAPI) -> None:
    """Let ``app`` describe itself by these rules."""

    def described() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = describe(get_openapi(title=app.title, version=app.version, routes=app.routes))
        return app.openapi_schema

    app.openapi = described  # type: ignore[method-assign]


def describe(schema: dict[str, Any]) -> dict[str, Any]:
    """Return ``schema`` with every refusal, every file and the two kinds of sign-in."""
    components = schema.setdefault("components", {})
    kinds = components.setdefault("schemas", {})
    for name in ("HTTPValidationError", "ValidationError"):
        kinds.pop(name, None)
    kinds |= messages_schema() | {"Problem": PROBLEM, "RunMetrics": metrics_schema()}
    components["securitySchemes"] = {
        "token": {"type": "http", "scheme": "bearer"},
        "session": {"type": "apiKey", "in": "cookie", "name": COOKIE},
    }
    schema["paths"]["/metrics"] = {"get": {"operationId": "metrics", "summary": "Figures", "tags": ["state"]}}
    schema["x-websockets"] = WEBSOCKETS
    # The build of the page takes the limit from here.
    schema["x-deadman-ms"] = round(DEADMAN_S * 1e3)
    for name, without in (("RunRequest", tuple(FROM_REQUEST)), ("SimRequest", ())):
        kinds[name]["properties"]["overrides"] = overrides_schema(without)
    kinds["RunRequest"]["properties"]["config"]["enum"] = sorted(path.stem for path in configs_dir().glob("*.yaml"))
    for path, operations in schema["paths"].items():
        for method, operation in operations.items():
            _complete(path, method, operation)
    return schema


def _complete(path: str, method: str, operation: dict[str, Any]) -> None:
    responses: dict[str, Any] = operation.setdefault("responses", {})
    responses.pop("422", None)
    for status in _refusals(path, method, operation):
        responses[str(int(status))] = _refusal(HTTPStatus(status))
    if path in FILES:
        content = {kind: {"schema": form} for kind, form in FILES[path].items()}
        responses["200"] = {"description": "The file" if path != "/metrics" else "The figures", "content": content}
    if (path, method) not in OPEN:
        operation["security"] = [{"token": []}, {"session": []}]
    if method in WRITES and (path, method) not in OPEN:
        description = "The key of the caller's lease, for what needs control."
        header = {"name": LEASE_HEADER, "in": "header", "required": False, "description": description, "schema": TEXT}
        operation.setdefault("parameters", []).append(header)


def _refusals(path: str, method: str, operation: dict[str, Any]) -> list[int]:
    found: list[int] = [*ALWAYS]
    found += WRITING if method in WRITES else ()
    found += WITH_BODY if "requestBody" in operation else ()
    found += WITH_QUERY if any(given["in"] == "query" for given in operation.get("parameters", ())) else ()
    found += WITH_PARAMETER if "{" in path else ()
    asks = any(parameter["in"] == "query" for parameter in operation.get("parameters", []))
    found += WITH_QUERY if asks and "requestBody" not in operation else ()
    return sorted(set(found))


def _refusal(status: HTTPStatus) -> dict[str, Any]:
    content = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
    answer: dict[str, Any] = {"description": status.phrase, "content": content}
    if status == HTTPStatus.TOO_MANY_REQUESTS:
        answer["headers"] = {"Retry-After": {"description": "Seconds to wait", "schema": {"type": "integer"}}}
    return answer


def methods_at(app: FastAPI, path: str) -> list[str]:
    """Return the methods that the API knows at ``path``; none where there is nothing."""
    found: set[str] = set()
    for template, operations in app.openapi()["paths"].items():
        if re.fullmatch(re.sub(r"\\\{[a-z_]+\\\}", "[^/]+", re.escape(template)), path):
            found |= {method.upper() for method in operations}
    return sorted(set(found))


async def json_only(request: HTTPConnection) -> None:
    """Refuse a body of another media type than JSON where one is expected; a router's websockets have none."""
    if not isinstance(request, Request):
        return
    route = request.scope.get("route")
    if getattr(route, "body_field", None) is None or not await request.body():
        return
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind != "application/json":
        shown = kind[:60] or "no media type"
        raise Problem(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, f"Content-Type: {shown} (allowed: application/json)")
