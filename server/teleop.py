"""The teleop websocket: drive input while it is held, checked for lease, order and age; silence or closing releases."""

import asyncio
import contextlib
from collections.abc import Callable
from time import monotonic
from typing import Annotated, Any, Literal
from uuid import uuid4

import structlog
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError
from starlette.websockets import WebSocket, WebSocketDisconnect

from server.background import first_of
from server.deadman import Deadman, DriveSample
from server.lease import Desk
from server.limits import Bucket, Rate
from server.live import Live
from server.metrics import Metrics
from server.models import Answer, Pong
from server.problem import Problem
from snakeslam.runtime.bus.commands import Drive, Stop

MAX_CHARS = 512
POLL_S = 0.05
LEASES_KEPT = 64
LOST_CONTROL, TOO_MUCH, BAD_MESSAGE = 4001, 4002, 4003
_log = structlog.get_logger("teleop")


class Input(BaseModel):
    """What a client sends, stamped by its own clock."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)

    t_ms: float


class Hello(BaseModel):
    """The first message of a socket."""

    model_config = ConfigDict(extra="ignore", strict=True)

    type: Literal["hello"]
    lease: str


class Ping(Input):
    """Renews the lease and shows the sender's clock; answered by a pong."""

    type: Literal["ping"]


class DriveInput(Input):
    """The deadman input: what the operator holds down now."""

    type: Literal["drive"]
    seq: Annotated[int, Field(strict=True, ge=0, lt=2**53)]
    drive: Annotated[float, Field(ge=-1, le=1)]
    turn: Annotated[float, Field(ge=-1, le=1)] = 0.0


class Ready(Answer):
    """The lease is good: pings and drives may follow."""

    type: Literal["ready"] = "ready"


class Done(Answer):
    """The robot has obeyed the drive of this number."""

    seq: int
    t_ms: float
    type: Literal["done"] = "done"


class Refused(Answer):
    """The drive of this number was refused."""

    seq: int
    t_ms: float
    detail: str
    type: Literal["refused"] = "refused"


TeleopInput = Hello | Ping | DriveInput
TeleopAnswer = Ready | Pong | Done | Refused
"""The messages of /teleop, distinguished by ``type``."""

_MESSAGE: TypeAdapter[Ping | DriveInput] = TypeAdapter(Annotated[Ping | DriveInput, Field(discriminator="type")])


class Teleop:
    """Serves operators' sockets; the robot obeys only that of the lease's holder."""

    def __init__(self, live: Live, desk: Desk, metrics: Metrics, rate: Rate) -> None:
        self._live, self._desk, self._metrics, self._rate = live, desk, metrics, rate
        self._drivers: set[Driver] = set()
        self._held_down: dict[str, None] = {}
        """Leases whose last socket ended with the drive held down: the next one must release it first."""
        desk.subscribe(self._on_change)

    async def serve(self, socket: WebSocket) -> None:
        """Serve one websocket until either side ends it, then release the drive."""
        await socket.accept()
        bucket = Bucket(self._rate, monotonic())
        driver = Driver(socket, self._live, self._desk, self._metrics, bucket, self._is_held_down)
        self._drivers.add(driver)
        self._metrics.drivers.set(len(self._drivers))
        try:
            await driver.run()
        finally:
            self._drivers.discard(driver)
            self._metrics.drivers.set(len(self._drivers))
            self._remember(driver)

    def _is_held_down(self, key: str) -> bool:
        return key in self._held_down or any(driver.key == key and driver.pressed for driver in self._drivers)

    def _remember(self, driver: "Driver") -> None:
        if driver.key is None:
            return
        self._held_down.pop(driver.key, None)
        if driver.pressed:
            self._held_down[driver.key] = None
        while len(self._held_down) > LEASES_KEPT:
            del self._held_down[next(iter(self._held_down))]

    def _on_change(self) -> None:
        for driver in self._drivers:
            driver.wake()


