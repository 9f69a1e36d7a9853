"""The 3D scene: shapes that close, paths that stay small, nodes that are reused."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import viser

from server.live import MAX_PATH, Path3
from server.viewer import MAX_PATH_POINTS, Scene, capsule_mesh, path_segments
from server.viewer_host import start_viser, stop_viser
from snakeslam.messages import Health, MapChunk, Verdict
from snakeslam.runtime.topics import HeadMotion, Picture, RobotShape, Started, Tick

STARTED = Started(0, "vio", RobotShape("orthogonal24", 24, 0.096, 0.032), np.eye(4), 1.0, 4 / 3, None)
TICK = Tick(
    t_ns=0,
    commands_done=0,
    moving=False,
    estop_reason=None,
    gait=None,
    health=Health(Verdict.GOOD),
    realtime_factor=None,
    frame_rate_hz=None,
    q_target_rad=None,
    q_measured_rad=None,
    T_WI=np.eye(4),
    Ts_WL=np.tile(np.eye(4), (25, 1, 1)),
    T_WI_truth=None,
    head=HeadMotion(),
    error_m=None,
    distance_m=None,
    map_points=0,
)


def moved(k: int) -> Tick:
    """A tick some way further."""
    T = np.eye(4)
    T[:3, 3] = [0.1 * k, 0.02 * k, 0.0]
    return replace(TICK, t_ns=k, T_WI=T, Ts_WL=np.tile(T, (25, 1, 1)))


def chunk(key: int, revision: int = 0) -> MapChunk:
    return MapChunk(key, revision, np.eye(4), np.full((10, 3), float(key)), np.zeros((10, 3)))


@pytest.fixture
def server(tmp_path: Path) -> Iterator[viser.ViserServer]:
    made = start_viser(tmp_path / "v.sock")
    yield made
    stop_viser(made)


def kept(server: viser.ViserServer) -> list[Any]:
    """What a new client would be sent."""
    return list(server._websock_server._broadcast_buffer.message_from_id.values())


def test_a_link_is_a_closed_surface_that_looks_outwards() -> None:
    vertices, faces = capsule_mesh(0.09, 0.03)
    edges = Counter((int(a), int(b)) for face in faces for a, b in zip(face, np.roll(face, -1), strict=True))
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    assert abs(volume) == pytest.approx(np.pi * 0.03**2 * 0.09, rel=0.2)
    assert volume > 0.0


def test_a_long_path_is_drawn_with_few_segments_to_its_very_end() -> None:
    rows = [(float(k), float(k), 0.0, 0.0) for k in range(19_999)]
    segments = path_segments(rows)
    assert len(segments) <= MAX_PATH_POINTS + 1
    assert segments[0, 0, 0] == 0.0
    assert segments[-1, 1, 0] == 19_998.0
    assert np.array_equal(segments[1:, 0], segments[:-1, 1])


def test_a_path_of_a_day_stays_in_memory() -> None:
    path, T = Path3(), np.eye(4)
    for k in range(5 * MAX_PATH):
        path.add(k * 0.05, T)
    assert len(path.rows) <= MAX_PATH
    times = np.diff([row[0] for row in path.rows])
    assert times.max() <= 1.2 * times.min()


def test_updates_replace_each_other_for_those_who_come_later(server: viser.ViserServer) -> None:
    scene = Scene(server)
    scene.reset(STARTED)

    def draw(count: int) -> int:
        for k in range(count):
            scene.show_tick(moved(k + 1))
            scene.show_picture(Picture(k, k, 160, 120, bytes([k])))
            scene.show_path("estimate", [(0.0, 0.0, 0.0, 0.0), (1.0, float(k), 0.0, 0.0)])
            scene.show_chunk(chunk(k % 3, k))
        return len(kept(server))

    few = draw(5)
    assert draw(100) <= few + 3


def test_a_new_session_starts_with_an_empty_scene(server: viser.ViserServer) -> None:
    scene = Scene(server)
    scene.reset(STARTED)
    scene.show_tick(moved(1))
    scene.show_chunk(chunk(1))
    assert server.scene.get_handle_by_name("/map/1") is not None
    scene.reset(replace(STARTED, robot=None))
    assert server.scene.get_handle_by_name("/map/1") is None
    assert server.scene.get_handle_by_name("/robot") is None
    scene.show_tick(moved(2))
    scene.reset(None)
    assert server.scene.get_handle_by_name("/camera") is None


def test_the_map_hangs_on_its_keyframes(server: viser.ViserServer) -> None:
    scene = Scene(server)
    T = np.eye(4)
    T[:3, 3] = [3.0, 2.0, 1.0]
    scene.show_chunk(replace(chunk(7), T_WK=T))
    handle = server.scene.get_handle_by_name("/map/7")
    assert isinstance(handle, viser.PointCloudHandle)
    assert np.array_equal(handle.position, [3.0, 2.0, 1.0])
    assert np.array_equal(handle.points, np.full((10, 3), 7.0))
    scene.show_chunk(MapChunk(8, 0, T, np.zeros((0, 3)), np.zeros((0, 3))))
    assert server.scene.get_handle_by_name("/map/8") is None
