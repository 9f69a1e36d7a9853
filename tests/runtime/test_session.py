"""The live session: its commands in the loop, and its process with its pipe."""

import os
import signal
import time
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np
import pytest

from snakeslam.config import Config
from snakeslam.geometry import se3, so3
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import GaitCommand, GroundTruth, HeadCommand, MapChunk
from snakeslam.robot.model import RobotSettings
from snakeslam.runtime.live import TruthView
from snakeslam.runtime.session import Session, SessionSpec, start_session
from snakeslam.runtime.topics import (
    Ended,
    EStop,
    Event,
    Picture,
    Report,
    ResetEStop,
    SetGait,
    SetHead,
    Shutdown,
    Start,
    Started,
    Stop,
    Tick,
)
from tests.server.still_robot import BREAKS, ENDS, StillRobot, still_robot

CONFIG = Config(robot=RobotSettings(model="orthogonal24"))
SPEC = SessionSpec(CONFIG, build=still_robot)


class Bench:
    """A session in this process, and all that it reported."""

    def __init__(self, spec: SessionSpec = SPEC, frame_every: int = 100) -> None:
        self.robot = StillRobot(frame_every=frame_every)
        self.reports: list[Report] = []
        self.session = Session(replace(spec, build=lambda _: self.robot), self.reports.append)

    def steps(self, count: int) -> np.ndarray:
        """Advance; return the targets that reached the robot."""
        before = len(self.robot.targets)
        for _ in range(count):
            self.session.step()
        return np.array([target.q_rad for target in self.robot.targets[before:]])

    @property
    def tick(self) -> Tick:
        self.session.report()
        return [report for report in self.reports if isinstance(report, Tick)][-1]


def test_it_starts_with_what_there_is_to_draw() -> None:
    started = Bench().reports[0]
    assert isinstance(started, Started)
    assert started.robot is not None
    assert (started.robot.model, started.robot.joint_count) == ("orthogonal24", 24)
    assert started.aspect == pytest.approx(320 / 240)
    assert started.fov_y_rad == pytest.approx(2 * np.arctan(0.5))


def test_nothing_moves_before_it_is_told_to() -> None:
    bench = Bench()
    still = bench.steps(100)
    assert np.ptp(still[50:], axis=0).max() == 0.0
    bench.session.take(Start())
    assert bench.tick.moving
    moving = bench.steps(300)
    assert np.ptp(moving, axis=0).max() > 0.1


def test_autostart_waits_for_the_rest() -> None:
    bench = Bench(replace(SPEC, autostart=True))
    bench.steps(49)
    assert not any(isinstance(report, Event) and "start" in report.text for report in bench.reports)
    bench.steps(30)
    assert bench.tick.moving or any(isinstance(report, Event) and "start" in report.text for report in bench.reports)


def test_the_estop_holds_within_one_control_step() -> None:
    bench = Bench()
    bench.session.take(Start())
    q = bench.steps(400)
    limits = bench.robot.model.limits
    speed = np.abs(q[-1] - q[-2]) / 0.01
    assert speed.max() > 0.1
    bench.session.take(EStop("test"))
    assert bench.tick.estop_reason == "test"
    assert not bench.tick.moving
    q = np.vstack([q[-1], bench.steps(100)])
    rates = np.abs(np.diff(q, axis=0)) / 0.01
    assert np.all(rates[0] <= np.maximum(speed - limits.acceleration_rad_s2 * 0.01, 0.0) + 1e-9)
    assert rates[20:].max() == 0.0


def test_only_a_start_moves_it_after_the_estop() -> None:
    bench = Bench()
    bench.session.take(Start())
    bench.steps(300)
    bench.session.take(EStop("test"))
    held = bench.steps(100)[-1]
    for command in (Start(), SetGait(GaitCommand(0, "sidewinding")), ResetEStop(), Stop()):
        bench.session.take(command)
        assert np.array_equal(bench.steps(60), np.tile(held, (60, 1))), command
    bench.session.take(Start())
    q = np.vstack([held, bench.steps(400)])
    assert np.ptp(q, axis=0).max() > 0.05
    assert np.abs(np.diff(q, axis=0)).max() / 0.01 <= bench.robot.model.limits.rate_rad_s


