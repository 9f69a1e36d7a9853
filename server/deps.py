"""What a request handler works with, made once by the application."""

from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends
from starlette.requests import HTTPConnection

from server.auth import Auth
from server.live import Live
from server.metrics import Metrics
from server.recordings import Library
from server.runs import Runs
from server.telemetry import Telemetry
from server.viewer import Viewer
from snakeslam.config import Config
from snakeslam.runtime.session import SessionSpec


@dataclass(frozen=True, slots=True)
class House:
    """Everything that the server is made of; ``spec`` is the simulator session it starts with."""

    auth: Auth
    config: Config
    spec: SessionSpec
    live: Live
    telemetry: Telemetry
    viewer: Viewer
    runs: Runs
    library: Library
    metrics: Metrics


def _house(connection: HTTPConnection) -> House:
    return connection.app.state.house


Rooms = Annotated[House, Depends(_house)]
