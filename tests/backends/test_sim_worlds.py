"""The worlds: drawn from a seed, textured like real places, clear around the robot."""

import cv2
import numpy as np
import pytest

from snakeslam.backends.sim.camera import Camera, camera_calibration
from snakeslam.backends.sim.meshes import box, cylinder, merge, rock
from snakeslam.backends.sim.renderer import Renderer
from snakeslam.backends.sim.settings import CameraSettings, SimSettings
from snakeslam.backends.sim.worlds import world
from snakeslam.geometry import se3
from snakeslam.robot.model import PRESETS

NAMES = ["corridor", "office", "rubble", "blank"]
FREE_X_M, FREE_Y_M = (-4.0, 6.0), (-2.4, 2.4)
CAMERA_HEIGHT_M = 0.1


@pytest.fixture(scope="module", params=[(name, seed) for name in NAMES for seed in (1, 5)], ids=str)
def made(request):
    name, seed = request.param
    return name, world(name, np.random.default_rng(seed))


def test_the_robot_has_room(made):
    for obstacle in made[1].obstacles:
        x, y, _ = obstacle.centre_W
        length, width, _ = obstacle.size_m
        c, s = abs(np.cos(obstacle.yaw_rad)), abs(np.sin(obstacle.yaw_rad))
        reach_x, reach_y = (c * length + s * width) / 2, (s * length + c * width) / 2
        outside_x = x - reach_x > FREE_X_M[1] or x + reach_x < FREE_X_M[0]
        outside_y = y - reach_y > FREE_Y_M[1] or y + reach_y < FREE_Y_M[0]
        assert outside_x or outside_y, obstacle


def test_it_is_closed_all_around_by_high_walls(made):
    for direction in np.deg2rad(np.arange(0, 360, 7.0)):
        ray = np.array([np.cos(direction), np.sin(direction)])
        assert any(_hits(obstacle, ray) and obstacle.size_m[2] >= 2.0 for obstacle in made[1].obstacles)


def _hits(obstacle, ray):
    centre, half = np.array(obstacle.centre_W[:2]), np.array(obstacle.size_m[:2]) / 2
    with np.errstate(divide="ignore"):
        times = np.sort(np.stack([(centre - half) / ray, (centre + half) / ray]), axis=0)
    return times[0].max() <= times[1].min() and times[1].min() > 0


def test_textures_are_not_white_noise(made):
    """Neighbouring pixels of real surfaces are alike."""
    for texture, _ in made[1].surfaces:
        gray = cv2.cvtColor(texture, cv2.COLOR_RGB2GRAY).astype(float)
        assert np.corrcoef(gray[:, 1:].ravel(), gray[:, :-1].ravel())[0, 1] > 0.75


def test_the_same_seed_makes_the_same_world_and_another_seed_another():
    for name in ("office", "rubble"):
        first, again, other = (world(name, np.random.default_rng(seed)) for seed in (4, 4, 9))
        assert first.obstacles == again.obstacles
        for (texture, shapes), (texture2, shapes2) in zip(first.surfaces, again.surfaces, strict=True):
            np.testing.assert_array_equal(texture, texture2)
            np.testing.assert_array_equal(merge(shapes).vertices_W, merge(shapes2).vertices_W)
        assert not np.array_equal(first.surfaces[0][0], other.surfaces[0][0])


def _look(made, yaw_rad):
    """Frame of the raised head's camera over the origin, without motion."""
    model = PRESETS["sim35"]
    calibration = camera_calibration(CameraSettings(), model)
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    T_WC = np.array([[s, 0, c, 0], [-c, 0, s, 0], [0, -1, 0, CAMERA_HEIGHT_M], [0, 0, 0, 1]])
    sensor = Camera(CameraSettings(), calibration.intrinsics, np.random.default_rng(0))
    behind = se3.from_rt(np.eye(3), np.array([-9.0, 0.0, 0.0]))
    renderer = Renderer(made, model, calibration.intrinsics[0])
    render = renderer.render(T_WC, np.tile(behind, (model.link_count, 1, 1)))
    renderer.close()
    return sensor.expose(0, 0, render, np.zeros(3))


def test_there_is_as_much_to_track_as_the_world_promises(made):
    name, place = made
    frame = _look(place, 0.3)
    corners = cv2.FastFeatureDetector_create(20).detect(frame.gray)
    cells = {(int(k.pt[0]) // 80, int(k.pt[1]) // 80) for k in corners}
    if name == "blank":
        assert 10 <= len(corners) < 400
        assert len(cells) < 25
    else:
        assert len(corners) >= 150
        assert len(cells) >= 30
    assert 60 < frame.gray.mean() < 190
    assert np.mean((frame.gray < 5) | (frame.gray > 250)) < 0.05
    assert 0.2 < np.mean(frame.depth_m > 0) < 0.95


@pytest.mark.parametrize(
    "mesh",
    [
        box((1, 2, 3), (0.4, 0.6, 0.8), 0.7),
        rock(np.random.default_rng(1), (1, 2, 3), (0.5, 0.4, 0.3), 0.2),
        cylinder(0.4, -0.2, 0.5, 9),
    ],
    ids=["box", "rock", "cylinder"],
)
def test_faces_look_outwards(mesh):
    """Winding and normals agree, and point away from the middle."""
    corners = mesh.vertices_W[mesh.triangles]
    winding = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outwards = corners.mean(axis=1) - mesh.vertices_W.mean(axis=0)
    assert np.all(np.sum(winding * outwards, axis=1) > 0)
    assert np.all(np.sum(winding * mesh.normals_W[mesh.triangles[:, 0]], axis=1) > 0)


def test_every_named_world_can_be_set():
    assert [SimSettings(world=name).world for name in NAMES] == NAMES