def test_a_session_that_begins_latched_does_not_autostart() -> None:
    bench = Bench(replace(SPEC, autostart=True, estop_reason="from before"))
    q = bench.steps(200)
    assert np.ptp(q, axis=0).max() == 0.0
    assert bench.tick.estop_reason == "from before"
    bench.session.take(ResetEStop())
    assert np.ptp(bench.steps(100), axis=0).max() == 0.0


def test_every_command_is_counted_and_answered_at_once() -> None:
    bench = Bench()
    for number, command in enumerate((Start(), Stop(), EStop("x"), ResetEStop()), 1):
        bench.session.take(command)
        assert bench.tick.commands_done == number


def test_a_gait_set_at_rest_is_the_one_that_starts() -> None:
    bench = Bench()
    bench.session.take(SetGait(GaitCommand(0, "sidewinding", drive=1.0, period_s=5.0)))
    assert np.ptp(bench.steps(100)[50:], axis=0).max() == 0.0
    assert bench.tick.gait is not None
    assert (bench.tick.gait.gait, bench.tick.gait.period_s, bench.tick.gait.drive) == ("sidewinding", 5.0, 0.0)


def events(bench: Bench) -> list[tuple[str, str]]:
    return [(report.level, report.text) for report in bench.reports if isinstance(report, Event)]


def test_the_head_is_set_while_moving_and_told() -> None:
    bench = Bench()
    bench.session.take(Start())
    bench.steps(200)
    bench.session.take(SetHead(HeadCommand(0, "none", neck_joints=5)))
    assert bench.tick.head_settings == HeadSettings(neck_joints=5)
    assert bench.tick.refusals == ()
    assert ("info", "neck of 5 yaw joints") in events(bench)
    assert bench.tick.moving


@pytest.mark.parametrize(
    "command",
    [
        SetHead(HeadCommand(0, "steady")),
        SetHead(HeadCommand(0, neck_joints=99)),
        SetHead(HeadCommand(0, "none", turn_by_deg=15.0)),
        SetGait(GaitCommand(0, "flying")),
        SetGait(GaitCommand(0, "serpentine", alpha_pi=0.7, period_s=0.5)),
    ],
)
def test_what_cannot_be_done_is_told_and_changes_nothing(command: SetHead | SetGait) -> None:
    bench, untouched = Bench(), Bench()
    for one in (bench, untouched):
        one.session.take(Start())
        one.steps(200)
    bench.session.take(command)
    tick = bench.tick
    assert tick.commands_done == 2
    assert [refusal.number for refusal in tick.refusals] == [2]
    assert ("error", tick.refusals[0].reason) in events(bench)
    assert (tick.gait, tick.head_settings) == (untouched.tick.gait, untouched.tick.head_settings)
    assert np.array_equal(bench.steps(100), untouched.steps(100))


def test_a_gait_that_barely_advances_is_told_and_its_period_is_the_window() -> None:
    bench = Bench()
    assert bench.tick.notice is None
    assert bench.tick.head.window_s == pytest.approx(4.0)
    bench.session.take(SetGait(GaitCommand(0, "serpentine", alpha_pi=0.7, wavelength_joints=20, period_s=8.0)))
    assert bench.tick.notice is not None
    assert "11 %" in bench.tick.notice
    assert bench.tick.head.window_s == pytest.approx(8.0)
    bench.session.take(SetGait(GaitCommand(0, "pedal")))
    assert bench.tick.notice is None


def test_links_hang_on_the_estimate() -> None:
    bench = Bench(frame_every=5)
    bench.steps(30)
    tick = bench.tick
    assert tick.T_WI is not None
    assert tick.Ts_WL is not None
    head = tick.Ts_WL[-1] @ bench.robot.model.T_HI
    assert np.allclose(head, tick.T_WI, atol=1e-9)
    assert tick.map_points > 0


@pytest.fixture
def child() -> Iterator[tuple[BaseProcess, Connection]]:
    process, pipe = start_session(SPEC)
    yield process, pipe
    pipe.close()
    process.join(10)
    assert process.exitcode is not None, "a session outlives its host"
    process.close()


def read_until(pipe: Connection, kind: type, timeout_s: float = 40.0) -> list[Report]:
    reports: list[Report] = []
    until = time.monotonic() + timeout_s
    while not reports or not isinstance(reports[-1], kind):
        assert pipe.poll(max(0.0, until - time.monotonic())), f"no {kind.__name__} in {len(reports)} reports"
        reports.append(pipe.recv())
    return reports


