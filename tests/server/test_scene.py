"""The 3D scene: shapes that close, paths that stay small, nodes that are reused."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import viser

from server.body import body_links, heading_rad, mean_path
from server.models import Body
from server.state import body
from server.timed_path import MAX_PATH, TimedPath
from server.view import View
from server.viewer import MAX_PATH_POINTS, Scene, capsule_mesh, path_segments
from server.viewer_host import start_viser, stop_viser
from snakeslam.config import Config
from snakeslam.messages import Health, MapChunk, Verdict
from snakeslam.runtime.bus.topics import HeadMotion, JpegImage, RobotShape, Started, Tick

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
    """A tick some distance further."""
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


def test_a_link_is_a_closed_surface_that_faces_outwards() -> None:
    vertices, faces = capsule_mesh(0.09, 0.03)
    edges = Counter((int(a), int(b)) for face in faces for a, b in zip(face, np.roll(face, -1), strict=True))
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    assert abs(volume) == pytest.approx(np.pi * 0.03**2 * 0.09, rel=0.2)
    assert volume > 0.0


def test_a_long_path_is_drawn_with_few_segments_to_its_very_end() -> None:
    points = np.array([(float(k), 0.0, 0.0) for k in range(19_999)])
    segments = path_segments(points)
    assert len(segments) <= MAX_PATH_POINTS + 1
    assert segments[0, 0, 0] == 0.0
    assert segments[-1, 1, 0] == 19_998.0
    assert np.array_equal(segments[1:, 0], segments[:-1, 1])


def test_a_path_of_a_day_stays_in_memory() -> None:
    path, T = TimedPath(), np.eye(4)
    for k in range(5 * MAX_PATH):
        path.add(k * 0.05, T)
    assert len(path.rows) <= MAX_PATH
    times = np.diff([row[0] for row in path.rows])
    assert times.max() <= 1.2 * times.min()


def test_a_stationary_time_removes_no_detail_from_the_path_before_it() -> None:
    """A circle driven in 100 s, then 48 min without motion: the circle is still round, in the rows and as drawn."""
    path, T = TimedPath(), np.eye(4)
    for k in range(60_000):
        angle = 2.0 * np.pi * min(k / 2000.0, 1.0)
        T[:3, 3] = np.cos(angle), np.sin(angle), 0.0
        path.add(k * 0.05, T)
    assert len(path.rows) <= MAX_PATH
    assert path.rows[-1][0] > 2_990.0
    steps_m = np.linalg.norm(np.diff([row[1:] for row in path.rows], axis=0), axis=1)
    assert steps_m.max() < 0.004
    segments = path_segments(np.array(path.rows)[:, 1:])
    assert len(segments) <= MAX_PATH_POINTS + 1
    assert np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).max() < 0.01


def test_updates_replace_each_other_for_those_who_come_later(server: viser.ViserServer) -> None:
    scene = Scene(server)
    scene.reset(STARTED)

    def draw(count: int) -> int:
        for k in range(count):
            scene.show_tick(moved(k + 1), moved(k + 1).Ts_WL)
            scene.show_image(JpegImage(k, k, 160, 120, bytes([k])))
            scene.show_path("estimate", [(0.0, 0.0, 0.0, 0.0), (1.0, float(k), 0.0, 0.0)], 4.0)
            scene.show_chunk(chunk(k % 3, k))
        return len(kept(server))

    few = draw(5)
    assert draw(100) <= few + 3


def test_the_body_is_drawn_before_there_is_an_estimate(server: viser.ViserServer) -> None:
    view = View("sim", "simulator", Config())
    waiting = replace(TICK, T_WI=None, Ts_WL=None, q_measured_rad=np.full(35, 0.05))
    Ts_WL = body_links(view, waiting)
    assert Ts_WL is not None
    assert Ts_WL.shape == (36, 4, 4)
    scene = Scene(server)
    scene.reset(replace(STARTED, robot=RobotShape("sim35", 35, 0.09, 0.032)))
    scene.show_tick(waiting, Ts_WL)
    robot, arrow = server.scene.get_handle_by_name("/robot"), server.scene.get_handle_by_name("/heading")
    assert isinstance(robot, viser.BatchedMeshHandle)
    assert arrow is not None
    assert robot.visible
    assert arrow.visible
    np.testing.assert_allclose(robot.batched_positions, Ts_WL[:, :3, 3], atol=1e-6)
    np.testing.assert_allclose(server.initial_camera.look_at, np.mean(Ts_WL[:, :3, 3], axis=0), atol=1e-6)
    assert body_links(View("recording", "clip", Config()), waiting) is None
    view.estimate.add(0.0, np.eye(4))
    assert body_links(view, waiting) is None, "an estimate that was lost does not put the body back to the start"


def test_the_page_follows_the_imu_of_a_recording_without_joints() -> None:
    T = np.eye(4)
    T[:3, 3] = [1.0, 2.0, 0.5]
    view = View("recording", "clip", Config())
    found = body(view, replace(TICK, T_WI=T, Ts_WL=None))
    assert found == Body(p_m=[1.0, 2.0, 0.5], heading_deg=0.0, estimated=True)
    assert body(view, replace(TICK, T_WI=None, Ts_WL=None)) is None


def test_the_heading_is_the_heads_mean_one_or_that_of_the_body() -> None:
    Ts_WL = np.tile(np.eye(4), (3, 1, 1))
    Ts_WL[:, :2, 0] = [0.0, 1.0]
    assert heading_rad(TICK, Ts_WL) == pytest.approx(np.pi / 2.0)
    assert heading_rad(replace(TICK, head=HeadMotion(heading_deg=30.0)), Ts_WL) == pytest.approx(np.pi / 6.0)


def test_the_path_of_a_swinging_head_is_drawn_as_its_mean() -> None:
    t_s = np.arange(0.0, 40.0, 0.05)
    swing_m = 0.3 * np.sin(2.0 * np.pi * t_s / 4.0)
    rows = [(float(t), 0.05 * float(t), float(y), 0.1) for t, y in zip(t_s, swing_m, strict=True)]
    path = mean_path(rows, 4.0)
    inner = (t_s > 2.0) & (t_s < 37.9)
    assert np.max(np.abs(path[inner, 1])) < 0.01
    np.testing.assert_allclose(path[inner, 0], 0.05 * t_s[inner], atol=2e-3)
    np.testing.assert_allclose(path[[0, -1]], np.array(rows)[[0, -1], 1:], atol=1e-9)
    assert mean_path([], 4.0).shape == (0, 3)


def test_a_new_session_starts_with_an_empty_scene(server: viser.ViserServer) -> None:
    scene = Scene(server)
    scene.reset(STARTED)
    scene.show_tick(moved(1), moved(1).Ts_WL)
    scene.show_chunk(chunk(1))
    assert server.scene.get_handle_by_name("/map/1") is not None
    scene.reset(replace(STARTED, robot=None))
    assert server.scene.get_handle_by_name("/map/1") is None
    assert server.scene.get_handle_by_name("/robot") is None
    scene.show_tick(moved(2), moved(2).Ts_WL)
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
