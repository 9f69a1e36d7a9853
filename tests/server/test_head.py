"""Holding the head still over the API, with a real session behind it."""

import json

import httpx
import pytest
from websockets.sync.client import connect

from tests.server.running import TOKEN, Running, wait_for

HEAD = "/api/v1/head"
STILLNESS = {
    "yaw_deg",
    "yaw_rms_deg",
    "yaw_rate_deg_s",
    "peak_yaw_rate_deg_s",
    "sway_m",
    "heading_deg",
    "window_s",
}


def state(client: httpx.Client) -> dict:
    return client.get("/api/v1/state").json()


def next_available(found: dict) -> str:
    """The controller after the one in force that can be had; the same where it is the only one."""
    names = [entry["name"] for entry in found["controllers"] if entry["available"]]
    return names[(names.index(found["current"]["controller"]) + 1) % len(names)]


def test_what_there_is_and_what_is_in_force(client: httpx.Client) -> None:
    found = client.get(HEAD).json()
    assert found["current"] == state(client)["head_control"] == {"controller": "predictive", "neck_joints": 4}
    assert [entry["name"] for entry in found["controllers"]] == ["none", "direction", "position", "predictive"]
    for entry in found["controllers"]:
        assert entry["title"]
        assert entry["summary"]
        assert entry["available"] == (entry["reason"] is None)
    assert [entry["name"] for entry in found["controllers"] if entry["steers"]] == ["predictive"]
    assert found["neck_joints"] == {"min": 2, "max": 7, "default": 4}
    assert found["turn_by_deg"] == {"min": -180, "max": 180}


def test_the_head_of_a_stationary_robot_does_not_move(client: httpx.Client) -> None:
    still = wait_for(lambda: (s := client.get(HEAD).json()["stillness"])["sway_m"] is not None and s)
    assert set(still) == STILLNESS
    assert still["window_s"] == 4.0
    assert abs(still["yaw_deg"]) < 1.0
    assert still["yaw_rms_deg"] < 1.0
    assert still["peak_yaw_rate_deg_s"] < 5.0
    assert still["sway_m"] < 0.02


def test_the_head_is_set_while_moving(client: httpx.Client) -> None:
    client.post("/api/v1/gait/start").raise_for_status()
    chosen = next_available(client.get(HEAD).json())
    answer = client.put(HEAD, json={"controller": chosen, "neck_joints": 5})
    assert answer.status_code == 200
    assert answer.json()["head_control"] == {"controller": chosen, "neck_joints": 5}
    assert answer.json()["moving"] is True
    assert client.put(HEAD, json={"neck_joints": 6}).json()["head_control"] == {
        "controller": chosen,
        "neck_joints": 6,
    }
    assert client.get(HEAD).json()["current"] == {"controller": chosen, "neck_joints": 6}
    assert client.put(HEAD, json={"controller": "none"}).json()["head_control"]["controller"] == "none"


def test_setting_the_head_moves_nothing(client: httpx.Client) -> None:
    assert client.put(HEAD, json={}).json()["moving"] is False
    assert client.put(HEAD, json={"controller": "none", "neck_joints": 6}).json()["moving"] is False


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"controller": "steady"}, "controller"),
        ({"controller": 1}, "controller"),
        ({"neck_joints": 1}, "neck_joints"),
        ({"neck_joints": 11}, "neck_joints"),
        ({"neck_joints": 5.5}, "neck_joints"),
        ({"neck_joints": "many"}, "neck_joints"),
        ({"controller": "none", "turn_by_deg": 15}, "turn_by_deg"),
        ({"turn_by_deg": 181}, "turn_by_deg"),
        ({"pitch": 1}, "pitch: unknown key"),
        ([], "body"),
    ],
)
def test_a_wrong_request_gets_one_clear_line(client: httpx.Client, body: object, words: str) -> None:
    before = state(client)["head_control"]
    answer = client.put(HEAD, json=body)
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"
    assert words in answer.json()["detail"]
    assert "\n" not in answer.json()["detail"]
    assert state(client)["head_control"] == before


def test_what_is_not_available_is_refused_with_its_reason(client: httpx.Client) -> None:
    for entry in client.get(HEAD).json()["controllers"]:
        answer = client.put(HEAD, json={"controller": entry["name"]})
        assert answer.status_code == (200 if entry["available"] else 422), entry
        if not entry["available"]:
            assert entry["reason"].split(" (")[0] in answer.json()["detail"]
    client.put(HEAD, json={"controller": "none"}).raise_for_status()


def test_not_a_number_is_a_problem_too(client: httpx.Client) -> None:
    answer = client.put(HEAD, content='{"turn_by_deg": NaN}', headers={"Content-Type": "application/json"})
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"


def test_a_stranger_may_not(server: Running) -> None:
    with server.anonymous() as stranger:
        assert stranger.get(HEAD).status_code == 401
        assert stranger.put(HEAD, json={"controller": "none"}).status_code == 401


def test_the_telemetry_carries_the_same(server: Running, client: httpx.Client) -> None:
    client.put(HEAD, json={"controller": "predictive", "neck_joints": 4}).raise_for_status()
    headers = {"Authorization": f"Bearer {TOKEN}"}
    with connect(f"{server.websocket}/api/v1/telemetry", close_timeout=0.5, additional_headers=headers) as stream:
        first = json.loads(stream.recv(timeout=30))
        tick = {"type": None}
        while tick["type"] != "tick":
            raw = stream.recv(timeout=30)
            tick = json.loads(raw) if isinstance(raw, str) else tick
    assert first["head_control"] == tick["head_control"] == {"controller": "predictive", "neck_joints": 4}
    assert set(first["head"]) == set(tick["head"]) == STILLNESS
    assert first["notice"] is None
    client.put(HEAD, json={"neck_joints": 6}).raise_for_status()


def test_a_gait_that_barely_advances_has_a_notice(client: httpx.Client) -> None:
    gait = {"name": "serpentine", "alpha_pi": 0.7, "wavelength_joints": 20, "period_s": 8}
    notice = client.put("/api/v1/gait", json=gait).json()["notice"]
    assert "11 %" in notice
    wait_for(lambda: client.get(HEAD).json()["stillness"]["window_s"] == 8.0)
    assert client.put("/api/v1/gait", json={"name": "serpentine"}).json()["notice"] is None
