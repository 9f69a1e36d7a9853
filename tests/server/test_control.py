"""What the operator does over the API, with a real session behind it."""

import httpx
import pytest

from snakeslam.gaits.catalogue import GAITS
from tests.server.running import wait_for


def state(client: httpx.Client) -> dict:
    return client.get("/api/v1/state").json()


def test_state_says_what_the_contract_promises(client: httpx.Client) -> None:
    found = state(client)
    keys = (
        "source t_s moving estop control gait notice held_because head_control head robot estimator health "
        "realtime_factor session session_number message playback back_up_offered"
    )
    assert set(found) == set(keys.split())
    assert found["source"] == {"kind": "sim", "name": "simulator"}
    assert found["robot"] == {"model": "orthogonal24", "joints": 24}
    assert found["session"] == "running"
    assert found["moving"] is False
    later = wait_for(lambda: (now := state(client))["t_s"] > found["t_s"] + 0.2 and now)
    assert later["realtime_factor"] is None or 0.0 < later["realtime_factor"] < 1.2


def test_start_and_stop(client: httpx.Client) -> None:
    assert client.post("/api/v1/gait/start").json()["moving"] is True
    assert state(client)["gait"]["drive"] == 1.0
    assert client.post("/api/v1/gait/stop").json()["moving"] is False


@pytest.mark.parametrize("name", list(GAITS))
def test_the_server_gives_the_drawing_of_a_gait(client: httpx.Client, name: str) -> None:
    found = client.get("/api/v1/gait/preview", params={"name": name, "period_s": 5.0}).json()
    assert found["reason"] is None
    joints = client.get("/api/v1/state").json()["robot"]["joints"]
    points, backs = found["drawing"]["points"], found["drawing"]["backs"]
    assert len(points) == len(backs) > 10
    assert {len(row) for row in points} == {3 * (joints + 2)}
    assert {len(row) for row in backs} == {joints + 1}


def test_a_preview_says_what_the_robot_cannot_do_and_commands_nothing(client: httpx.Client) -> None:
    before = client.get("/api/v1/state").json()["gait"]
    fast = client.get("/api/v1/gait/preview", params={"name": "serpentine", "alpha_pi": 0.3, "period_s": 0.5})
    assert fast.status_code == 200
    assert fast.json()["drawing"] is None
    assert "too fast" in fast.json()["reason"]
    good = client.get("/api/v1/gait/preview", params={"name": "serpentine", "alpha_pi": 0.3}).json()
    assert "% of the wave" in good["remark"]
    for params in ({"name": "flying"}, {"alpha_pi": 9}, {"alpha": 1}):
        refused = client.get("/api/v1/gait/preview", params=params)
        assert (refused.status_code, refused.headers["content-type"]) == (422, "application/problem+json")
    assert client.get("/api/v1/state").json()["gait"] == before


def test_the_catalogue_has_all_gaits_with_ranges(client: httpx.Client) -> None:
    catalogue = client.get("/api/v1/gait").json()["catalogue"]
    assert [g["name"] for g in catalogue] == list(GAITS)
    for gait in catalogue:
        for parameter in gait["parameters"]:
            assert parameter["min"] <= parameter["default"] <= parameter["max"]


def test_a_gait_is_set_without_moving(client: httpx.Client) -> None:
    answer = client.put("/api/v1/gait", json={"name": "sidewinding", "period_s": 5.0, "turn": 0.5})
    assert answer.status_code == 200
    gait = answer.json()["gait"]
    assert (gait["name"], gait["period_s"], gait["turn"], gait["drive"]) == ("sidewinding", 5.0, 0.5, 0.0)
    assert answer.json()["moving"] is False
    kept = client.put("/api/v1/gait", json={"name": "serpentine"}).json()["gait"]
    assert (kept["period_s"], kept["turn"]) == (None, 0.5)
    client.put("/api/v1/gait", json={"name": "serpentine", "turn": 0})


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"name": "serpentine", "period_s": -1}, "period_s"),
        ({"name": "serpentine", "period_s": "soon"}, "period_s"),
        ({"name": "flying"}, "name"),
        ({"name": "serpentine", "speed": 1}, "speed: unknown key"),
        ({"period_s": 4}, "name"),
        ({"name": "serpentine", "turn": 2}, "turn"),
        ({"name": "arc_rolling", "amplitude_deg": 80, "period_s": 0.5}, "period_s"),
        ([], "body"),
    ],
)
def test_a_wrong_gait_gets_one_clear_line(client: httpx.Client, body: object, words: str) -> None:
    before = state(client)["gait"]
    answer = client.put("/api/v1/gait", json=body)
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"
    assert words in answer.json()["detail"]
    assert "\n" not in answer.json()["detail"]
    assert state(client)["gait"] == before


@pytest.mark.parametrize("text", ["{", "", '{"name": "serpentine", "period_s": NaN}', "\x00"])
def test_broken_json_is_a_problem_too(client: httpx.Client, text: str) -> None:
    answer = client.put("/api/v1/gait", content=text, headers={"Content-Type": "application/json"})
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"


