"""A new map that is not tied to the old one is never good; once it is tied, it moves there."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from snakeslam.estimation.base import FrameEstimate
from snakeslam.estimation.health import NEW_MAP, TIED
from snakeslam.estimation.health_settings import HealthSettings
from snakeslam.estimation.settings import EstimatorSettings, Mode
from snakeslam.geometry import se3
from snakeslam.mapping.settings import MappingSettings
from snakeslam.messages import CameraFrame, MapChunk, Packet, SlamUpdate, Verdict
from snakeslam.slam import Slam
from snakeslam.studies.metrics import count_islands
from tests.estimation.test_relocalisation import COVERED_NS
from tests.estimation.wall import RIG, Wall

BACK_NS = 7_000_000_000
SHORT = HealthSettings(max_blind_s=0.5)


def elsewhere(duration_s: float, back_ns: int = BACK_NS) -> Iterator[Packet]:
    """The camera is covered, then in front of another wall, and from ``back_ns`` on of the first one again."""
    for one, other in zip(Wall().packets(duration_s), Wall(seed=5).packets(duration_s), strict=True):
        if not isinstance(one, CameraFrame) or not COVERED_NS[0] < one.t_ns <= back_ns:
            yield one
        elif one.t_ns <= COVERED_NS[1]:
            level = np.uint8(one.seq % 2)
            yield replace(one, gray=np.full_like(one.gray, level), depth_m=np.zeros_like(one.depth_m))
        else:
            yield other


def run(mode: Mode, packets: Iterator[Packet]) -> list[SlamUpdate]:
    slam = Slam(EstimatorSettings(mode=mode, health=SHORT), MappingSettings(), RIG, 0)
    return [update for update in map(slam.process, packets) if update is not None]


def errors_m(updates: list[SlamUpdate] | list[FrameEstimate], from_s: float) -> list[float]:
    """Distances from the truth relative to the first pose."""
    poses = [update.pose for update in updates if update.pose is not None]
    wall = Wall()
    T_WG = poses[0].T_WI @ se3.inv(wall.pose(poses[0].t_ns / 1e9))
    late = [pose for pose in poses if pose.t_ns / 1e9 >= from_s]
    return [float(np.linalg.norm(p.T_WI[:3, 3] - (T_WG @ wall.pose(p.t_ns / 1e9))[:3, 3])) for p in late]


@pytest.mark.parametrize("mode", ["vio", "visual"])
def test_a_new_map_says_so_until_it_is_tied_to_the_old_one(mode: Mode) -> None:
    updates = run(mode, elsewhere(9.0))
    events = [(update.t_ns, event) for update in updates for event in update.events]
    apart_ns = next(t_ns for t_ns, event in events if event == NEW_MAP)
    tied_ns = next(t_ns for t_ns, event in events if event == TIED)
    assert COVERED_NS[1] - 600_000_000 < apart_ns < BACK_NS < tied_ns
    between = [u for u in updates if apart_ns <= u.t_ns < tied_ns and u.pose is not None]
    assert len(between) > 40
    assert all(not u.health.map_connected and NEW_MAP in u.health.reasons for u in between)
    assert all(u.health.verdict is not Verdict.GOOD and u.island != 0 for u in between)
    others = [u for u in updates if u.t_ns < apart_ns or u.t_ns >= tied_ns]
    assert all(u.health.map_connected and u.island == 0 for u in others)
    assert max(errors_m(updates, tied_ns / 1e9)) < 0.05


@pytest.mark.parametrize("mode", ["vio", "visual"])
def test_the_new_part_of_the_map_moves_to_the_old_one_when_it_is_tied(mode: Mode) -> None:
    updates = run(mode, elsewhere(9.0))
    tied = next(update for update in updates if update.tie is not None)
    assert tied.tie is not None
    before: dict[int, MapChunk] = {c.key: c for u in updates if u.t_ns < tied.t_ns for c in u.chunks}
    apart = {key: chunk for key, chunk in before.items() if chunk.island == tied.tie.island}
    assert apart
    assert all(chunk.island == update.island for update in updates for chunk in update.chunks)
    moved = {chunk.key: chunk for chunk in tied.chunks if chunk.revision}
    assert moved.keys() == apart.keys()
    for key, chunk in moved.items():
        assert chunk.island == 0
        np.testing.assert_allclose(chunk.T_WK, tied.tie.T @ apart[key].T_WK)
        np.testing.assert_array_equal(chunk.points_K, apart[key].points_K)
    new = [chunk.key for update in updates for chunk in update.chunks if not chunk.revision]
    assert len(new) == len(set(new))
    apart_count = count_islands([u for u in updates if u.t_ns < tied.t_ns])
    assert apart_count is not None
    assert apart_count >= 2
    assert count_islands(updates) == apart_count - 1


@pytest.mark.parametrize("mode", ["vio", "visual"])
def test_an_unknown_scene_stays_a_map_of_its_own(mode: Mode) -> None:
    updates = run(mode, elsewhere(7.0, back_ns=100_000_000_000))
    apart = [update for update in updates if not update.health.map_connected]
    assert len(apart) > 40
    assert apart[-1] is updates[-1]
    unseen = [update for update in updates if update.t_ns > COVERED_NS[0] + 100_000_000]
    assert all(update.health.verdict is not Verdict.GOOD for update in unseen)
    assert all(update.island != 0 for update in apart if update.pose is not None)
    assert all(update.tie is None for update in updates)


def test_after_a_short_blind_time_all_is_one_map() -> None:
    updates = run("vio", elsewhere(6.0, back_ns=COVERED_NS[1]))
    assert all(update.health.map_connected and update.island == 0 for update in updates)
    assert count_islands(updates) == 1
