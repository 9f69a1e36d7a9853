"""A robot that was blind for too long and then sees another place, over real processes: a new map, and it says so."""

from collections.abc import Iterator

import numpy as np
import pytest

from server.viewer import NEW_MAP_RGB, tinted
from snakeslam.config import Config, RunSettings, SafetySettings
from snakeslam.estimation.gait.settings import GaitSensorSettings
from snakeslam.estimation.health import NEW_MAP
from snakeslam.estimation.health_settings import HealthSettings
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.robot.model import RobotSettings
from tests.faults.nodes import Nodes, wait_for
from tests.faults.test_faults import Site
from tests.server.running import START_S
from tests.server.still_robot import ELSEWHERE_WHEN_MOVED

CONFIG = Config(
    robot=RobotSettings(model="orthogonal24"),
    run=RunSettings(seed=ELSEWHERE_WHEN_MOVED),
    estimator=EstimatorSettings(health=HealthSettings(max_blind_s=0.5), gait=GaitSensorSettings(max_blind_s=0.5)),
    safety=SafetySettings(max_blind_s=0.0),
)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    nodes = Nodes(tmp_path_factory.mktemp("bus"), config=CONFIG)
    site = Site(nodes, tmp_path_factory.mktemp("site"))
    yield site
    site.server.stop()
    nodes.close()


def test_a_new_map_is_reported_as_long_as_nothing_ties_it_to_the_old_one(site: Site) -> None:
    site.moving()
    nodes = site.nodes

    def apart() -> bool:
        if not site.get("/state")["moving"]:
            site.post("/gait/start")  # Held for another reason, as on a busy machine.
        return not nodes.slam_states[-1].health.map_connected

    wait_for(apart, START_S)
    site.post("/gait/stop")
    wait_for(lambda: site.get("/state")["health"]["verdict"] == "degraded", START_S)
    health = site.get("/state")["health"]
    assert health["map_connected"] is False
    assert NEW_MAP in health["reasons"]
    assert not any(state.health.verdict == "good" for state in nodes.slam_states if not state.health.map_connected)
    wait_for(lambda: any(chunk.island for chunk in nodes.chunks.values()))
    new = next(chunk for chunk in nodes.chunks.values() if chunk.island)
    old = next(chunk for chunk in nodes.chunks.values() if not chunk.island)
    assert np.abs(tinted(new).astype(float) - NEW_MAP_RGB).mean() < np.abs(new.rgb.astype(float) - NEW_MAP_RGB).mean()
    np.testing.assert_array_equal(tinted(old), old.rgb)

    # A slam that is started again can tie nothing: what was not connected still is not.
    nodes.slam.process.kill()
    nodes.slam.process.join()
    nodes.slam_states.clear()
    nodes.start_slam()
    wait_for(lambda: nodes.slam_states and nodes.slam_states[-1].T_WI is not None, START_S)
    assert nodes.slam_states[-1].health.map_connected is False
