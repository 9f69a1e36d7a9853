"""One operator at a time: how control is had, kept, lost and taken over."""

from collections.abc import Iterator

import httpx
import pytest

from server.lease import GONE_S, RENEWED_S, UNASKED_S, Desk
from server.problem import Problem
from tests.server.running import VIEWER_TOKEN, Running, wait_for

LEASE = "/api/v1/control/lease"


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_a_lease_is_kept_by_renewing_and_lapses_once() -> None:
    clock = Clock()
    desk = Desk(clock)
    lease = desk.grant("Ann")
    for _ in range(5):
        clock.now_s += 0.9 * RENEWED_S
        desk.renew(lease.key)
        assert desk.lapse() is None
    clock.now_s += RENEWED_S
    assert desk.lease is None
    assert desk.lapse() == lease
    assert desk.lapse() is None
    with pytest.raises(Problem, match="nobody has it"):
        desk.renew(lease.key)


def test_it_lapses_soon_when_a_pages_socket_has_closed_unless_it_comes_back() -> None:
    clock = Clock()
    desk = Desk(clock)
    lease = desk.grant("page")
    desk.hurry(lease.key)
    desk.renew(lease.key)
    clock.now_s += GONE_S
    assert desk.holds(lease.key)
    desk.hurry(lease.key)
    clock.now_s += GONE_S
    assert desk.lapse() == lease
    script = desk.grant("script", 60.0)
    desk.hurry(script.key)
    clock.now_s += GONE_S
    assert desk.holds(script.key)


def test_it_is_only_taken_over_by_an_explicit_act() -> None:
    holders: list[str | None] = []
    desk = Desk(Clock())
    desk.subscribe(lambda: holders.append(desk.lease.holder if desk.lease else None))
    ann = desk.grant("Ann")
    with pytest.raises(Problem, match="Ann has control"):
        desk.grant("Bob")
    bob = desk.grant("Bob", over=True)
    assert not desk.holds(ann.key)
    for act in (desk.renew, desk.release):
        with pytest.raises(Problem, match="Bob has it"):
            act(ann.key)
    desk.release(bob.key)
    assert holders == ["Ann", "Bob", None]


def test_a_script_without_a_lease_gets_a_free_one_and_no_other() -> None:
    clock = Clock()
    desk = Desk(clock)
    desk.need(None, "script-1")
    desk.need(None, "script-1")
    with pytest.raises(Problem, match="a script has control"):
        desk.need(None, "script-2")
    clock.now_s += UNASKED_S
    desk.need(None, "script-2")
    own = desk.grant("script 2", identity="script-2")
    desk.need(own.key, "script-2")
    with pytest.raises(Problem, match="script 2 has control"):
        desk.need(None, "script-2")


@pytest.mark.parametrize("key", ["", "wrong", "\u00e9"])
def test_a_wrong_key_opens_nothing_even_when_control_is_free(key: str) -> None:
    desk = Desk(Clock())
    with pytest.raises(Problem, match="you do not have control"):
        desk.need(key, "script-1")


@pytest.fixture
def ann(server: Running, client: httpx.Client) -> Iterator[httpx.Client]:
    """Another operator, who has control."""
    with server.client() as other:
        lease = other.post(LEASE, json={"name": "Ann", "seconds": 60}).raise_for_status().json()
        other.headers["Control-Lease"] = lease["key"]
        yield other


def test_everyone_sees_who_has_control(ann: httpx.Client, client: httpx.Client) -> None:
    found = client.get("/api/v1/state").json()["control"]
    assert found["holder"] == "Ann"
    assert client.get(LEASE).json()["id"] == found["id"]
    assert 0 < client.get(LEASE).json()["left_s"] <= 60
    assert "key" not in client.get(LEASE).text


