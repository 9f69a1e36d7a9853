"""Stops a robot that nobody controls: after the lease has lapsed, and before the server ends."""

import asyncio
from time import monotonic

import numpy as np
import structlog

from server.background import attempt, keep_on
from server.deps import Services
from server.problem import Problem
from snakeslam.runtime.bus.topics import Tick

POLL_S, SESSIONS_S = 0.1, 0.5
HOLD_S = 2.0
HELD_RAD = 1e-4
_log = structlog.get_logger("keeper")


class Keeper:
    """Stops the robot when the lease lapses, and before the server ends."""

    def __init__(self, services: Services) -> None:
        self._services = services

    async def watch(self) -> None:
        """Watch the lease until cancelled."""
        await keep_on("the watch over the lease", self._poll, self._services.telemetry.say)

    async def _poll(self) -> None:
        await asyncio.sleep(POLL_S)
        lease = self._services.desk.lapse()
        if lease is not None:
            # The robot is stopped even where the report fails.
            attempt("reporting the lease", lambda: self._services.publish_lease(lease, "lapsed"))
            await self._stop()

    async def watch_sessions(self) -> None:
        """Close what sessions that have ended left open, until cancelled."""
        await keep_on("the watch over the sessions", self._end_sessions, self._services.telemetry.say)

    async def _end_sessions(self) -> None:
        await asyncio.sleep(SESSIONS_S)
        for session in await self._services.auth.sessions.poll():
            try:
                await self._services.session_over(session)
            except Problem as problem:
                _log.error("the robot could not be stopped", why=problem.detail)

    async def hold(self) -> None:
        """Bring a robot that moves to a hold; waits for it HOLD_S at most."""
        if not self._services.live.moving:
            return
        _log.info("bringing the robot to a hold")
        await self._stop()
        until, before = monotonic() + HOLD_S, self._services.live.view.tick
        while monotonic() < until:
            await asyncio.sleep(POLL_S)
            tick = self._services.live.view.tick
            if tick is None or before is None or _held(before, tick):
                return
            before = tick
        _log.warning("the robot did not come to a hold in time")

    async def _stop(self) -> None:
        try:
            await self._services.stop_if_moving()
        except Problem as problem:
            _log.error("the robot could not be stopped", why=problem.detail)


def _held(before: Tick, now: Tick) -> bool:
    """Whether the joint targets are constant; a robot without any has nothing to hold."""
    if before.q_target_rad is None or now.q_target_rad is None:
        return True
    newer = now.t_ns > before.t_ns and not now.moving
    return newer and bool(np.max(np.abs(now.q_target_rad - before.q_target_rad)) < HELD_RAD)
