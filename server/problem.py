"""Every refusal as problem+json (RFC 9457), with one clear line in ``detail``."""

from collections.abc import Callable
from http import HTTPStatus
from typing import Any

import structlog
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from snakeslam.errors import InputError, SnakeslamError

MEDIA_TYPE = "application/problem+json"
LONGEST_DETAIL = 1000
_log = structlog.get_logger("server")


class Problem(Exception):  # noqa: N818 - the word of RFC 9457
    """A refusal with its HTTP status."""

    def __init__(self, status: HTTPStatus, detail: str) -> None:
        self.status = status
        self.detail = detail
        super().__init__(detail)


def one_line(text: str, longest: int = LONGEST_DETAIL) -> str:
    """Return ``text`` as one line that can be shown and sent, cut to ``longest`` characters."""
    line = " ".join(text[: 4 * longest].split())
    line = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in line)
    return line if len(line) <= longest else line[: longest - 3] + "..."


def problem_response(status: int, detail: str, headers: dict[str, str] | None = None) -> JSONResponse:
    """Return the response that says ``detail``."""
    line = one_line(detail)
    body = {"type": "about:blank", "title": HTTPStatus(status).phrase, "status": int(status), "detail": line}
    return JSONResponse(body, int(status), headers, MEDIA_TYPE)


def validation_line(error: RequestValidationError) -> str:
    """Return the first complaint about a request in one line: where, what, what is allowed."""
    errors = error.errors()
    # Of a union's complaints, one about the value says more than those about the other types.
    first: dict[str, Any] = dict(next((e for e in errors if not str(e["type"]).endswith("_type")), errors[0]))
    where = ".".join(str(part) for part in first["loc"] if part != "body") or "body"
    if first["type"] == "extra_forbidden":
        return f"{where}: unknown key"
    given = first.get("input")
    shown = f" (given: {given!r})" if isinstance(given, str | int | float | bool) and len(repr(given)) <= 60 else ""
    return f"{where}: {' '.join(str(first['msg']).split())}{shown}"


def install(app: FastAPI, methods: Callable[[str], list[str]]) -> None:
    """Make every error of ``app`` a problem; ``methods`` are those possible at a path."""

    @app.exception_handler(Problem)
    async def _(_request: Request, error: Problem) -> JSONResponse:  # pyright: ignore[reportUnusedFunction]
        return problem_response(error.status, error.detail)

    @app.exception_handler(InputError)
    async def _(_request: Request, error: InputError) -> JSONResponse:  # pyright: ignore[reportUnusedFunction]
        return problem_response(HTTPStatus.UNPROCESSABLE_ENTITY, str(error))

    @app.exception_handler(SnakeslamError)
    async def _(_request: Request, error: SnakeslamError) -> JSONResponse:  # pyright: ignore[reportUnusedFunction]
        return problem_response(HTTPStatus.INTERNAL_SERVER_ERROR, str(error))

    @app.exception_handler(RequestValidationError)
    async def _(_request: Request, error: RequestValidationError) -> JSONResponse:  # pyright: ignore[reportUnusedFunction]
        return problem_response(HTTPStatus.UNPROCESSABLE_ENTITY, validation_line(error))

    @app.exception_handler(HTTPException)
    async def _(request: Request, error: HTTPException) -> JSONResponse:  # pyright: ignore[reportUnusedFunction]
        detail, headers = str(error.detail), dict(error.headers or {})
        if error.status_code == HTTPStatus.NOT_FOUND and detail == HTTPStatus.NOT_FOUND.phrase:
            detail = f"there is nothing at {request.url.path}"
        if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
            allowed = methods(request.url.path)
            if not allowed:
                return problem_response(HTTPStatus.NOT_FOUND, f"there is nothing at {request.url.path}")
            detail = f"{request.method} is not possible here (allowed: {', '.join(allowed)})"
            headers["Allow"] = ", ".join(allowed)
        return problem_response(error.status_code, detail, headers)

    @app.exception_handler(Exception)
    async def _(request: Request, error: Exception) -> JSONResponse:  # pyright: ignore[reportUnusedFunction]
        _log.error("request failed", path=request.url.path, error=repr(error))
        return problem_response(HTTPStatus.INTERNAL_SERVER_ERROR, "the server failed on this request; its log says why")
