"""The telemetry stream, as a page or a script gets it."""

import asyncio
import json
import socket
import struct
import time
from collections.abc import Callable
from itertools import pairwise

import cv2
import httpx
import numpy as np
import pytest
from websockets.sync.client import ClientConnection, connect

from server.metrics import Metrics
from server.telemetry import Client
from tests.server.running import TOKEN, Running

WAIT_S = 20.0
BEARER = {"Authorization": f"Bearer {TOKEN}"}


def listen(server: Running, **options: object) -> ClientConnection:
    url = f"{server.websocket}/api/v1/telemetry"
    return connect(url, close_timeout=0.5, additional_headers=BEARER, **options)  # type: ignore[arg-type]


def collect(stream: ClientConnection, done: Callable[[list[str | bytes]], object]) -> list[str | bytes]:
    """Read until ``done`` holds of what has come; a busy machine may take its time."""
    found: list[str | bytes] = []
    until = time.monotonic() + WAIT_S
    while not done(found):
        found.append(stream.recv(timeout=max(0.0, until - time.monotonic())))
    return found


def ticks_said(count: int) -> Callable[[list[str | bytes]], bool]:
    return lambda messages: len(texts(messages, "tick")) >= count


def texts(messages: list[str | bytes], kind: str) -> list[dict]:
    return [m for m in map(json.loads, (m for m in messages if isinstance(m, str))) if m["type"] == kind]


def test_state_comes_first_and_ticks_follow_at_no_more_than_20_hz(server: Running, client: httpx.Client) -> None:
    with listen(server) as stream:
        first, started = json.loads(stream.recv(timeout=30)), time.monotonic()
        messages = collect(stream, ticks_said(20))
        seconds = time.monotonic() - started
    assert first.pop("type") == "state"
    assert set(first) == set(client.get("/api/v1/state").json())
    ticks = texts(messages, "tick")
    assert len(ticks) <= 20 * seconds + 2
    assert all(a["t_s"] < b["t_s"] for a, b in pairwise(ticks))
    tick = ticks[-1]
    assert len(tick["q_target"]) == len(tick["q_measured"]) == 24
    assert tick["head_control"] == {"controller": "predictive", "neck_joints": 4}
    assert {"yaw_deg", "yaw_rms_deg", "yaw_rate_deg_s", "peak_yaw_rate_deg_s", "sway_m"} <= set(tick["head"])
    assert tick["map_points"] > 0
    assert len(tick["body"]["p_m"]) == 3 * 25
    assert tick["body"]["estimated"]
    assert tick["error_m"] < 0.05


def test_images_come_and_so_do_their_features(server: Running) -> None:
    with listen(server) as stream:
        images, features = collect_pair(stream)
    seq, (header, jpeg) = next((seq, images[seq]) for seq in features if seq in images)
    assert (header["width"], header["height"]) == (320, 240)
    assert features[seq]["tracks"]
    for x_px, y_px, inlier, _ in features[seq]["tracks"]:
        assert -1 <= x_px <= 320
        assert -1 <= y_px <= 240
        assert inlier in (0, 1)
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert image.shape == (240, 320, 3)


def collect_pair(stream: ClientConnection) -> tuple[dict[int, tuple[dict, bytes]], dict[int, dict]]:
    """Read until some image and its own features have come; slam may be behind the camera on a busy machine."""
    images: dict[int, tuple[dict, bytes]] = {}
    features: dict[int, dict] = {}
    until = time.monotonic() + WAIT_S
    while not images.keys() & features.keys():
        message = stream.recv(timeout=max(0.0, until - time.monotonic()))
        if isinstance(message, bytes):
            assert message[0] == 1
            (length,) = struct.unpack_from("<I", message, 1)
            header = json.loads(message[5 : 5 + length])
            images[header["seq"]] = (header, message[5 + length :])
        elif (message := json.loads(message))["type"] == "features":
            features[message["seq"]] = message
    return images, features


def test_a_change_is_published(server: Running, client: httpx.Client) -> None:
    latched = {"latched": True, "reason": "test"}
    with listen(server) as stream:
        collect(stream, ticks_said(3))
        client.post("/api/v1/estop", json={"reason": "test"})
        collect(stream, lambda said: any(s["estop"] == latched for s in texts(said, "state")) and _warned(said))


def _warned(messages: list[str | bytes]) -> bool:
    return any(event["level"] == "error" and "test" in event["text"] for event in texts(messages, "event"))


def test_a_client_that_does_not_read_hurts_nobody(server: Running) -> None:
    """Its socket fills up, and the others still receive."""
    slow = socket.create_connection(("127.0.0.1", int(server.url.rsplit(":", 1)[1])))
    slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    key = (
        "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: "
        + "A" * 22
        + "=="
    )
    host = server.url.removeprefix("http://")
    slow.sendall(
        f"GET /api/v1/telemetry HTTP/1.1\r\nHost: {host}\r\nAuthorization: Bearer {TOKEN}\r\n{key}\r\n\r\n".encode()
    )
    with slow, listen(server) as quick:
        collect(quick, ticks_said(60))


def test_what_a_client_says_is_ignored(server: Running) -> None:
    with listen(server) as stream:
        stream.send("stop!")
        stream.send(b"\x00" * 1000)
        collect(stream, ticks_said(1))


def test_a_queue_keeps_the_newest_of_each_kind_and_the_last_events() -> None:
    queue = Client(Metrics())
    for k in range(300):
        queue.put("tick", f"tick {k}")
        queue.put("image", bytes([k % 256]))
        queue.put("state", f"state {k}")
        queue.put_event(f"event {k}")
    batch = asyncio.run(queue.next())
    assert batch[0] == "state 299"
    assert batch[1:-2] == [f"event {k}" for k in range(200, 300)]
    assert batch[-2:] == ["tick 299", bytes([299 % 256])]


def test_a_queue_without_news_waits() -> None:
    queue = Client(Metrics())
    queue.put("tick", "only")

    async def twice() -> None:
        assert await queue.next() == ["only"]
        await asyncio.wait_for(queue.next(), 0.05)

    with pytest.raises(TimeoutError):
        asyncio.run(twice())