def test_the_process_reports_obeys_and_ends(child: tuple[BaseProcess, Connection]) -> None:
    process, pipe = child
    assert isinstance(read_until(pipe, Started)[-1], Started)
    kinds = {type(report) for report in read_until(pipe, Picture) + read_until(pipe, MapChunk) + read_until(pipe, Tick)}
    assert {Picture, MapChunk, Tick} <= kinds
    # Ctrl-C in the terminal reaches the session too; its host decides.
    assert process.pid is not None
    os.kill(process.pid, signal.SIGINT)
    pipe.send(EStop("test"))
    sent = time.monotonic()
    while (tick := read_until(pipe, Tick)[-1]).commands_done < 1:  # type: ignore[union-attr]
        pass
    assert time.monotonic() - sent < 2.0
    assert isinstance(tick, Tick)
    assert tick.estop_reason == "test"
    pipe.send(Shutdown())
    assert read_until(pipe, Ended)[-1] == Ended(None)
    process.join(10)
    assert process.exitcode == 0


def test_a_reader_that_sleeps_does_not_stop_the_loop(child: tuple[BaseProcess, Connection]) -> None:
    """Ticks and pictures are dropped, chunks are not, and time goes on."""
    _, pipe = child
    first = read_until(pipe, Tick)[-1]
    time.sleep(3.0)
    pipe.send(Stop())
    reports: list[Report] = []
    while not (isinstance(reports[-1] if reports else None, Tick) and reports[-1].commands_done == 1):  # type: ignore[union-attr]
        reports += read_until(pipe, Tick)
    ticks = [report for report in reports if isinstance(report, Tick)]
    assert isinstance(first, Tick)
    assert (ticks[-1].t_ns - first.t_ns) * 1e-9 > 1.5
    pipe.send(Shutdown())
    read_until(pipe, Ended)


def failing(seed: int) -> SessionSpec:
    return replace(SPEC, config=CONFIG.model_copy(update={"run": CONFIG.run.model_copy(update={"seed": seed})}))


@pytest.mark.parametrize(
    ("spec", "error"),
    [
        (failing(BREAKS), "RuntimeError: the fake robot broke"),
        (failing(ENDS), None),
        (replace(SPEC, build=None, recording=Path("nowhere")), "nowhere: no such recording"),
    ],
)
def test_the_last_word_says_how_it_ended(spec: SessionSpec, error: str | None) -> None:
    process, pipe = start_session(spec)
    last = read_until(pipe, Ended)[-1]
    assert isinstance(last, Ended)
    assert last.error == error or (error is not None and last.error is not None and last.error.startswith(error))
    process.join(10)
    pipe.close()
    process.close()


def test_the_truth_is_brought_to_the_first_pose_by_yaw_and_translation() -> None:
    view = TruthView()
    T_true = se3.from_rt(so3.exp(np.array([0.1, 0.2, 1.0])), np.array([5.0, -3.0, 2.0]))
    T_first = se3.from_rt(so3.exp(np.array([0.1, 0.2, 1.0])), np.zeros(3))
    view.on_truth([GroundTruth(0, T_true)])
    assert view.at(50_000_000, T_first) is None
    first = view.at(5_000_000, T_first)
    assert first is not None
    assert np.allclose(first, T_first)
    T_next = se3.from_rt(T_true[:3, :3], T_true[:3, 3] + np.array([0.0, 0.0, 1.0]))
    view.on_truth([GroundTruth(10_000_000, T_next)])
    later = view.at(10_000_000, None)
    assert later is not None
    assert np.allclose(later[:3, 3], [0.0, 0.0, 1.0])


def test_without_gravity_the_truth_is_brought_wholly_to_the_first_pose() -> None:
    view = TruthView(gravity_known=False)
    T_true = se3.from_rt(so3.exp(np.array([0.5, 0.2, 1.0])), np.array([5.0, -3.0, 2.0]))
    view.on_truth([GroundTruth(0, T_true)])
    aligned = view.at(0, np.eye(4))
    assert aligned is not None
    assert np.allclose(aligned, np.eye(4))
