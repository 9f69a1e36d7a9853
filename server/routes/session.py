"""Signing in and out, and as what."""

import asyncio
from http import HTTPStatus

from fastapi import APIRouter, Request
from pydantic import BaseModel, ConfigDict, Field
from starlette.responses import Response

from server.auth import COOKIE, set_cookie
from server.deps import Rooms, Who
from server.problem import Problem

# Guessing shall be slow.
WRONG_S = 0.5

router = APIRouter(tags=["session"])


class SignIn(BaseModel):
    """POST /session."""

    model_config = ConfigDict(extra="forbid", strict=True)

    token: str = Field(max_length=512)


@router.post("/session", status_code=HTTPStatus.NO_CONTENT)
async def sign_in(request: SignIn, house: Rooms) -> Response:
    """Open a session for the token and set its cookie."""
    session = house.auth.sign_in(request.token.strip())
    if session is None:
        await asyncio.sleep(WRONG_S)
        raise Problem(HTTPStatus.UNAUTHORIZED, "this is not the token")
    response = Response(status_code=HTTPStatus.NO_CONTENT)
    set_cookie(response, session)
    return response


@router.get("/session")
async def get_session(who: Who) -> dict[str, str]:
    """What the caller may do: an operator may take control, a viewer only watch and press the E-stop."""
    return {"role": who.role}


@router.delete("/session", status_code=HTTPStatus.NO_CONTENT)
async def sign_out(request: Request, house: Rooms) -> Response:
    """End the session of this browser."""
    house.auth.sign_out(request)
    response = Response(status_code=HTTPStatus.NO_CONTENT)
    response.delete_cookie(COOKIE, path="/", httponly=True, samesite="strict")
    return response
