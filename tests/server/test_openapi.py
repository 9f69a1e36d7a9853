"""Requests made up from the OpenAPI schema: whatever they say, the server answers and never fails."""

from collections.abc import Callable

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from schemathesis import APIOperation, Case, GenerationMode
from schemathesis.checks import not_a_server_error

from tests.server.running import TOKEN, Running

BEARER = {"Authorization": f"Bearer {TOKEN}"}
# The sessions and runs that these start would cost more than they tell; other tests start them.
HEAVY = {("POST", "/api/v1/sim/start"), ("POST", "/api/v1/runs")}
ASKED = settings(
    max_examples=5,
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


def asking(operation: APIOperation, mode: GenerationMode, statuses: set[int]) -> Callable[[], None]:
    """Return a test that asks one operation for what its schema allows, or (NEGATIVE) for what it does not."""

    @ASKED
    @given(case=operation.as_strategy(generation_mode=mode))
    def ask(case: Case) -> None:
        answer = case.call(headers=BEARER)
        statuses.add(answer.status_code)
        case.validate_response(answer, checks=[not_a_server_error])
        if answer.status_code >= 400:
            assert answer.headers["content-type"] == ["application/problem+json"]

    return ask


@pytest.mark.parametrize("mode", [GenerationMode.POSITIVE, GenerationMode.NEGATIVE])
def test_no_request_makes_the_server_fail(
    server: Running, operations: list[APIOperation], mode: GenerationMode
) -> None:
    assert len(operations) > 20
    statuses: set[int] = set()
    for operation in operations:
        # An operation without a body cannot be asked wrongly: any text may be an id.
        if mode is GenerationMode.POSITIVE or operation.body:
            asking(operation, mode, statuses)()
    assert {200} <= statuses if mode is GenerationMode.POSITIVE else {422} <= statuses
    with server.client() as client:
        assert client.get("/api/v1/state").json()["session"] == "running"