@pytest.mark.parametrize(
    ("method", "path", "body"),
    [
        ("POST", "/api/v1/gait/start", None),
        ("POST", "/api/v1/gait/back-up", None),
        ("PUT", "/api/v1/gait", {"name": "pedal"}),
        ("PUT", "/api/v1/head", {"controller": "direction"}),
        ("POST", "/api/v1/estop/reset", None),
        ("POST", "/api/v1/sim/start", {}),
        ("POST", LEASE, {"name": "Bob"}),
        ("PUT", LEASE, None),
        ("DELETE", LEASE, None),
    ],
)
def test_without_control_nothing_moves(
    ann: httpx.Client, client: httpx.Client, method: str, path: str, body: object
) -> None:
    refused = client.request(method, path, json=body)
    assert refused.status_code == 409
    assert "Ann" in refused.json()["detail"]
    assert ann.get("/api/v1/state").json()["session"] == "running"


def test_stopping_needs_no_control(ann: httpx.Client, client: httpx.Client) -> None:
    assert ann.post("/api/v1/gait/start").json()["moving"] is True
    assert client.post("/api/v1/gait/stop").json()["moving"] is False
    assert client.post("/api/v1/estop").json()["estop"]["latched"] is True
    ann.post("/api/v1/estop/reset").raise_for_status()


def test_giving_control_back_stops_the_robot(ann: httpx.Client, client: httpx.Client) -> None:
    ann.post("/api/v1/gait/start").raise_for_status()
    assert ann.delete(LEASE).json() == {"id": None, "holder": None}
    assert client.get("/api/v1/state").json()["moving"] is False


def test_a_lease_that_lapses_stops_the_robot(server: Running, client: httpx.Client) -> None:
    lease = client.post(LEASE, json={"name": "Ann", "seconds": 1}).json()
    client.post("/api/v1/gait/start", headers={"Control-Lease": lease["key"]}).raise_for_status()
    assert client.get("/api/v1/state").json()["moving"] is True
    ended = wait_for(lambda: not (s := client.get("/api/v1/state").json())["moving"] and s)
    assert ended["control"]["holder"] is None
    refused = client.post("/api/v1/gait/start", headers={"Control-Lease": lease["key"]})
    assert refused.status_code == 409


def test_taking_over_leaves_the_robot_moving(ann: httpx.Client, client: httpx.Client) -> None:
    ann.post("/api/v1/gait/start").raise_for_status()
    lease = client.post(LEASE, json={"name": "Bob", "take_over": True}).json()
    assert client.get("/api/v1/state").json()["moving"] is True
    refused = ann.put("/api/v1/gait", json={"name": "pedal"})
    assert refused.status_code == 409
    assert "Bob" in refused.json()["detail"]
    client.delete(LEASE, headers={"Control-Lease": lease["key"]}).raise_for_status()


def test_a_viewer_watches_and_may_press_the_estop_but_nothing_else(server: Running, client: httpx.Client) -> None:
    assert client.get("/api/v1/session").json() == {"role": "operator"}
    with server.anonymous(headers={"Authorization": f"Bearer {VIEWER_TOKEN}"}) as viewer:
        assert viewer.get("/api/v1/session").json() == {"role": "viewer"}
        assert viewer.get("/api/v1/state").status_code == 200
        for method, path in (("POST", "/gait/start"), ("POST", "/gait/stop"), ("POST", "/runs"), ("POST", "/sim/start"),
                             ("POST", "/control/lease"), ("POST", "/estop/reset"), ("PUT", "/gait")):  # fmt: skip
            refused = viewer.request(method, f"/api/v1{path}")
            assert (refused.status_code, "watch" in refused.json()["detail"]) == (403, True), path
        assert viewer.post("/api/v1/estop").json()["estop"]["latched"] is True
    client.post("/api/v1/estop/reset").raise_for_status()


def test_a_viewers_session_stays_a_viewers_until_it_signs_out(server: Running) -> None:
    with server.anonymous() as browser:
        assert browser.post("/api/v1/session", json={"token": VIEWER_TOKEN}).status_code == 204
        assert browser.get("/api/v1/session").json() == {"role": "viewer"}
        assert browser.post("/api/v1/gait/start").status_code == 403
        cookie = "; ".join(f"{name}={value}" for name, value in browser.cookies.items())
        assert browser.delete("/api/v1/session").status_code == 204
    with server.anonymous(headers={"Cookie": cookie}) as again:
        assert again.get("/api/v1/state").status_code == 401
