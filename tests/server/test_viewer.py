"""The viewer's proxy: the page and the scene come out, nothing but camera poses goes in."""

import asyncio
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import msgspec
import pytest
import uvicorn
import zstandard
from fastapi import FastAPI
from viser import _messages as viser_messages
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from server.viewer_host import start_viser, stop_viser
from server.viewer_proxy import SUBPROTOCOL, ViewerProxy, camera_message
from tests.server.running import TOKEN, Running, wait_for

BEARER = {"Authorization": f"Bearer {TOKEN}"}
CAMERA: dict[str, Any] = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [1.0, 2.0, 3.0],
    "fov": 1.3,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 600,
    "image_width": 800,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}
HOSTILE: dict[str, Any] = {
    "disable a button": {"type": "GuiUpdateMessage", "uuid": "x", "updates": {"update_cb": []}},
    "open a tunnel": {"type": "ShareUrlRequest"},
    "close a tunnel": {"type": "ShareUrlDisconnect"},
    "draw": {"type": "RemoveSceneNodeMessage", "name": "/robot"},
    "click": {"type": "ScenePointerMessage", "event_type": "click"},
    "upload": {"type": "FileTransferStartUpload", "source_component_uuid": "x"},
    "an unknown type": {"type": "os.system"},
    "not a number": CAMERA | {"fov": float("nan")},
    "one field too many": CAMERA | {"excluded_self_client": 3},
    "one field too few": {key: value for key, value in CAMERA.items() if key != "far"},
    "a vector too long": CAMERA | {"position": [1.0] * 400},
    "a list in a number": CAMERA | {"near": [1.0]},
    "a truth for a number": CAMERA | {"near": True},
    "no object": [1, 2, 3],
}


def viewer(server: Running, subprotocol: str = SUBPROTOCOL, query: str = "") -> ClientConnection:
    url = f"{server.websocket}/viewer{query}"
    options: dict[str, Any] = {"additional_headers": BEARER, "compression": None, "max_size": None}
    return connect(url, subprotocols=[Subprotocol(subprotocol)], **options)


def close_of(socket: ClientConnection) -> tuple[int, str]:
    """Read to the end; return the close frame's code and reason."""
    with pytest.raises(ConnectionClosed) as closed:
        read_on(socket)
    assert closed.value.rcvd is not None
    return closed.value.rcvd.code, closed.value.rcvd.reason


def read_on(socket: ClientConnection) -> None:
    while True:
        socket.recv(timeout=30)


def scene_messages(frame: bytes) -> list[dict[str, Any]]:
    packed = int.from_bytes(frame[8:16], "little")
    return msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(frame[16 : 16 + packed]))["messages"]


def test_the_page_comes_through_with_its_policy(client: httpx.Client) -> None:
    page = client.get("/viewer/")
    assert page.status_code == 200
    policy = page.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "frame-ancestors 'self'" in policy
    assert "hasFocus" in page.text
    assert client.get("/viewer").headers["location"] == "/viewer/"


@pytest.mark.parametrize(
    "query", ["?websocket=ws://evil.example", "?playbackPath=http://evil.example/x", "?a=1&websocket="]
)
def test_the_page_accepts_no_other_source(client: httpx.Client, query: str) -> None:
    assert client.get(f"/viewer/{query}").status_code == 400


@pytest.mark.parametrize("path", ["/viewer/../../etc/passwd", "/viewer/%2e%2e/%2e%2e/etc/passwd", "/viewer/x.js"])
def test_there_is_one_page_only(client: httpx.Client, path: str) -> None:
    assert client.get(path).status_code == 404


def test_the_scene_comes_through(server: Running) -> None:
    names: set[str] = set()
    with viewer(server) as socket:
        socket.send(msgspec.msgpack.encode(CAMERA))
        until = time.monotonic() + 10.0
        while not {"/robot", "/camera", "/estimate", "/grid"} <= names and time.monotonic() < until:
            names |= {m["name"] for m in scene_messages(bytes(socket.recv(timeout=30))) if "name" in m}  # type: ignore[arg-type]
    assert {"/robot", "/camera", "/estimate", "/grid"} <= names
    assert any(name.startswith("/map/") for name in names)


def test_another_viewer_version_is_refused_with_a_reason(server: Running) -> None:
    with viewer(server, "viser-v0.2.0") as socket:
        assert close_of(socket)[0] == 1002
    with viewer(server, query="?websocket=ws://evil.example") as socket:
        assert close_of(socket)[0] == 1002


