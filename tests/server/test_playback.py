"""A recording in the live view, over HTTP: pause, seek, step, speed, and what is left of the source before."""

import json
import shutil
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from websockets.sync.client import connect

from tests.server.running import START_S, TOKEN, Running, start, wait_for
from tests.small_recordings import write_robot

SECONDS = 6.0


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    folder = tmp_path_factory.mktemp("playback")
    write_robot(folder / "recordings" / "stationary", SECONDS)
    running = start(folder, recordings=str(folder / "recordings"))
    yield running
    assert running.stop() == 0


@pytest.fixture
def client(server: Running) -> Iterator[httpx.Client]:
    with server.client() as client:
        yield client


def state(client: httpx.Client) -> dict[str, Any]:
    return client.get("/api/v1/state").json()


def position_s(client: httpx.Client) -> float:
    return client.get("/api/v1/playback").raise_for_status().json()["position_s"]


def listed(client: httpx.Client) -> dict[str, dict[str, Any]]:
    """The recordings by name; the list is made anew every 2 s at most."""
    return {one["name"]: one for one in client.get("/api/v1/recordings").json()}


def origin(recording: dict[str, Any]) -> list[Any]:
    return [recording.get(key) for key in ("gait", "world", "seed", "when")]


def put(client: httpx.Client, **request: object) -> dict[str, Any]:
    return client.put("/api/v1/playback", json=request).raise_for_status().json()


@pytest.fixture
def playing(client: httpx.Client) -> httpx.Client:
    """The recording, paused at its beginning."""
    recording = listed(client)["stationary"]
    client.post(f"/api/v1/recordings/{recording['id']}/play").raise_for_status()
    wait_for(lambda: state(client)["session"] == "running" and state(client)["playback"], START_S)
    put(client, paused=True, position_s=0.0, speed=1.0)
    wait_for(lambda: position_s(client) == 0.0)
    return client


def test_it_pauses_and_goes_on(playing: httpx.Client) -> None:
    assert put(playing, paused=True)["paused"]
    before = position_s(playing)
    assert [position_s(playing) for _ in range(20)] == [before] * 20
    put(playing, paused=False)
    wait_for(lambda: position_s(playing) > before)


def test_it_seeks_ahead_and_back_and_steps_by_frames(playing: httpx.Client) -> None:
    put(playing, position_s=3.0)
    wait_for(lambda: position_s(playing) == 3.0)
    put(playing, position_s=1.0)
    found = wait_for(lambda: position_s(playing) == 1.0 and state(playing))
    assert found["playback"]["computed_s"] == 3.0
    assert found["playback"]["duration_s"] == pytest.approx(SECONDS - 0.05, abs=0.051)
    put(playing, step=1)
    wait_for(lambda: position_s(playing) == 1.05)
    put(playing, step=-2)
    wait_for(lambda: position_s(playing) == 0.95)


def test_the_path_is_not_drawn_twice(playing: httpx.Client) -> None:
    for goal_s in (2.0, 0.5, 2.5, 1.0):
        put(playing, position_s=goal_s)
        wait_for(lambda goal_s=goal_s: position_s(playing) == goal_s)
    times = [row[0] for row in playing.get("/api/v1/trajectory").json()["estimate"]]
    assert times == sorted(set(times))


def test_after_the_end_it_can_be_played_again(playing: httpx.Client) -> None:
    put(playing, paused=False, position_s=SECONDS)
    wait_for(lambda: state(playing)["session"] == "ended")
    put(playing, paused=True, position_s=2.0)
    found = wait_for(lambda: position_s(playing) == 2.0 and state(playing))
    assert found["session"] == "running"


def test_bad_requests_are_answered_and_change_nothing(playing: httpx.Client) -> None:
    before = playing.get("/api/v1/playback").json()
    for request in ({"speed": 0}, {"speed": 1e9}, {"position_s": -1}, {"step": 0.5}, {"paused": "yes"}, {"rewind": 1}):
        answer = playing.put("/api/v1/playback", json=request)
        assert answer.status_code == 422, request
        assert next(iter(request)) in answer.json()["detail"]
    assert playing.get("/api/v1/playback").json() == before


def test_who_only_watches_cannot_control_it(playing: httpx.Client, server: Running) -> None:
    with server.anonymous(headers={"Authorization": "Bearer a-token-to-watch-with"}) as watcher:
        assert watcher.put("/api/v1/playback", json={"paused": False}).status_code == 403
        assert watcher.get("/api/v1/playback").status_code == 200


def test_a_recording_of_a_run_says_what_the_run_was(client: httpx.Client, server: Running) -> None:
    """Gait, world, seed and when; broken facts hide neither it nor the others."""
    folder = server.folder / "recordings" / "survey"
    write_robot(folder / "sensors", 0.3)
    facts: dict[str, Any] = {
        "config": {"gait": {"name": "pedal"}, "sim": {"world": "office"}},
        "seed": 4,
        "metrics": {},
    }
    facts["written"] = "2026-11-28T09:00:00Z"
    try:
        for text, expected in (
            (json.dumps(facts), ["pedal", "office", 4, "2026-11-28T09:00:00Z"]),
            ("\x00" * 100, [None] * 4),
            (json.dumps({**facts, "seed": 5}), ["pedal", "office", 5, "2026-11-28T09:00:00Z"]),
            (json.dumps({**facts, "seed": "four"}), [None] * 4),
        ):
            (folder / "run.json").write_text(text)
            # Each file's facts differ from those of the file before.
            wait_for(lambda e=expected: origin(listed(client).get("survey", {})) == e)
            assert listed(client)["stationary"]["gait"] is None
    finally:
        shutil.rmtree(folder)


def test_another_source_begins_with_nothing_of_the_one_before(playing: httpx.Client, server: Running) -> None:
    put(playing, position_s=3.0)
    wait_for(lambda: playing.get("/api/v1/map").json()["points"] > 0)
    number = state(playing)["session_number"]
    headers = {"Authorization": f"Bearer {TOKEN}"}
    with connect(
        f"{server.websocket}/api/v1/telemetry", close_timeout=0.5, additional_headers=headers, max_size=None
    ) as socket:
        playing.post("/api/v1/sim/start", timeout=START_S).raise_for_status()
        assert playing.get("/api/v1/map").json()["points"] == 0 or state(playing)["session"] == "running"
        while True:
            message = socket.recv(START_S)
            said = json.loads(message) if isinstance(message, str) else {"type": "image"}
            if said["type"] == "state" and said["session_number"] > number:
                break
        # No image and no tick of the recording follows: those of the simulator carry no playback.
        while not isinstance(message, str) or (said := json.loads(message))["type"] != "tick":
            message = socket.recv(START_S)
        assert said["playback"] is None
    assert playing.put("/api/v1/playback", json={"paused": True}).status_code == 409
