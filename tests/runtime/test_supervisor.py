"""Child processes that die are reported, started again after a wait, and given up where that is no use."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from snakeslam.errors import InputError
from snakeslam.runtime.process.node import Child, Life, spawn
from snakeslam.runtime.process.supervisor import LONGEST_S, TRIES, Supervisor, backoff_s


def live_on(life: Life) -> None:
    life.wait(60.0)


def die(life: Life) -> None:
    os._exit(3)


def fail(life: Life) -> None:
    raise RuntimeError("it\nbroke")


def refuse(life: Life) -> None:
    raise InputError("a setting", "is wrong")


def finish(life: Life) -> None:
    life.end()


def bear(pids: str, life: Life) -> None:
    """Have a child of its own, as the robot node has its camera."""
    child = spawn("grandchild", live_on)
    Path(pids).write_text(str(child.process.pid))
    life.wait(60.0)
    child.stop()


class Watched:
    def __init__(self) -> None:
        self.reported: list[tuple[str, str, bool]] = []
        self.supervisor = Supervisor(lambda *what: self.reported.append(what))

    def start(self, run: Callable[..., None]) -> None:
        self.supervisor.start("child", lambda: spawn("child", run))

    def wait_for(self, condition: Callable[[], object]) -> None:
        until = time.monotonic() + 30.0
        while not condition():
            assert time.monotonic() < until, self.reported
            time.sleep(0.02)


@pytest.fixture
def watched() -> Iterator[Watched]:
    watched = Watched()
    yield watched
    watched.supervisor.close()


def test_a_child_that_is_killed_is_started_again(watched: Watched) -> None:
    watched.start(live_on)
    first = watched.supervisor.pid("child")
    assert first is not None
    os.kill(first, signal.SIGKILL)
    watched.wait_for(lambda: watched.supervisor.pid("child") != first)
    assert watched.reported == [("child", "the process ended unexpectedly (signal 9)", False)]


def test_a_wrong_input_is_final_for_it_would_only_fail_again(watched: Watched) -> None:
    watched.start(refuse)
    watched.wait_for(lambda: watched.reported)
    assert watched.reported == [("child", "a setting: is wrong", True)]


def test_a_child_that_fails_is_started_again_until_it_has_failed_too_often(watched: Watched) -> None:
    watched.start(fail)
    watched.wait_for(lambda: watched.reported and watched.reported[-1][2])
    assert watched.reported == [("child", "RuntimeError: it broke", k == TRIES - 1) for k in range(TRIES)]


def test_a_child_that_cannot_be_started_again_is_tried_again_and_reported(watched: Watched) -> None:
    first = spawn("child", die)
    starts = iter([first])
    watched.supervisor.start("child", lambda: next(starts))
    watched.wait_for(lambda: watched.reported and watched.reported[-1][2])
    assert watched.reported[0] == ("child", "the process ended unexpectedly (exit code 3)", False)
    assert watched.reported[-1][1].startswith("StopIteration")


def test_an_error_in_on_death_leaves_no_child_unwatched() -> None:
    heard: list[str] = []

    def on_death(name: str, reason: str, final: bool) -> None:
        heard.append(reason)
        raise RuntimeError("the listener is broken")

    supervisor = Supervisor(on_death)
    try:
        supervisor.start("child", lambda: spawn("child", live_on))
        first = supervisor.pid("child")
        assert first is not None
        os.kill(first, signal.SIGKILL)
        until = time.monotonic() + 30.0
        while supervisor.pid("child") == first:
            assert time.monotonic() < until, heard
            time.sleep(0.02)
    finally:
        supervisor.close()


def test_an_end_as_planned_is_final_and_has_no_reason(watched: Watched) -> None:
    watched.start(finish)
    watched.wait_for(lambda: watched.reported)
    assert watched.reported == [("child", "", True)]


def test_the_wait_before_a_start_grows_to_a_limit() -> None:
    waits = [backoff_s(deaths) for deaths in range(1, 12)]
    assert waits == sorted(waits)
    assert waits[0] < 0.5
    assert waits[-1] == LONGEST_S


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def test_closing_ends_a_frozen_child_too(watched: Watched) -> None:
    watched.start(live_on)
    pid = watched.supervisor.pid("child")
    assert pid is not None
    os.kill(pid, signal.SIGSTOP)
    watched.supervisor.close()
    assert not alive(pid)
    assert watched.reported == []


def test_a_child_of_a_killed_child_ends_by_itself(tmp_path: Path) -> None:
    child: Child = spawn("child", bear, str(tmp_path / "pid"))
    until = time.monotonic() + 30.0
    while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text():
        assert time.monotonic() < until
        time.sleep(0.02)
    pid = int((tmp_path / "pid").read_text())
    assert alive(pid)
    child.process.kill()
    child.process.join()
    while alive(pid):
        assert time.monotonic() < until
        time.sleep(0.02)
    child.pipe.close()


def test_an_endless_supervisor_gives_nothing_up() -> None:
    reported: list[bool] = []
    supervisor = Supervisor(lambda _name, _reason, final: reported.append(final), endless=True)
    supervisor.start("child", lambda: spawn("child", fail))
    until = time.monotonic() + 30.0
    while len(reported) < 2:
        assert time.monotonic() < until
        time.sleep(0.02)
    supervisor.close()
    assert not any(reported)
