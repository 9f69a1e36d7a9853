"""A drive that is held down moves no robot that was held meanwhile, until it is released and pressed again."""

import os
import signal
import threading
import time
from collections.abc import Iterator

import httpx
import pytest

from snakeslam.runtime.robot.deadman import RELEASE_FIRST
from tests.faults.served import ROBOT, SERVER, SLAM, Served
from tests.server.running import START_S, wait_for

FREEZES = [(ROBOT, 3.0), (SLAM, 2.0), (SERVER, 4.0)]
WATCHED_S = 1.5


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    served = Served(tmp_path_factory.mktemp("served"))
    yield served
    assert served.close() == 0


@pytest.fixture(autouse=True)
def stopped(served: Served) -> Iterator[None]:
    yield
    served.driver.release() if served.driver.drive else None
    served.post("/estop/reset")
    served.post("/gait/stop")


def assert_stationary_until_a_new_press(served: Served, since_s: float) -> None:
    assert not served.moves_since(since_s, WATCHED_S), "it moves although the drive was not released"
    wait_for(lambda: (1.0, RELEASE_FIRST) in served.driver.answers, START_S)
    served.move_by_drive()


@pytest.mark.parametrize(("name", "seconds"), FREEZES, ids=[name for name, _ in FREEZES])
def test_a_held_drive_moves_nothing_after_a_freeze(served: Served, name: str, seconds: float) -> None:
    served.move_by_drive()
    with served.frozen(name):
        time.sleep(seconds)
        thawed_s = time.monotonic()
    assert_stationary_until_a_new_press(served, thawed_s)


@pytest.mark.parametrize(("name", "seconds"), FREEZES, ids=[name for name, _ in FREEZES])
def test_a_start_from_before_a_freeze_moves_nothing_after_it(served: Served, name: str, seconds: float) -> None:
    served.move_by_start()
    with served.frozen(name):
        time.sleep(seconds)
        thawed_s = time.monotonic()
    assert not served.moves_since(thawed_s, WATCHED_S)
    served.move_by_start()


@pytest.mark.parametrize("name", [ROBOT, SERVER])
def test_a_start_that_waits_for_the_end_of_a_freeze_moves_nothing(served: Served, name: str) -> None:
    served.move_by_start()
    answers: list[httpx.Response] = []
    waiting = threading.Thread(target=lambda: answers.append(served.post("/gait/start")))
    with served.frozen(name):
        time.sleep(1.0)
        waiting.start()
        time.sleep(1.5)
        thawed_s = time.monotonic()
    assert not served.moves_since(thawed_s, WATCHED_S)
    waiting.join()
    assert answers[0].status_code in (409, 503)


@pytest.mark.parametrize("name", [ROBOT, SLAM])
def test_a_held_drive_moves_nothing_after_a_node_was_killed_and_started_again(served: Served, name: str) -> None:
    served.move_by_drive()
    boot, pid = served.watcher.state.boot, served.pid(name)
    os.kill(pid, signal.SIGKILL)
    killed_s = time.monotonic()
    wait_for(lambda: served.pid(name) != pid, START_S)
    if name == ROBOT:
        wait_for(lambda: served.watcher.state.boot != boot, START_S)
    wait_for(lambda: served.client.get("/api/v1/state").json()["session"] == "running", START_S)
    assert not served.moves_since(killed_s + 1.0, WATCHED_S)
    wait_for(lambda: served.client.get("/api/v1/state").json()["health"]["verdict"] == "good", START_S)
    assert_stationary_until_a_new_press(served, time.monotonic())


def test_a_held_drive_moves_nothing_after_an_estop_and_its_reset(served: Served) -> None:
    served.move_by_drive()
    assert served.post("/estop").status_code == 200
    assert served.post("/estop/reset").status_code == 200
    assert_stationary_until_a_new_press(served, time.monotonic())


def test_a_held_drive_moves_nothing_after_a_stop(served: Served) -> None:
    served.move_by_drive()
    assert served.post("/gait/stop").status_code == 200
    assert_stationary_until_a_new_press(served, time.monotonic())


def test_a_robot_node_that_was_latched_is_latched_when_it_is_started_again(served: Served) -> None:
    served.move_by_drive()
    assert served.post("/estop").status_code == 200
    boot = served.watcher.state.boot
    os.kill(served.pid(ROBOT), signal.SIGKILL)
    wait_for(lambda: served.watcher.state.boot != boot, START_S)
    assert served.watcher.state.estop_reason is not None
    assert not served.moves_since(time.monotonic(), 0.5)
    wait_for(lambda: served.client.get("/api/v1/state").json()["session"] == "running", START_S)


def test_a_drive_that_is_held_down_on_a_new_socket_is_no_new_press(served: Served) -> None:
    """The connection is lost and comes back: the page must not go on where it was."""
    served.move_by_drive()
    driver, sockets = served.driver, served.driver.sockets
    driver.drop()
    wait_for(lambda: driver.sockets > sockets)
    assert_stationary_until_a_new_press(served, time.monotonic() + 0.5)
