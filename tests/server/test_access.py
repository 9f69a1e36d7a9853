"""Nobody gets in who should not, by any of the ways in."""

import re

import httpx
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from tests.server.running import TOKEN, Running

PROTECTED = [
    "/api/v1/state",
    "/api/v1/gait",
    "/api/v1/map.ply",
    "/api/docs",
    "/api/openapi.json",
    "/metrics",
    "/viewer/",
]


def status_of(url: str, **options: object) -> int:
    """Status of a refused websocket handshake, 101 when it is taken."""
    try:
        with connect(url, compression=None, **options):  # type: ignore[arg-type]
            return 101
    except InvalidStatus as refusal:
        return refusal.response.status_code


@pytest.mark.parametrize("path", PROTECTED)
def test_without_a_token_there_is_nothing_to_see(server: Running, path: str) -> None:
    with server.anonymous() as anonymous:
        answer = anonymous.get(path)
    assert answer.status_code == 401
    assert answer.headers["content-type"] == "application/problem+json"
    assert set(answer.json()) == {"type", "title", "status", "detail"}
    assert "\n" not in answer.json()["detail"]


@pytest.mark.parametrize("header", ["Bearer wrong", f"Basic {TOKEN}", TOKEN, "Bearer", "Bearer \u00e9"])
def test_a_wrong_token_is_no_token(server: Running, header: str) -> None:
    with server.anonymous() as anonymous:
        answer = anonymous.get("/api/v1/state", headers={"Authorization": header.encode()})
    assert answer.status_code == 401


def test_the_page_and_its_files_are_open_but_hold_no_data(server: Running) -> None:
    with server.anonymous() as anonymous:
        page = anonymous.get("/")
    assert page.status_code == 200
    assert "default-src 'self'" in page.headers["content-security-policy"]
    assert page.headers["x-content-type-options"] == "nosniff"


def test_websockets_need_a_token_too(server: Running) -> None:
    bearer = {"Authorization": f"Bearer {TOKEN}"}
    for path in ("/api/v1/telemetry", "/viewer"):
        assert status_of(server.websocket + path) == 401
    assert status_of(f"{server.websocket}/api/v1/telemetry", additional_headers=bearer) == 101


def test_pages_of_other_origins_are_refused(server: Running) -> None:
    bearer = {"Authorization": f"Bearer {TOKEN}"}
    telemetry = f"{server.websocket}/api/v1/telemetry"
    own = server.url
    for origin in ("http://evil.example", "null", "http://127.0.0.1:1", own.replace("127.0.0.1", "localhost")):
        assert status_of(telemetry, additional_headers=bearer, origin=origin) == 403
        with server.client(headers={"Origin": origin}) as client:
            assert client.post("/api/v1/estop/reset").status_code == 403
    assert status_of(telemetry, additional_headers=bearer, origin=own) == 101


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example:80", "192.168.0.7", "", "[::1"])
def test_foreign_host_names_are_refused(server: Running, host: str) -> None:
    """A name that somebody points at this address (DNS rebinding) does not get an answer, token or not."""
    with server.client(headers={"Host": host}) as client:
        for path in ("/", "/api/v1/state"):
            assert client.get(path).status_code in (400, 421)


def test_localhost_by_name_is_ours(server: Running) -> None:
    port = server.url.rsplit(":", 1)[1]
    with server.client(headers={"Host": f"localhost:{port}"}) as client:
        assert client.get("/api/v1/state").status_code == 200


def test_a_one_time_url_opens_one_session(server: Running) -> None:
    url = re.search(r"http://\S+/login\S+", "".join(server.out))
    assert url is not None
    with httpx.Client() as browser:
        answer = browser.get(url.group())
        assert (answer.status_code, answer.headers["location"]) == (303, "/")
        cookie = answer.headers["set-cookie"].lower()
        assert "httponly" in cookie
        assert "samesite=strict" in cookie
        assert browser.get(f"{server.url}/api/v1/state").status_code == 200
        # The cookie alone does not help a foreign page.
        assert browser.post(f"{server.url}/api/v1/estop", headers={"Origin": "http://evil.example"}).status_code == 403
    with httpx.Client() as second:
        assert "set-cookie" not in second.get(url.group()).headers
        assert second.get(f"{server.url}/api/v1/state").status_code == 401
        fresh = re.search(r"http://\S+/login\S+", server.next_line())
        assert fresh is not None
        assert fresh.group() != url.group()
        second.get(fresh.group())
        assert second.get(f"{server.url}/api/v1/state").status_code == 200
    server.next_line()


def test_signing_in_with_the_token(server: Running) -> None:
    with server.anonymous() as browser:
        wrong = browser.post("/api/v1/session", json={"token": "nothing"})
        assert wrong.status_code == 401
        assert wrong.json()["detail"] == "this is not the token"
        assert browser.post("/api/v1/session", json={"token": TOKEN}).status_code == 204
        assert browser.get("/api/v1/state").status_code == 200


def test_a_body_has_a_limit(client: httpx.Client) -> None:
    answer = client.post("/api/v1/estop", json={"reason": "x" * 100_000})
    assert answer.status_code == 413
    assert answer.headers["content-type"] == "application/problem+json"
    chunked = client.post("/api/v1/estop", content=(b"x" * 10_000 for _ in range(10)))
    assert chunked.status_code == 413
    assert client.get("/api/v1/state").json()["estop"]["latched"] is False
