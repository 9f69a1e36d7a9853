"""The telemetry websocket: every client gets the newest state, tick and image; a slow one gets fewer."""

import asyncio
import re
from collections import deque
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from server import models, state
from server.background import first_of
from server.lease import Desk
from server.live import Live
from server.metrics import Metrics
from server.view import View
from snakeslam.messages import MapChunk
from snakeslam.runtime.bus.topics import Ended, Event, Features, JpegImage, Opening, Report, Started, Tick

MAX_EVENTS = 100
STALLED_S = 15.0
PING = re.compile(r'\{"type":"ping","t_ms":(\d{1,15}(?:\.\d{1,9})?)\}')
# Fields that change at every tick do not count as a change of the state.
NOT_NEWS = ("t_s", "realtime_factor", "health", "head", "playback")


class Client:
    """The bounded queue of one websocket: newest wins, except for events."""

    def __init__(self, metrics: Metrics) -> None:
        self._metrics = metrics
        self._newest: dict[str, str | bytes] = {}
        self._events: deque[str] = deque(maxlen=MAX_EVENTS)
        self._changed = asyncio.Event()

    def put(self, kind: str, message: str | bytes) -> None:
        """Replace what has not been sent of this kind."""
        if kind in self._newest:
            self._metrics.dropped.labels(kind).inc()
        self._newest[kind] = message
        self._changed.set()

    def forget(self) -> None:
        """Drop what has not been sent of a session that has ended, except for events."""
        self._newest.clear()

    def put_event(self, message: str) -> None:
        """Queue an event for the timeline."""
        self._events.append(message)
        self._changed.set()

    async def next(self) -> list[str | bytes]:
        """Wait for messages and take them: state first, then events, tick, image."""
        await self._changed.wait()
        self._changed.clear()
        first = [self._newest.pop("state")] if "state" in self._newest else []
        batch = [*first, *self._events, *self._newest.values()]
        self._newest.clear()
        self._events.clear()
        return batch


class Telemetry:
    """Fans the session's reports out to websockets."""

    def __init__(self, live: Live, desk: Desk, metrics: Metrics) -> None:
        self._live, self._desk, self._metrics = live, desk, metrics
        self._clients: set[Client] = set()
        self._recent: deque[str] = deque(maxlen=MAX_EVENTS)
        self._news: dict[str, Any] = {}
        self._image: JpegImage | None = None
        live.subscribe(self._on_report)

    async def serve(self, socket: WebSocket) -> None:
        """Serve one websocket until either side ends it."""
        await socket.accept()
        client = Client(self._metrics)
        client.put("state", self._state_text())
        for text in self._recent:
            client.put_event(text)
        if (image := self._lasting_image) is not None:
            client.put("image", image)
        self._clients.add(client)
        self._metrics.clients.set(len(self._clients))
        try:
            await first_of("a telemetry socket", _until_closed(socket, client), _send_all(socket, client))
        finally:
            self._clients.discard(client)
            self._metrics.clients.set(len(self._clients))

    @property
    def _lasting_image(self) -> bytes | None:
        """The newest image of a recording, which may be paused: no other may follow. A robot's image must be fresh."""
        view = self._live.view
        recording = view.tick is not None and view.tick.playback is not None
        return state.image_bytes(view, self._image) if recording and self._image is not None else None

    def publish_state(self) -> None:
        """Send the state to all clients, as after a change that no report carries."""
        self._news = self._news_of()
        text = self._state_text()
        for client in self._clients:
            client.put("state", text)

    def say(self, level: str, text: str) -> None:
        """Add a line of the server's own to the timeline, and publish the state that goes with it."""
        view = self._live.view
        t_ns = 0 if view.tick is None else view.tick.t_ns
        self._event(state.timeline_event(view, Event(t_ns, level, text)).model_dump_json())
        self.publish_state()

    def _on_report(self, report: Report, view: View) -> None:
        if isinstance(report, Tick):
            self._metrics.on_tick(report)
            self._broadcast("tick", state.tick_message(view, report).model_dump_json())
        elif isinstance(report, Opening):
            self._image = None
            for client in self._clients:
                client.forget()
        elif isinstance(report, JpegImage):
            self._metrics.images.inc()
            self._image = report
            if self._clients:
                self._broadcast("image", state.image_bytes(view, report))
        elif isinstance(report, Features):
            self._broadcast("features", state.features_message(view, report).model_dump_json())
        elif isinstance(report, Event):
            self._event(state.timeline_event(view, report).model_dump_json())
        elif isinstance(report, Ended):
            text = "the session ended" if report.error is None else report.error
            level = "info" if report.error is None else "error"
            self.say(level, text)
        self._metrics.on_phase(view.phase)
        if isinstance(report, Opening | Started | Ended | Event) or self._has_news(report):
            self.publish_state()

    def _has_news(self, report: Report) -> bool:
        return not isinstance(report, MapChunk | JpegImage | Features) and self._news_of() != self._news

    def _news_of(self) -> dict[str, Any]:
        now = state.state(self._live, self._desk)
        news = {key: value for key, value in now if key not in NOT_NEWS}
        return news | {"verdict": now.health.verdict, "map_connected": now.health.map_connected}

    def _state_text(self) -> str:
        return models.StateMessage.model_construct(**dict(state.state(self._live, self._desk))).model_dump_json()

    def _broadcast(self, kind: str, message: str | bytes) -> None:
        for client in self._clients:
            client.put(kind, message)

    def _event(self, text: str) -> None:
        self._recent.append(text)
        for client in self._clients:
            client.put_event(text)


async def _until_closed(socket: WebSocket, client: Client) -> None:
    """Answer pings, so that a page knows its round trip; forget everything else: clients have nothing to say here."""
    try:
        while True:
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            ping = PING.fullmatch(message.get("text") or "")
            if ping is not None:
                client.put("pong", models.Pong(t_ms=float(ping[1])).model_dump_json())
    except (WebSocketDisconnect, RuntimeError):
        return


async def _send_all(socket: WebSocket, client: Client) -> None:
    """Send what is queued; a client that receives nothing for STALLED_S is disconnected."""
    try:
        while True:
            for message in await client.next():
                async with asyncio.timeout(STALLED_S):
                    if isinstance(message, str):
                        await socket.send_text(message)
                    else:
                        await socket.send_bytes(message)
    except TimeoutError:
        await socket.close(1013, "too slow")
    except (WebSocketDisconnect, RuntimeError):
        return
