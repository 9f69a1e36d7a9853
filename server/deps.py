"""What a request handler works with, made once by the application."""

from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends
from starlette.requests import HTTPConnection

from server.auth import Auth, Caller
from server.bulk import Bulk, Made
from server.lease import Desk
from server.live import Live
from server.map_file import MapFile
from server.metrics import Metrics
from server.recordings import Library
from server.runs import Runs
from server.state import Json, state_json
from server.telemetry import Telemetry
from server.teleop import Teleop
from server.viewer import Viewer
from snakeslam.config import Config
from snakeslam.recording.datasets import Summary
from snakeslam.runtime.spec import SessionSpec
from snakeslam.runtime.topics import Stop


@dataclass(frozen=True, slots=True)
class House:
    """Everything that the server is made of; ``spec`` is the simulator session it starts with."""

    auth: Auth
    config: Config
    spec: SessionSpec
    live: Live
    desk: Desk
    teleop: Teleop
    telemetry: Telemetry
    viewer: Viewer
    runs: Runs
    library: Library
    metrics: Metrics
    bulk: Bulk
    map_file: MapFile
    recordings: Made[dict[str, Summary]]

    def state(self) -> Json:
        """GET /state."""
        return state_json(self.live, self.desk)

    def need_control(self, caller: Caller) -> None:
        """Raise a Problem unless ``caller`` may move the robot now."""
        self.desk.need(caller.lease_key, caller.identity)
        self.metrics.leased.set(1)

    async def stop_if_moving(self) -> None:
        """Bring a robot that moves to rest."""
        if self.live.moving:
            await self.live.command(Stop())


def _house(connection: HTTPConnection) -> House:
    return connection.app.state.house


def _caller(connection: HTTPConnection) -> Caller:
    return connection.state.caller


Rooms = Annotated[House, Depends(_house)]
Who = Annotated[Caller, Depends(_caller)]
