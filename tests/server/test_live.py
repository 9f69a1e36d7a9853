"""The order of E-stop, reset and reports, with a session that is slow to answer."""

import asyncio
import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from http import HTTPStatus
from multiprocessing import Pipe
from multiprocessing.connection import Connection

import numpy as np

from server.live import Live
from server.problem import Problem
from snakeslam.config import Config
from snakeslam.messages import HeadCommand, Health, Verdict
from snakeslam.runtime.assembly.spec import SessionSpec
from snakeslam.runtime.bus.commands import Command, EStop, ResetEStop, SetHead, Shutdown, Start
from snakeslam.runtime.bus.topics import HeadMotion, Refusal, Report, Started, Tick
from snakeslam.runtime.session.pipe_host import PipeHost

TICK = Tick(
    t_ns=0,
    commands_done=0,
    moving=False,
    estop_reason=None,
    gait=None,
    health=Health(Verdict.GOOD),
    realtime_factor=None,
    frame_rate_hz=None,
    q_target_rad=None,
    q_measured_rad=None,
    T_WI=None,
    Ts_WL=None,
    T_WI_truth=None,
    head=HeadMotion(),
    error_m=None,
    distance_m=None,
    map_points=0,
)


@dataclass
class SlowSession:
    """Stands for the process: reports once more what it was before it obeys a command."""

    pipe: "Connection[Report, Command]"
    exitcode: int = 0
    before_obeying: Callable[[Command], None] = lambda _: None
    tick: Tick = TICK
    thread: threading.Thread = field(init=False)

    def __post_init__(self) -> None:
        self.thread = threading.Thread(target=self.run)
        self.thread.start()

    def run(self) -> None:
        self.pipe.send(Started(0, "vio", None, np.eye(4), 1.0, 1.3, None))
        self.pipe.send(self.tick)
        while not isinstance(command := self.pipe.recv(), Shutdown):
            self.before_obeying(command)
            self.pipe.send(self.tick)
            reason = command.reason if isinstance(command, EStop) else None
            number = self.tick.commands_done + 1
            refusals = self.tick.refusals
            if isinstance(command, SetHead):
                refusals = (*refusals, Refusal(number, f"head.controller: {command.head.controller} cannot be"))
            self.tick = replace(self.tick, estop_reason=reason, commands_done=number, refusals=refusals)
            self.pipe.send(self.tick)
        self.pipe.close()

    def join(self, timeout: float | None = None) -> None:
        self.thread.join(timeout)

    def is_alive(self) -> bool:
        return self.thread.is_alive()

    def close(self) -> None:
        pass


def start(sessions: list[SlowSession]) -> Callable[[SessionSpec], tuple[SlowSession, "Connection[Command, Report]"]]:
    def start_session(spec: SessionSpec) -> tuple[SlowSession, "Connection[Command, Report]"]:
        ours, theirs = Pipe()
        sessions.append(SlowSession(theirs))
        return sessions[-1], ours

    return start_session


async def live_session(sessions: list[SlowSession]) -> Live:
    live = Live(Config(), lambda spec, _: PipeHost(spec, start(sessions)))
    await live.start(SessionSpec(Config()), "sim", "simulator")
    while live.view.phase != "running":
        await asyncio.sleep(0.01)
    return live


def test_a_tick_under_way_does_not_undo_a_reset() -> None:
    async def scenario() -> None:
        live = await live_session([])
        try:
            await live.estop("a reason")
            assert live.estop_reason == "a reason"
            await live.reset_estop()
            assert live.estop_reason is None
        finally:
            await live.stop()

    asyncio.run(scenario())


def test_an_estop_during_a_reset_stays() -> None:
    async def scenario() -> None:
        sessions: list[SlowSession] = []
        live = await live_session(sessions)
        loop = asyncio.get_running_loop()

        def press_again(command: Command) -> None:
            if isinstance(command, ResetEStop):
                asyncio.run_coroutine_threadsafe(press(), loop).result(2.0)

        async def press() -> None:
            again.append(asyncio.create_task(live.estop("again")))

        again: list[asyncio.Task[None]] = []
        try:
            await live.estop("first")
            sessions[0].before_obeying = press_again
            await live.reset_estop()
            assert live.estop_reason is not None
            await again[0]
            assert live.estop_reason is not None
        finally:
            await live.stop()

    asyncio.run(scenario())


def test_a_refusal_reaches_its_sender_and_nobody_else() -> None:
    """The session's word on one command comes with that of others, as the newest tick replaces those before it."""

    async def scenario() -> None:
        live = await live_session([])
        try:
            commands = (SetHead(HeadCommand(0, "first")), Start(), SetHead(HeadCommand(0, "second")), Start())
            answers = await asyncio.gather(*(live.command(command) for command in commands), return_exceptions=True)
        finally:
            await live.stop()
        assert [answer is None for answer in answers] == [False, True, False, True]
        for answer, name in ((answers[0], "first"), (answers[2], "second")):
            assert isinstance(answer, Problem)
            assert answer.status == HTTPStatus.CONFLICT
            assert name in answer.detail

    asyncio.run(scenario())
