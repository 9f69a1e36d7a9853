"""Signing in and out, and as what."""

import asyncio
from http import HTTPStatus

from fastapi import APIRouter, Request
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import Response

from server.auth import Role, delete_cookie, set_cookie
from server.deps import CallerDep, ServicesDep
from server.models import Answer
from server.problem import Problem

# Guessing shall be slow.
WRONG_S = 0.5

router = APIRouter(tags=["session"])


class SignIn(BaseModel):
    """POST /session."""

    model_config = ConfigDict(extra="forbid", strict=True)

    token: str = Field(max_length=512)


class SessionAnswer(Answer):
    """As what the caller is signed in."""

    role: Role


@router.post("/session", status_code=HTTPStatus.NO_CONTENT)
async def sign_in(request: SignIn, connection: Request, services: ServicesDep) -> Response:
    """Open a session for the token and set its cookie."""
    session = await services.auth.sign_in(request.token.strip())
    if session is None:
        await asyncio.sleep(WRONG_S)
        host = connection.client.host if connection.client is not None else ""
        if not services.limiter.allows("sign_in", host):
            detail = "too many wrong tokens; the right one is taken at any time"
            raise Problem(HTTPStatus.TOO_MANY_REQUESTS, detail)
        raise Problem(HTTPStatus.UNAUTHORIZED, "this is not the token")
    response = Response(status_code=HTTPStatus.NO_CONTENT)
    set_cookie(response, session, connection, services.auth.sessions.lasting_s)
    return response


@router.get("/session")
async def get_session(caller: CallerDep) -> SessionAnswer:
    """What the caller may do: an operator may take control, a viewer only watch and press the E-stop."""
    return SessionAnswer(role=caller.role)


@router.delete("/session", status_code=HTTPStatus.NO_CONTENT)
async def sign_out(request: Request, services: ServicesDep, caller: CallerDep, everywhere: bool = False) -> Response:
    """End the session of this browser for good, and its websockets with it; an operator may end all sessions."""
    if everywhere and caller.role != "operator":
        raise Problem(HTTPStatus.FORBIDDEN, "only an operator may sign everybody out")
    for session in await services.auth.sign_out(request, everywhere):
        await services.session_over(session)
    response = Response(status_code=HTTPStatus.NO_CONTENT)
    delete_cookie(response, request)
    return response
