"""The proxy before viser: HTTP and one websocket at /viewer/; of a client's messages only its camera's pose passes."""

import asyncio
import math
from http import HTTPStatus
from pathlib import Path
from typing import Any

import httpx
import msgspec
from fastapi import APIRouter, Request, WebSocket
from starlette.responses import RedirectResponse, Response
from starlette.websockets import WebSocketDisconnect
from viser import __version__ as viser_version
from websockets.asyncio.client import ClientConnection, unix_connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.typing import Subprotocol

from server.background import note
from server.deps import CallerDep, ServicesDep
from server.problem import Problem

SUBPROTOCOL = f"viser-v{viser_version}"
MAX_MESSAGE_BYTES = 4096
REFUSED_PARAMETERS = ("websocket", "playbackPath")
POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:; style-src 'unsafe-inline'; "
    "img-src 'self' data: blob:; font-src data:; connect-src 'self' data: blob:; worker-src blob:; "
    "frame-ancestors 'self'"
)
# Its panel and its notices have nothing to offer here, and in a frame it would wait for the focus to connect.
# viewer-frame.js must run before viser's own script.
HEAD = (
    "<head><style>[data-floating-window],[data-dock-region],.mantine-Paper-root,.mantine-Notifications-root"
    "{display:none!important}</style>"
    '<script>document.hasFocus=()=>true</script><script src="/viewer-frame.js"></script>'
)
# Fields of viser's ViewerCameraMessage: how many numbers each one has (0: a bare one).
CAMERA_FIELDS = {
    "wxyz": 4,
    "position": 3,
    "fov": 0,
    "near": 0,
    "far": 0,
    "image_height": 0,
    "image_width": 0,
    "look_at": 3,
    "up_direction": 3,
}


def camera_message(raw: bytes) -> bytes | None:
    """Return ``raw`` written anew if it is a ViewerCameraMessage of finite numbers and nothing else, or None."""
    if len(raw) > MAX_MESSAGE_BYTES:
        return None
    try:
        message: Any = msgspec.msgpack.decode(raw)
    except (msgspec.DecodeError, RecursionError):
        return None
    if not isinstance(message, dict) or message.get("type") != "ViewerCameraMessage":
        return None
    if set(message) != {"type", *CAMERA_FIELDS}:
        return None
    if not all(_numbers(message[key], count) for key, count in CAMERA_FIELDS.items()):
        return None
    return msgspec.msgpack.encode(message)


def _numbers(value: Any, count: int) -> bool:
    if count:
        return isinstance(value, list) and len(value) == count and all(_numbers(number, 0) for number in value)
    return type(value) in (int, float) and math.isfinite(value)


class ViewerProxy:
    """Serves /viewer/ from the viser server on the Unix socket ``path``."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._http = httpx.AsyncClient(transport=httpx.AsyncHTTPTransport(uds=str(path)), base_url="http://viewer")
        self.router = APIRouter(include_in_schema=False)
        self.router.add_api_route("/viewer", self._redirect, methods=["GET"])
        self.router.add_api_route("/viewer/{file:path}", self._get, methods=["GET", "HEAD"])
        # Its client's socket has the page's address without the last slash.
        self.router.add_api_websocket_route("/viewer", self._socket)
        self.router.add_api_websocket_route("/viewer/", self._socket)

    async def close(self) -> None:
        """Close what is open to viser."""
        await self._http.aclose()

    async def _redirect(self) -> Response:
        return RedirectResponse("/viewer/", HTTPStatus.PERMANENT_REDIRECT)

    async def _get(self, request: Request, file: str) -> Response:
        refused = [name for name in REFUSED_PARAMETERS if name in request.query_params]
        if refused:
            raise Problem(HTTPStatus.BAD_REQUEST, f"{refused[0]}: the viewer takes no other source")
        if file not in ("", "index.html"):
            raise Problem(HTTPStatus.NOT_FOUND, "the viewer is one page")
        try:
            page = await self._http.get("/", headers={"Accept-Encoding": "identity"})
        except httpx.TransportError as error:
            raise Problem(HTTPStatus.BAD_GATEWAY, "the viewer does not answer") from error
        text = page.text.replace("<head>", HEAD, 1)
        return Response(text, page.status_code, {"Content-Security-Policy": POLICY}, "text/html; charset=utf-8")

    async def _socket(self, client: WebSocket, services: ServicesDep, caller: CallerDep) -> None:
        await services.sockets.serve("viewer", client, caller, self._serve)

    async def _serve(self, client: WebSocket) -> None:
        offered: list[str] = client.scope.get("subprotocols", [])
        # A close code only reaches a client whose handshake was taken.
        await client.accept(SUBPROTOCOL if SUBPROTOCOL in offered else next(iter(offered), None))
        if SUBPROTOCOL not in offered or client.url.query:
            await client.close(1002, "another viewer version or address is needed")
            return
        try:
            upstream = await unix_connect(
                str(self._path),
                "ws://viewer/",
                subprotocols=[Subprotocol(SUBPROTOCOL)],
                compression=None,
                max_size=None,
                max_queue=4,
            )
        except (OSError, InvalidHandshake, TimeoutError):
            await client.close(1013, "the viewer does not answer")
            return
        async with upstream:
            await _relay(client, upstream)


async def _relay(client: WebSocket, upstream: ClientConnection) -> None:
    """Pass messages both ways until one side closes; the client gets viser's own close code."""
    outward = asyncio.create_task(_outward(client, upstream))
    inward = asyncio.create_task(_inward(client, upstream))
    try:
        await asyncio.wait({outward, inward}, return_when=asyncio.FIRST_COMPLETED)
        if outward.done() and not inward.done():
            code = upstream.close_code
            usable = code is not None and code not in (1005, 1006)
            await client.close(code if usable and code is not None else 1011, upstream.close_reason or "")
    finally:
        for task in (outward, inward):
            task.cancel()
        for result in await asyncio.gather(outward, inward, return_exceptions=True):
            if isinstance(result, Exception):
                note("a viewer socket", result)


async def _outward(client: WebSocket, upstream: ClientConnection) -> None:
    try:
        async for message in upstream:
            await client.send_bytes(message if isinstance(message, bytes) else message.encode())
    except (ConnectionClosed, WebSocketDisconnect, RuntimeError):
        return


async def _inward(client: WebSocket, upstream: ClientConnection) -> None:
    """Pass camera poses on; drop everything else silently."""
    try:
        while True:
            message = await client.receive()
            if message["type"] == "websocket.disconnect":
                return
            camera = camera_message(message.get("bytes") or b"")
            if camera is not None:
                await upstream.send(camera)
    except (ConnectionClosed, WebSocketDisconnect, RuntimeError):
        return
