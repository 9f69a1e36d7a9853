"""Requests made up from the OpenAPI schema: whatever they say, the server answers as the schema says."""

import os
from collections.abc import Callable
from typing import Any

import httpx
import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from requests import Session
from requests.adapters import HTTPAdapter
from schemathesis import APIOperation, Case, GenerationMode
from urllib3.util.retry import Retry

from tests.server.running import TOKEN, Running

BEARER = {"Authorization": f"Bearer {TOKEN}"}
# The sessions and runs that these start would cost more than they show; other tests start them.
HEAVY = {("POST", "/api/v1/sim/start"), ("POST", "/api/v1/runs")}
ASKED = settings(
    max_examples=int(os.environ.get("SCHEMA_EXAMPLES", "5")),
    deadline=None,
    derandomize=True,
    database=None,
    phases=(Phase.explicit, Phase.generate),
    suppress_health_check=list(HealthCheck),
)


@pytest.fixture(scope="module")
def operations(server: Running) -> list[APIOperation]:
    schema = schemathesis.openapi.from_url(f"{server.url}/api/openapi.json", headers=BEARER)
    found = [result.ok() for result in schema.get_all_operations()]
    return [operation for operation in found if (operation.method.upper(), operation.path) not in HEAVY]


def patient() -> Session:
    """A session that waits when it is asked to: the tests ask faster than any script may."""
    session = Session()
    slow = Retry(total=50, status_forcelist=[429], allowed_methods=None, respect_retry_after_header=True)
    session.mount("http://", HTTPAdapter(max_retries=slow))
    return session


def asking(operation: APIOperation, mode: GenerationMode, session: Session, statuses: set[int]) -> Callable[[], None]:
    """Return a test that asks one operation for what its schema allows, or (NEGATIVE) for what it does not."""

    @ASKED
    @given(case=operation.as_strategy(generation_mode=mode))
    def ask(case: Case) -> None:
        answer = case.call(headers=BEARER, session=session)
        statuses.add(answer.status_code)
        # All default checks: declared statuses, media types, forms, Allow, authentication, what is accepted.
        case.validate_response(answer)

    return ask


@pytest.mark.parametrize("mode", [GenerationMode.POSITIVE, GenerationMode.NEGATIVE])
def test_every_request_is_answered_as_the_schema_says(
    server: Running, operations: list[APIOperation], mode: GenerationMode
) -> None:
    assert len(operations) > 20
    statuses: set[int] = set()
    session = patient()
    for operation in operations:
        # An operation without a body cannot be asked wrongly: any text may be an id.
        if mode is GenerationMode.POSITIVE or operation.body:
            asking(operation, mode, session, statuses)()
    assert {200} <= statuses if mode is GenerationMode.POSITIVE else {422} <= statuses
    session.close()
    with server.client() as client:
        assert client.get("/api/v1/state").json()["session"] == "running"


@pytest.fixture
def schema(client: httpx.Client) -> Any:
    return client.get("/api/openapi.json").json()


def test_every_operation_declares_its_refusals_as_problems(schema: Any) -> None:
    for path, operations in schema["paths"].items():
        for method, operation in operations.items():
            responses = operation["responses"]
            wanted = {"401", "421", "429", "503"}
            wanted |= {"403", "409", "413"} if method != "get" else set()
            wanted |= {"400", "415", "422"} if "requestBody" in operation else set()
            wanted |= {"404"} if "{" in path else set()
            assert wanted <= set(responses), (path, method)
            for status, response in responses.items():
                assert int(status) < 400 or list(response["content"]) == ["application/problem+json"]


def test_files_figures_and_websockets_are_described(schema: Any) -> None:
    paths = schema["paths"]
    assert "application/octet-stream" in paths["/api/v1/map.ply"]["get"]["responses"]["200"]["content"]
    artifact = paths["/api/v1/runs/{run_id}/artifacts/{name}"]["get"]["responses"]["200"]["content"]
    assert {"application/octet-stream", "application/json", "image/png"} <= set(artifact)
    assert next(iter(paths["/metrics"]["get"]["responses"]["200"]["content"])).startswith("text/plain")
    assert set(schema["x-websockets"]) == {"/api/v1/telemetry", "/api/v1/teleop"}
    overrides = schema["components"]["schemas"]["RunRequest"]["properties"]["overrides"]
    assert overrides["properties"]["sim.world"]["enum"] == ["corridor", "office", "rubble", "blank"]
    assert not {"replay.calibration", "run.seed"} & set(overrides["properties"])


@pytest.mark.parametrize(
    ("method", "path", "allowed"),
    [
        ("PATCH", "/api/v1/control/lease", "DELETE, GET, POST, PUT"),
        ("DELETE", "/api/v1/state", "GET"),
        ("POST", "/api/v1/runs/abc", "DELETE, GET"),
        ("GET", "/api/v1/estop", "POST"),
        ("TRACE", "/api/v1/gait", "GET, PUT"),
        ("PUT", "/metrics", "GET"),
    ],
)
def test_a_wrong_method_gets_the_allowed_ones(client: httpx.Client, method: str, path: str, allowed: str) -> None:
    answer = client.request(method, path)
    assert (answer.status_code, answer.headers.get("allow")) == (405, allowed)
    assert answer.headers["content-type"] == "application/problem+json"


def test_nothing_is_there_whatever_the_method(client: httpx.Client) -> None:
    for method in ("GET", "POST", "DELETE"):
        answer = client.request(method, "/api/v1/nothing")
        assert (answer.status_code, answer.headers["content-type"]) == (404, "application/problem+json")


def test_a_body_of_another_kind_is_refused_as_that(client: httpx.Client) -> None:
    for kind in ("text/plain", "application/xml", "multipart/form-data; boundary=x", ""):
        answer = client.put("/api/v1/gait", content=b'{"name": "pedal"}', headers={"Content-Type": kind})
        assert answer.status_code == 415
        assert "allowed: application/json" in answer.json()["detail"]
    kind = {"Content-Type": "Application/JSON; charset=utf-8"}
    assert client.put("/api/v1/gait", content=b'{"name": "pedal"}', headers=kind).status_code == 200
