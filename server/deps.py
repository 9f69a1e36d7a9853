"""What a request handler works with, made once by the application."""

from dataclasses import dataclass
from typing import Annotated

import structlog
from fastapi import Depends
from starlette.requests import HTTPConnection

from server import models
from server import state as states
from server.auth import Auth, Caller
from server.bulk import Bulk, Made
from server.lease import Desk, Lease
from server.limits import Limiter
from server.live import Live
from server.map_file import MapFile
from server.metrics import Metrics
from server.recordings import Library
from server.runs import Runs
from server.sessions import Session
from server.sockets import Sockets
from server.telemetry import Telemetry
from server.teleop import Teleop
from server.viewer import Viewer
from snakeslam.config import Config
from snakeslam.recording.datasets import Summary
from snakeslam.runtime.assembly.spec import SessionSpec
from snakeslam.runtime.bus.commands import Stop

_log = structlog.get_logger("control")


@dataclass(frozen=True, slots=True)
class Services:
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
    sockets: Sockets
    limiter: Limiter

    def state(self) -> models.State:
        """Return the answer of GET /state."""
        return states.state(self.live, self.desk)

    def need_control(self, caller: Caller) -> None:
        """Raise a Problem unless ``caller`` may move the robot now."""
        self.desk.need(caller.lease_key, caller.identity)
        self.metrics.leased.set(1)

    def publish_lease(self, lease: Lease, how: str, more: str = "") -> None:
        """Publish a change of the lease: metrics, log and timeline."""
        self.metrics.leases.labels(how).inc()
        self.metrics.leased.set(self.desk.lease is not None)
        _log.info("control", holder=lease.holder, how=how + more)
        level = "warning" if how in ("lapsed", "signed out") else "info"
        self.telemetry.say(level, f"{lease.holder}: control {how}{more}")

    async def session_over(self, session: Session) -> None:
        """Close the websockets of a session that has ended, and end its control: the robot stops."""
        self.sockets.end_session(session.identity)
        lease = self.desk.revoke(session.identity)
        if lease is not None:
            self.publish_lease(lease, "signed out")
            await self.stop_if_moving()

    async def stop_if_moving(self) -> None:
        """Stop a robot that moves."""
        if self.live.moving:
            await self.live.command(Stop())


def _services(connection: HTTPConnection) -> Services:
    return connection.app.state.services


def _caller(connection: HTTPConnection) -> Caller:
    return connection.state.caller


ServicesDep = Annotated[Services, Depends(_services)]
CallerDep = Annotated[Caller, Depends(_caller)]
