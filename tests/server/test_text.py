"""Whatever text a request holds: one clear line, and nobody else notices."""

import json

import httpx
import pytest

from tests.server.running import Running

ODD = ["\ud800", "\udfff x", "a\nb", "\x00", "\x1b[31m", "\x7f", "\x85", "\u2028", "x" * 20_000, "\x00" * 500]
FIELDS = [
    ("POST", "/control/lease", "name"),
    ("POST", "/runs", "config"),
    ("POST", "/session", "token"),
    ("POST", "/recordings/abc/play", "mode"),
    ("PUT", "/gait", "name"),
    ("PUT", "/head", "controller"),
]


def send(client: httpx.Client, method: str, path: str, body: object) -> httpx.Response:
    """Send JSON whose escapes may stand for anything."""
    text = json.dumps(body).encode()
    return client.request(method, f"/api/v1{path}", content=text, headers={"Content-Type": "application/json"})


def refused(answer: httpx.Response) -> None:
    assert answer.status_code in (401, 422)
    assert answer.headers["content-type"] == "application/problem+json"
    detail = answer.json()["detail"]
    assert detail.isprintable()
    assert len(detail) <= 1000


@pytest.mark.parametrize("text", ODD, ids=repr)
def test_odd_text_is_refused_in_one_line(client: httpx.Client, text: str) -> None:
    for method, path, name in FIELDS:
        refused(send(client, method, path, {name: text}))
        refused(send(client, method, path, {text: 1}))
    for path in ("/runs", "/sim/start"):
        refused(send(client, "POST", path, {"overrides": {text: 1}}))
        refused(send(client, "POST", path, {"overrides": {"sim.world": text}}))
    assert client.get("/api/v1/state").status_code == 200
    assert client.get("/api/v1/runs").json() == []


@pytest.mark.parametrize("text", ["", *ODD], ids=repr)
def test_an_emergency_stop_is_never_refused_for_its_words(client: httpx.Client, text: str) -> None:
    answer = send(client, "POST", "/estop", {"reason": text})
    assert answer.status_code == 200
    assert client.get("/api/v1/state").json()["estop"]["latched"]
    reason = client.get("/api/v1/state").json()["estop"]["reason"]
    assert reason.isprintable()
    assert 0 < len(reason) <= 200


@pytest.mark.parametrize(
    ("method", "path", "body"),
    [
        ("POST", "/control/lease", {"take_over": "true"}),
        ("POST", "/control/lease", {"take_over": 1}),
        ("POST", "/control/lease", {"seconds": "10"}),
        ("POST", "/control/lease", {"seconds": True}),
        ("POST", "/runs", {"seed": 1.5}),
        ("POST", "/runs", {"seed": "1"}),
        ("POST", "/runs", {"seed": True}),
        ("POST", "/runs", {"duration_s": "1"}),
        ("POST", "/runs", {"overrides": {"run.seed": 3}}),
        ("POST", "/runs", {"overrides": {"gait.period_s": "4"}}),
        ("POST", "/runs", {"overrides": {"gait.period_s": True}}),
        ("PUT", "/gait", {"name": "pedal", "turn": "0"}),
        ("PUT", "/head", {"neck_joints": 4.5}),
        ("PUT", "/head", {"neck_joints": "4"}),
        ("PUT", "/head", {"turn_by_deg": True}),
        ("POST", "/session", {"token": 1}),
    ],
)
def test_a_value_of_another_type_is_refused_never_converted(
    client: httpx.Client, method: str, path: str, body: object
) -> None:
    refused(send(client, method, path, body))


@pytest.mark.parametrize(
    "data", [b"[" * 50_000, b'{"a":' * 10_000, b"\xff\xfe{}", b"{", b'"x"', b'{"name": "a", "name": NaN}', b"\x00"]
)
def test_a_body_that_is_no_json_is_one_line(server: Running, data: bytes) -> None:
    with server.client(headers={"Content-Type": "application/json"}) as client:
        for method, path in (("POST", "/control/lease"), ("POST", "/runs"), ("PUT", "/gait"), ("PUT", "/head")):
            answer = client.request(method, f"/api/v1{path}", content=data)
            assert answer.status_code in (400, 422)
            assert answer.headers["content-type"] == "application/problem+json"
            assert answer.json()["detail"].isprintable()
