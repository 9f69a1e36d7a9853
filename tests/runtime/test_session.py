"""The session of a recording: its process with its pipe."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest

from snakeslam.config import Config
from snakeslam.geometry import se3, so3
from snakeslam.messages import GroundTruth, MapChunk
from snakeslam.robot.model import RobotSettings
from snakeslam.runtime.assembly.spec import SessionSpec
from snakeslam.runtime.bus.commands import ControlPlayback, Shutdown, Stop
from snakeslam.runtime.bus.topics import Ended, Features, JpegImage, Report, Started, Tick
from snakeslam.runtime.session.recording import Session, start_session
from snakeslam.runtime.view.live import TruthView
from tests.small_recordings import write_robot

Kind = TypeVar("Kind")
CONFIG = Config(robot=RobotSettings(model="orthogonal24"))


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_robot(tmp_path_factory.mktemp("recording") / "sensors", 6.0)


@pytest.fixture(scope="module")
def spec(recording: Path) -> SessionSpec:
    return SessionSpec(CONFIG, recording=recording)


def last(reports: list[Report], kind: type[Kind]) -> Kind:
    return next(report for report in reversed(reports) if isinstance(report, kind))


def play_until(session: Session, reports: list[Report], condition: Callable[[Tick], bool]) -> Tick:
    """Play without waiting for real time, which only the caller of a session does."""
    for _ in range(10_000):
        session.step()
        if any(isinstance(report, Tick) for report in reports) and condition(tick := last(reports, Tick)):
            return tick
    raise AssertionError("it did not come")


def position_s(tick: Tick) -> float:
    assert tick.playback is not None
    return tick.playback.position_s


def test_it_starts_with_what_there_is_to_draw(spec: SessionSpec) -> None:
    reports: list[Report] = []
    Session(spec, reports.append)
    started = reports[0]
    assert isinstance(started, Started)
    assert started.robot is not None
    assert (started.robot.model, started.robot.joint_count) == ("orthogonal24", 24)
    assert started.aspect == pytest.approx(320 / 240)
    assert started.fov_y_rad == pytest.approx(2 * np.arctan(0.5))


def test_links_hang_on_the_estimate(spec: SessionSpec) -> None:
    reports: list[Report] = []
    session = Session(spec, reports.append)
    tick = play_until(session, reports, lambda tick: tick.T_WI is not None and tick.map_points > 0)
    assert tick.T_WI is not None
    assert tick.Ts_WL is not None
    model = session.backend.model
    assert model is not None
    assert np.allclose(tick.Ts_WL[-1] @ model.T_HI, tick.T_WI, atol=1e-9)


def test_seeking_back_shows_what_was_computed_and_the_end_is_no_end(spec: SessionSpec) -> None:
    reports: list[Report] = []
    session = Session(spec, reports.append)
    session.on_command(ControlPlayback(paused=True, position_s=1.0))
    first = play_until(session, reports, lambda tick: position_s(tick) == 1.0)
    features = last(reports, Features)
    session.on_command(ControlPlayback(paused=False))
    end = play_until(session, reports, lambda tick: tick.playback is not None and tick.playback.at_end)
    session.step()
    assert last(reports, Ended) == Ended(None)
    session.on_command(ControlPlayback(paused=True, position_s=1.0))
    again = play_until(session, reports, lambda tick: position_s(tick) == 1.0)
    assert again.T_WI is not None
    assert first.T_WI is not None
    assert end.T_WI is not None
    assert np.array_equal(again.T_WI, first.T_WI)
    assert not np.array_equal(again.T_WI, end.T_WI)
    assert (again.t_ns, again.health) == (first.t_ns, first.health)
    assert last(reports, Features) == features
    assert last(reports, JpegImage).t_ns == again.t_ns
    session.on_command(ControlPlayback(step=-1))
    play_until(session, reports, lambda tick: position_s(tick) == pytest.approx(0.95))


def test_seeking_does_not_change_what_is_estimated(spec: SessionSpec) -> None:
    poses: list[np.ndarray] = []
    for positions_s in ((), (0.7, 0.2, 1.5, 0.1)):
        reports: list[Report] = []
        session = Session(spec, reports.append)
        for goal_s in positions_s:
            session.on_command(ControlPlayback(position_s=goal_s))
            play_until(session, reports, lambda tick: tick.playback is not None and not tick.playback.seeking)
        session.on_command(ControlPlayback(position_s=100.0))
        tick = play_until(session, reports, lambda tick: tick.playback is not None and tick.playback.at_end)
        assert tick.T_WI is not None
        poses.append(tick.T_WI)
    assert np.array_equal(*poses)


@pytest.fixture
def child(spec: SessionSpec) -> Iterator[tuple[BaseProcess, Connection]]:
    process, pipe = start_session(spec)
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
    wanted = (JpegImage, Features, MapChunk, Tick)
    kinds = {type(report) for kind in wanted for report in read_until(pipe, kind)}
    assert set(wanted) <= kinds
    # Ctrl-C in the terminal reaches the session too; its host decides.
    assert process.pid is not None
    os.kill(process.pid, signal.SIGINT)
    pipe.send(Stop())
    sent = time.monotonic()
    while (tick := read_until(pipe, Tick)[-1]).commands_done < 1:  # type: ignore[union-attr]
        pass
    assert time.monotonic() - sent < 2.0
    assert isinstance(tick, Tick)
    assert not tick.moving
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


def test_a_recording_that_is_not_there_is_the_last_word(spec: SessionSpec) -> None:
    process, pipe = start_session(replace(spec, recording=Path("nowhere")))
    ended = read_until(pipe, Ended)[-1]
    assert isinstance(ended, Ended)
    assert (ended.error or "").startswith("nowhere: no such recording")
    process.join(10)
    pipe.close()
    process.close()


def test_an_image_that_vanishes_while_it_plays_is_the_last_word(spec: SessionSpec, tmp_path: Path) -> None:
    folder = write_robot(tmp_path / "sensors", 20.0)
    process, pipe = start_session(replace(spec, recording=folder))
    read_until(pipe, Tick)
    for image in (folder / "rgb").iterdir():
        image.unlink()
    ended = read_until(pipe, Ended)[-1]
    assert isinstance(ended, Ended)
    assert str(folder / "rgb") in (ended.error or "")
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
