"""What the simulated camera's optics see: an exact pinhole, metric depth, the world's textures and the robot's body."""

import numpy as np
import pytest

from snakeslam.backends.sim import renderer as module
from snakeslam.backends.sim.camera import camera_calibration
from snakeslam.backends.sim.meshes import box, cylinder, poster
from snakeslam.backends.sim.renderer import FAR_M, HEIGHT_PX, SKY, WIDTH_PX, Renderer
from snakeslam.backends.sim.scenery import World
from snakeslam.backends.sim.settings import CameraSettings
from snakeslam.errors import BackendError
from snakeslam.geometry import se3
from snakeslam.robot.model import PRESETS

MODEL = PRESETS["sim35"]
FX, FY, CX, CY = camera_calibration(CameraSettings(), MODEL).intrinsics
T_WC = np.array([[0.0, 0.0, 1.0, 0.3], [-1.0, 0.0, 0.0, -0.2], [0.0, -1.0, 0.0, 0.5], [0.0, 0.0, 0.0, 1.0]])
"""Looks along x of W."""
AWAY = np.tile(se3.from_rt(np.eye(3), np.array([-9.0, 0.0, 0.0])), (MODEL.link_count, 1, 1))
"""The snake behind the camera."""
WHITE = np.full((4, 4, 3), 255, np.uint8)


@pytest.fixture
def draw():
    opened = []

    def _draw(texture, meshes, T_WC=T_WC, Ts_WL=AWAY):
        world = World()
        world.add(texture, meshes)
        opened.append(Renderer(world, MODEL, FX))
        return opened[-1].render(T_WC, Ts_WL)

    yield _draw
    for renderer in opened:
        renderer.close()


def _sheet(centre_C, side_m):
    """A square that faces the camera."""
    right_W, up_W = side_m * T_WC[:3, 0], -side_m * T_WC[:3, 1]
    corner_W = T_WC[:3, :3] @ centre_C + T_WC[:3, 3] - (right_W + up_W) / 2
    return poster(corner_W, right_W, up_W)


def test_points_appear_where_the_intrinsics_say_at_their_depth(draw):
    points_C = np.array([[0, 0, 1.0], [0.5, -0.35, 1.0], [-0.9, 0.6, 1.5], [1.4, 0.9, 2.0], [-2.6, -1.8, 4.0]])
    render = draw(WHITE, [_sheet(p, 0.02 * p[2]) for p in points_C])
    for x, y, z in points_C:
        u, v = FX * x / z + CX, FY * y / z + CY
        rows, columns = np.mgrid[round(v) - 12 : round(v) + 13, round(u) - 12 : round(u) + 13]
        near = render.inverse_depth[rows, columns] > 1.0 / (1.2 * z)
        assert np.hypot(columns[near].mean() - u, rows[near].mean() - v) < 0.5
        np.testing.assert_allclose(1.0 / render.inverse_depth[rows, columns][near], z, rtol=1e-4)


def test_depth_is_along_the_optical_axis_not_the_ray(draw):
    render = draw(WHITE, [_sheet(np.array([0, 0, 2.0]), 18)])
    np.testing.assert_allclose(1.0 / render.inverse_depth, 2.0, atol=1e-4)


def test_a_texture_is_seen_upright_and_not_mirrored(draw):
    texture = np.zeros((64, 64, 3), np.uint8)
    texture[:32, :32], texture[:32, 32:], texture[32:, :32] = (200, 0, 0), (0, 200, 0), (0, 0, 200)
    rgba = draw(texture, [_sheet(np.array([0, 0, 1.0]), 0.8)]).rgba[..., :3]
    up, down, left, right = int(CY) - 60, int(CY) + 60, int(CX) - 60, int(CX) + 60
    for place, channel in (((up, left), 0), ((up, right), 1), ((down, left), 2)):
        assert np.argmax(rgba[place]) == channel
        assert np.sort(rgba[place])[1] == 0
    np.testing.assert_array_equal(rgba[down, right], 0)


def test_the_back_of_a_face_and_nothing_at_all_show_the_sky(draw):
    back = _sheet(np.array([0, 0, 1.0]), 0.5)
    render = draw(WHITE, [poster(back.vertices_W[1], -0.5 * T_WC[:3, 0], -0.5 * T_WC[:3, 1])])
    assert np.all(render.rgba[..., :3] == SKY)
    np.testing.assert_allclose(1.0 / render.inverse_depth, FAR_M, rtol=1e-3)


def test_the_links_are_drawn_where_they_are(draw):
    Ts_WL = AWAY.copy()
    upright = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    Ts_WL[3] = T_WC @ se3.from_rt(upright, np.array([0.0, MODEL.joint_length_m / 2, 1.0]))
    near = 1.0 / draw(WHITE, [], Ts_WL=Ts_WL).inverse_depth < 2.0
    rows, columns = np.nonzero(near)
    assert np.hypot(columns.mean() - CX, rows.mean() - CY) < 1.0
    assert np.ptp(columns) + 1 == pytest.approx(FX * 2 * MODEL.radius_m, rel=0.05)
    assert np.ptp(rows) + 1 == pytest.approx(FY * 0.9 * MODEL.joint_length_m, rel=0.05)


def test_two_at_a_time_do_not_disturb_each_other():
    worlds = [World(), World()]
    worlds[0].add(WHITE, [_sheet(np.array([0, 0, 1.0]), 9)])
    renderers = [Renderer(world, MODEL, FX) for world in worlds]
    first, second = (renderer.render(T_WC, AWAY) for renderer in renderers)
    again = renderers[0].render(T_WC, AWAY)
    for renderer in renderers:
        renderer.close()
    assert not np.array_equal(first.rgba, second.rgba)
    np.testing.assert_array_equal(first.rgba, again.rgba)
    np.testing.assert_array_equal(first.inverse_depth, again.inverse_depth)


def test_the_driver_stays_off_standard_output(capfd, draw):
    draw(WHITE, [box((2, 0, 0), (1, 1, 1))])
    assert capfd.readouterr().out == ""


def test_without_opengl_one_line_says_what_is_needed(monkeypatch):
    monkeypatch.setattr(module, "LIBRARIES", {"libgl": "libNone.so.1", "libegl": "libNone.so.1"})
    monkeypatch.setattr(module.sys, "platform", "linux")
    with pytest.raises(BackendError, match=r"needs OpenGL.*libegl1") as raised:
        Renderer(World(), MODEL, FX)
    assert "\n" not in str(raised.value)


def test_the_picture_has_its_size(draw):
    render = draw(WHITE, [cylinder(0.1, 0, 1, 12)])
    assert render.rgba.shape == (HEIGHT_PX, WIDTH_PX, 4)
    assert render.inverse_depth.shape == (HEIGHT_PX, WIDTH_PX)
    assert render.inverse_depth.dtype == np.float32