def test_the_estop_latches_and_its_reset_moves_nothing(client: httpx.Client) -> None:
    client.post("/api/v1/gait/start")
    stopped = client.post("/api/v1/estop", json={"reason": "somebody is near"}).json()
    assert stopped["estop"] == {"latched": True, "reason": "somebody is near"}
    assert stopped["moving"] is False
    refused = client.post("/api/v1/gait/start")
    assert refused.status_code == 409
    assert "E-stop" in refused.json()["detail"]
    again = client.post("/api/v1/estop").json()
    assert again["estop"]["reason"] == "somebody is near"
    cleared = client.post("/api/v1/estop/reset").json()
    assert cleared["estop"] == {"latched": False, "reason": None}
    assert cleared["moving"] is False
    assert client.post("/api/v1/gait/start").json()["moving"] is True


def test_a_latched_estop_outlives_a_new_session(client: httpx.Client) -> None:
    client.post("/api/v1/estop", json={"reason": "stay"})
    assert client.post("/api/v1/sim/start").json()["estop"]["latched"] is True
    wait_for(lambda: state(client)["session"] == "running", 60.0)
    assert state(client)["estop"] == {"latched": True, "reason": "stay"}
    assert client.post("/api/v1/gait/start").status_code == 409


def test_unknown_settings_do_not_end_the_session(client: httpx.Client) -> None:
    for overrides in ({"gait.speed": 1}, {"replay.calibration": "/etc/passwd"}, {"replay": 1}, {"a/../b": 1}):
        answer = client.post("/api/v1/sim/start", json={"overrides": overrides})
        assert answer.status_code == 422, overrides
        assert next(iter(overrides)) in answer.json()["detail"]
    assert state(client)["session"] == "running"


def test_map_and_trajectory_grow(client: httpx.Client) -> None:
    found = wait_for(lambda: (size := client.get("/api/v1/map").json())["points"] > 0 and size)
    assert found["chunks"] >= 1
    assert client.get("/api/v1/map.ply").content.startswith(b"ply")
    paths = wait_for(lambda: len((rows := client.get("/api/v1/trajectory").json())["estimate"]) > 3 and rows)
    assert all(len(row) == 4 for row in paths["estimate"])
    # The robot is stationary, and the truth was brought to the estimate.
    assert max(abs(value) for row in paths["truth"] for value in row[1:]) < 0.05


def test_clearance_says_what_is_free_and_where_a_patrol_steers(client: httpx.Client) -> None:
    """The fake robot sees a flat wall 1 m away, nearer than a patrol goes straight towards."""
    path = "/api/v1/map/clearance"
    wait_for(lambda: client.get("/api/v1/map").json()["points"] > 0)
    found = wait_for(lambda: (answer := client.get(path).json())["free_m"] and answer)
    ahead = found["free_m"][found["directions_deg"].index(0)]
    assert ahead == pytest.approx(1.0, abs=0.2)
    assert found["turn"] in (-1, 1)
    assert client.get(path, params={"turning": -found["turn"]}).json()["turn"] == -found["turn"], "it keeps to its side"
    assert client.get(path, params={"turning": 2}).status_code == 422


def test_what_is_not_there_is_a_problem(client: httpx.Client) -> None:
    for path in ("/api/v1/nothing", "/api/nothing", "/api/v1/runs/ffff", "/api/v1/recordings/0/play"):
        answer = client.post(path) if path.endswith("play") else client.get(path)
        assert answer.status_code == 404, path
        assert answer.headers["content-type"] == "application/problem+json"
    assert client.delete("/api/v1/state").status_code == 405


def test_docs_and_metrics(client: httpx.Client) -> None:
    docs = client.get("/api/docs").text
    schema = client.get("/api/openapi.json").json()
    for path in ("/api/v1/gait", "/api/v1/estop", "/api/v1/runs/{run_id}"):
        assert path in schema["paths"]
        assert path in docs
    assert "http://" not in docs
    assert "https://" not in docs


def test_metrics_cover_session_link_estimator_and_control(client: httpx.Client) -> None:
    client.post("/api/v1/gait/start").raise_for_status()
    wait_for(lambda: "snakeslam_moving 1.0" in client.get("/metrics").text)
    client.get("/api/v1/runs/ffff")
    metrics = client.get("/metrics").text
    for line in (
        'snakeslam_session{phase="running"} 1.0',
        'snakeslam_verdict{verdict="lost"} 0.0',
        "snakeslam_drive 1.0",
        "snakeslam_lease_held 1.0",
        "snakeslam_estop_latched 0.0",
        'snakeslam_http_requests_total{method="GET",path="/api/v1/runs/{run_id}",status="404"}',
        "snakeslam_realtime_factor",
        "snakeslam_tracks",
        "process_resident_memory_bytes",
    ):
        assert f"\n{line}" in metrics, line
