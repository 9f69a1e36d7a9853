"""A robot that drives up to a bare wall, over real processes: it stops by itself, and backs up when it is asked to."""

import time
from collections.abc import Iterator
from http import HTTPStatus

import pytest

from snakeslam.config import Config, RunSettings, SafetySettings
from snakeslam.robot.model import RobotSettings
from snakeslam.runtime.bus.topics import RobotState
from tests.faults.nodes import Nodes, wait_for
from tests.faults.test_faults import Site
from tests.server.running import START_S
from tests.server.still_robot import COVERED_WHEN_MOVED

BLIND_S, BACK_UP_S = 2.0, 1.5
CONFIG = Config(
    robot=RobotSettings(model="orthogonal24"),
    run=RunSettings(seed=COVERED_WHEN_MOVED),
    safety=SafetySettings(max_blind_s=BLIND_S, back_up_s=BACK_UP_S),
)
WHY = "the camera has seen nothing for 2 s"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    nodes = Nodes(tmp_path_factory.mktemp("bus"), config=CONFIG)
    site = Site(nodes, tmp_path_factory.mktemp("site"))
    yield site
    site.server.stop()
    nodes.close()


def blind(site: Site) -> bool:
    """Whether it was held because it is blind; held for another reason, as on a busy machine, it is started again."""
    state = site.get("/state")
    if not state["moving"] and state["held_because"] != WHY:
        site.post("/gait/start")
    return state["held_because"] == WHY


def stopped(nodes: Nodes) -> bool:
    """Whether the servos have had one and the same target for a while."""
    steps = nodes.rates(time.monotonic_ns() - 300_000_000)
    return len(steps) > 10 and all(step < 1e-6 for _, step in steps)


def moving_until(site: Site, path: str, reason: str | None) -> list[RobotState]:
    """Return the states of a motion that ``path`` sets going and that ends in a hold for ``reason``, or without one.

    One that ends otherwise, as on a busy machine whose links are late, is set going again.
    """
    states = site.nodes.states
    for _ in range(20):
        states.clear()
        wait_for(lambda: site.post(path).status_code == HTTPStatus.OK, START_S)
        wait_for(lambda: any(state.moving for state in list(states)) and not states[-1].moving, START_S)
        if states[-1].held_because == reason:
            return [state for state in list(states) if state.moving]
    raise AssertionError(f"it was always held for another reason: {states[-1].held_because}")


def test_a_blind_robot_stops_by_itself_and_backs_up_on_request(site: Site) -> None:
    nodes = site.nodes
    site.moving()
    wait_for(lambda: blind(site), START_S)
    assert site.get("/state")["back_up_offered"]
    # At rest the pose is certain again, but nothing is seen: the offer stands.
    nodes.assert_stationary()
    assert site.get("/state")["back_up_offered"]

    backing = moving_until(site, "/gait/back-up", None)
    assert {state.gait.drive for state in backing if state.gait is not None} == {-1.0}
    assert (backing[-1].t_ns - backing[0].t_ns) / 1e9 == pytest.approx(BACK_UP_S, abs=0.3)
    assert site.get("/state")["back_up_offered"]
    # It stops as smoothly as an operator stops it.
    wait_for(lambda: stopped(nodes))

    # A fresh start goes on for the whole limit, blind as the robot is.
    going = moving_until(site, "/gait/start", WHY)
    assert (going[-1].t_ns - going[0].t_ns) / 1e9 == pytest.approx(BLIND_S, abs=0.5)


def test_a_back_up_ends_with_a_stop_and_obeys_the_emergency_stop(site: Site) -> None:
    nodes = site.nodes
    wait_for(lambda: site.post("/gait/back-up").status_code == HTTPStatus.OK, START_S)
    assert site.post("/gait/stop").status_code == HTTPStatus.OK
    wait_for(lambda: not site.get("/state")["moving"])
    wait_for(lambda: site.post("/gait/back-up").status_code == HTTPStatus.OK, START_S)
    assert site.post("/estop").status_code == HTTPStatus.OK
    nodes.assert_stationary()
    refused = site.post("/gait/back-up")
    assert refused.status_code == HTTPStatus.CONFLICT
    assert "E-stop" in refused.json()["detail"]
    assert not site.get("/state")["back_up_offered"]
    site.post("/estop/reset")
    nodes.assert_stationary()