class Driver:
    """One socket: a reader that judges, and a writer that hands the newest input to the session and answers."""

    def __init__(
        self,
        socket: WebSocket,
        live: Live,
        desk: Desk,
        metrics: Metrics,
        bucket: Bucket,
        is_held_down: Callable[[str], bool],
    ) -> None:
        self._socket, self._live, self._desk, self._metrics = socket, live, desk, metrics
        self._bucket = bucket
        self._deadman, self._name = Deadman(), uuid4().hex[:8]
        self._is_held_down = is_held_down
        self.key: str | None = None
        self._newest: DriveInput | None = None
        self._moves = False
        self._changed = asyncio.Event()

    @property
    def pressed(self) -> bool:
        """Whether the drive is held down, as far as this socket has received."""
        return self._deadman.pressed

    def wake(self) -> None:
        """Check at once whether anything has changed."""
        self._changed.set()

    async def run(self) -> None:
        """Serve the socket until it closes or control is lost."""
        try:
            await first_of("a teleop socket", self._read(), self._write())
        finally:
            await self._release("the operator's page has gone")
            self._desk.hurry(self.key)

    async def _read(self) -> None:
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            while await self._on_message(await self._socket.receive()):
                pass

    async def _on_message(self, message: Any) -> bool:
        """Judge one message; False when the socket is over."""
        if message["type"] == "websocket.disconnect":
            return False
        if not self._bucket.spend(monotonic()):
            return await self._close(TOO_MUCH, "too many messages")
        text = message.get("text") or ""
        if self.key is None:
            return await self._hello(text)
        try:
            given = _MESSAGE.validate_json(text if len(text) <= MAX_CHARS else "")
        except ValidationError:
            self._metrics.drive.labels("malformed").inc()
            return await self._close(BAD_MESSAGE, "no such message")
        if isinstance(given, Ping):
            await self._ping(given)
        else:
            self._judge(given)
        return True

    async def _hello(self, text: str) -> bool:
        """Take the first message: {"type": "hello", "lease": KEY}."""
        try:
            key = Hello.model_validate_json(text if len(text) <= MAX_CHARS else "").lease
        except ValidationError:
            return await self._close(BAD_MESSAGE, "say hello with your lease first")
        if not self._desk.holds(key):
            return await self._close(LOST_CONTROL, "you do not have control")
        self._deadman.pressed = self._is_held_down(key)
        self.key = key
        await self._answer(Ready())
        return True

    async def _ping(self, ping: Ping) -> None:
        self._deadman.synchronise(ping.t_ms * 1e-3, monotonic())
        if self._desk.holds(self.key):
            self._desk.renew(self.key)
        await self._answer(Pong(t_ms=ping.t_ms))

    def _judge(self, given: DriveInput) -> None:
        why = self._deadman.add(DriveSample(given.seq, given.t_ms * 1e-3, given.drive, given.turn), monotonic())
        self._metrics.drive.labels(why or "taken").inc()
        if why is None:
            self._newest = given
            self._changed.set()

    async def _write(self) -> None:
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            while True:
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._changed.wait(), POLL_S)
                self._changed.clear()
                if self.key is not None and not self._desk.holds(self.key):
                    await self._release("control was lost")
                    await self._close(LOST_CONTROL, "you no longer have control")
                    return
                if self._deadman.silent(monotonic()):
                    await self._release("the drive input fell silent")
                elif self._newest is not None:
                    await self._obey()

    async def _obey(self) -> None:
        """Hand the newest input on; it answers when the session has obeyed."""
        given, self._newest = self._newest, None
        assert given is not None
        begins = self._deadman.pop_begins()
        refusal = await self._command(Drive(self._deadman.drive, self._deadman.turn, self._name, begins))
        if refusal is None:
            await self._answer(Done(seq=given.seq, t_ms=given.t_ms))
        else:
            await self._answer(Refused(seq=given.seq, t_ms=given.t_ms, detail=refusal))

    async def _command(self, command: Drive | Stop) -> str | None:
        """Drive or stop by the newest input; return why it was refused."""
        started = monotonic()
        try:
            self._moves = isinstance(command, Drive) and command.drive != 0.0
            if self._moves:
                self._live.need_drive()
            await self._live.command(command, self._deadman.received_s if self._moves else None)
        except Problem as problem:
            self._deadman.release()
            # Input that came meanwhile would be sent as a zero now, which the robot would take for a release.
            self._newest = None
            return problem.detail
        self._metrics.command_s.observe(monotonic() - started)
        return None

    async def _release(self, why: str) -> None:
        """Stop the robot, if this input moves it.

        A stop and not a drive of zero, which the robot would take for a release by the operator.
        """
        self._deadman.release()
        self._newest = None
        if not self._moves:
            return
        _log.warning("drive released", why=why)
        refusal = await asyncio.shield(self._command(Stop()))
        if refusal is not None:
            _log.error("release not confirmed", why=refusal)

    async def _answer(self, message: TeleopAnswer) -> None:
        await self._socket.send_text(message.model_dump_json())

    async def _close(self, code: int, why: str) -> bool:
        await self._socket.close(code, why)
        return False