def test_hostile_clients_are_ignored_and_keep_their_view(server: Running) -> None:
    with viewer(server) as socket:
        for message in HOSTILE.values():
            socket.send(msgspec.msgpack.encode(message))
        socket.send(b"\xc1 broken")
        socket.send("text")
        socket.send(b"\x00" * 60_000)
        socket.send(msgspec.msgpack.encode(CAMERA))
        for _ in range(20):
            socket.recv(timeout=30)


@pytest.mark.parametrize("name", HOSTILE)
def test_only_whole_camera_poses_pass_the_filter(name: str) -> None:
    assert camera_message(msgspec.msgpack.encode(HOSTILE[name])) is None


def test_a_camera_pose_passes_the_filter_unchanged() -> None:
    passed = camera_message(msgspec.msgpack.encode(CAMERA))
    assert passed is not None
    assert msgspec.msgpack.decode(passed) == CAMERA


@pytest.mark.parametrize("raw", [b"", b"\xc1", b"\x91" * 3000, b"\x00" * 5000])
def test_broken_messages_do_not_pass_the_filter(raw: bytes) -> None:
    assert camera_message(raw) is None


class Behind:
    """A viser server with a button, behind the proxy, and all that reached it."""

    def __init__(self, folder: Path) -> None:
        self.server = start_viser(folder / "v.sock")
        self.button = self.server.gui.add_button("STOP")
        self.reached: list[str] = []
        handle = self.server._websock_server._handle_incoming_message

        async def note(client_id: Any, message: Any) -> None:
            self.reached.append(type(message).__name__)
            await handle(client_id, message)

        self.server._websock_server._handle_incoming_message = note  # type: ignore[method-assign]
        self.url = ""

    def connect(self) -> ClientConnection:
        return connect(self.url, compression=None, max_size=None, subprotocols=[Subprotocol(SUBPROTOCOL)])


@contextmanager
def proxy(path: Path) -> Iterator[str]:
    """Serve the proxy alone, without sign-in and limits; yield its websocket's address."""
    app = FastAPI()
    app.add_api_websocket_route("/viewer", ViewerProxy(path)._serve)
    server = uvicorn.Server(uvicorn.Config(app, port=0, log_level="error", ws_per_message_deflate=False))
    thread = threading.Thread(target=server.run)
    thread.start()
    wait_for(lambda: server.started)
    yield f"ws://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}/viewer"
    server.should_exit = True
    thread.join(10)


@pytest.fixture
def behind(tmp_path: Path) -> Iterator[Behind]:
    made = Behind(tmp_path)
    with proxy(tmp_path / "v.sock") as made.url:
        yield made
    stop_viser(made.server)


def test_nothing_hostile_reaches_viser(behind: Behind) -> None:
    """The control: a camera pose does arrive, after all the others that must not."""
    update = {"type": "GuiUpdateMessage", "uuid": behind.button._impl.uuid, "updates": {"disabled": True}}
    with behind.connect() as socket:
        for message in (update, *HOSTILE.values(), CAMERA):
            socket.send(msgspec.msgpack.encode(message))
        wait_for(lambda: behind.reached)
    assert behind.reached == ["ViewerCameraMessage"]
    assert behind.button.disabled is False


def test_viser_has_no_port_and_no_share_handlers(behind: Behind, tmp_path: Path) -> None:
    assert (tmp_path / "v.sock").stat().st_mode & 0o777 == 0o600
    handlers = behind.server._websock_server._incoming_handlers
    assert viser_messages.ShareUrlRequest not in handlers
    assert viser_messages.ShareUrlDisconnect not in handlers


def test_visers_own_close_code_is_handed_on(behind: Behind) -> None:
    with behind.connect() as socket:
        socket.recv(timeout=30)
        for connection in list(behind.server._websock_server._live_connections.values()):
            loop = behind.server.get_event_loop()
            asyncio.run_coroutine_threadsafe(connection.close(4321, "enough"), loop)
        assert close_of(socket) == (4321, "enough")


def test_a_viewer_that_is_gone_is_said_so(tmp_path: Path) -> None:
    with proxy(tmp_path / "nothing.sock") as url, connect(url, subprotocols=[Subprotocol(SUBPROTOCOL)]) as socket:
        assert close_of(socket) == (1013, "the viewer does not answer")
