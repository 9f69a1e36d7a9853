"""The emergency stop has a path of its own: what others read, and how often they press, does not hold it up."""

import asyncio
import json
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import numpy as np
import pytest

from server.bulk import MOST_EACH, Bulk, Made
from server.timed_path import MAX_PATH, TimedPath
from tests.server.running import START_S, VIEWER_TOKEN, Running, children, is_ready, start, wait_for

LINES, FOLDERS, PLAYS = 40_000, 4, 12
PRESSERS, PRESSES = 20, 10


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    """A server with recordings that take seconds to list."""
    folder = tmp_path_factory.mktemp("recordings")
    rows = "".join(f"{k * 0.03:.6f} {{}}/{k}.png\n" for k in range(LINES))
    for number in range(FOLDERS):
        recording = folder / f"long {number}"
        recording.mkdir()
        for name in ("rgb", "depth"):
            (recording / name).mkdir()
            (recording / f"{name}.txt").write_text(rows.format(*[name] * LINES))
    running = start(tmp_path_factory.mktemp("server"), recordings=str(folder))
    with running.client() as client:
        wait_for(lambda: is_ready(client), START_S)
    yield running
    assert running.stop() == 0


@pytest.fixture
def client(server: Running) -> Iterator[httpx.Client]:
    with server.client() as client:
        client.post("/api/v1/estop/reset")
        wait_for(lambda: not client.get("/api/v1/state").json()["estop"]["latched"])
        yield client


def test_an_estop_does_not_wait_for_those_who_list_recordings(server: Running, client: httpx.Client) -> None:
    """It used the same few threads, and waited for one of them to be free until it was given up."""
    looking = threading.Barrier(PLAYS + 1)

    def play() -> int:
        with server.client() as other:
            looking.wait()
            return other.post("/api/v1/recordings/nothing/play").status_code

    with ThreadPoolExecutor(PLAYS) as crowd:
        plays = [crowd.submit(play) for _ in range(PLAYS)]
        looking.wait()
        answer = client.post("/api/v1/estop")
        scanning = [not waiting.done() for waiting in plays]
        assert (answer.status_code, answer.json()["estop"]["latched"]) == (200, True)
        assert any(scanning), "the recordings were looked through at once: the test needs larger ones"
        assert {waiting.result() for waiting in plays} == {404}


def test_twenty_viewers_who_press_again_and_again_are_all_answered(server: Running, client: httpx.Client) -> None:
    """Before, some got 503, and the robot node ended."""

    def press() -> set[tuple[int, bool, bool]]:
        headers = {"Authorization": f"Bearer {VIEWER_TOKEN}"}
        with server.anonymous(headers=headers) as viewer:
            answers = [viewer.post("/api/v1/estop") for _ in range(PRESSES)]
        return {(a.status_code, a.json()["estop"]["latched"], a.json()["confirmed"]) for a in answers}

    before = children(server.process.pid)
    with ThreadPoolExecutor(PRESSERS) as crowd:
        pressing = [crowd.submit(press) for _ in range(PRESSERS)]
        assert client.post("/api/v1/estop").status_code == 200
        assert set().union(*(pressed.result() for pressed in pressing)) == {(200, True, True)}
    assert children(server.process.pid) == before, "a node was started again"


def test_a_robot_that_does_not_answer_is_said_to_have_been_sent_the_stop(server: Running, client: httpx.Client) -> None:
    nodes = {Path(f"/proc/{pid}/comm").read_text().strip(): pid for pid in children(server.process.pid)}
    robot = nodes["snakeslam:robot"]
    os.kill(robot, signal.SIGSTOP)
    try:
        answer = client.post("/api/v1/estop", json={"reason": "frozen"})
        assert (answer.status_code, answer.json()["confirmed"]) == (202, False)
        assert answer.json()["estop"] == {"latched": True, "reason": "frozen"}
    finally:
        os.kill(robot, signal.SIGCONT)
    wait_for(lambda: client.post("/api/v1/estop").json()["confirmed"])
    assert client.post("/api/v1/gait/start").status_code == 409


def test_the_map_file_and_the_trajectory_are_whole(client: httpx.Client) -> None:
    points = client.get("/api/v1/map").json()["points"]
    header, _, body = client.get("/api/v1/map.ply").content.partition(b"end_header\n")
    assert header.startswith(b"ply\n")
    assert len(body) >= 15 * points
    assert set(client.get("/api/v1/trajectory").json()) == {"estimate", "truth"}


def test_a_path_is_written_as_it_comes() -> None:
    path, T = TimedPath(), np.eye(4)
    for k in range(MAX_PATH + 10):
        T[0, 3] = k
        path.add(k * 0.05, T)
    assert json.loads(f"[{path.text()}]") == [list(row) for row in path.rows]


def test_all_who_ask_while_it_is_made_get_the_same_and_it_is_made_anew_only_when_outdated() -> None:
    made: list[int] = []
    version = 0

    async def ask() -> list[int]:
        bulk = Bulk()
        value = Made(bulk, lambda: made.append(1) or len(made), lambda: version, 0.0)
        answers = await asyncio.gather(*(value.get() for _ in range(5)))
        nonlocal_version()
        answers += [await value.get(), await value.get()]
        bulk.close()
        return answers

    def nonlocal_version() -> None:
        nonlocal version
        version += 1

    assert asyncio.run(ask()) == [1, 1, 1, 1, 1, 2, 2]


def test_one_credential_has_few_large_answers_at_a_time() -> None:
    from server.auth import Caller

    bulk, who = Bulk(), Caller("viewer", "a", None)
    with bulk.sending(who), bulk.sending(who):
        assert MOST_EACH == 2
        assert not bulk.free(who)
        assert bulk.free(Caller("viewer", "b", None))
    assert bulk.free(who)
    bulk.close()
