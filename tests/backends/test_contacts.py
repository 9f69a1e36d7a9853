"""The floor under the skin: where it is touched, what it bears, which skins it refuses."""

from dataclasses import replace

import numpy as np
import pytest

from snakeslam.backends.sim.contacts import Floor, on_links
from snakeslam.backends.sim.physics import SnakePhysics, lying_pose
from snakeslam.backends.sim.settings import PhysicsSettings
from snakeslam.errors import InputError
from snakeslam.geometry import so3
from snakeslam.robot.model import PRESETS

ONE = replace(PRESETS["sim35"], head_posture="flat", joint_count=0)
SETTINGS = PhysicsSettings()
ROTATION = so3.exp(np.array([0.3, -0.4, 1.1]))


def _touch(height_m, R_WL=None, twist_W=(0, 0, 0, 0, 0, 0), settings=SETTINGS):
    R_WL = np.eye(3) if R_WL is None else R_WL
    quat_xyzw = np.roll(so3.quat_wxyz_from_matrix(R_WL), -1)[None]
    com_W = np.array([[0.5, -0.2, height_m]])
    return com_W[0], Floor(ONE, settings).contacts(com_W, quat_xyzw, np.array([twist_W], dtype=np.float64))


def test_a_link_in_the_air_touches_nothing():
    _, contacts = _touch(ONE.radius_m + 1e-6)
    assert len(contacts.link) == len(contacts.point_W) == len(contacts.load_n) == len(contacts.normal_W) == 0


def test_a_spring_bears_it_at_the_lowest_point_of_each_sphere():
    com_W, contacts = _touch(ONE.radius_m - 0.001)
    np.testing.assert_allclose(contacts.load_n, 2000.0 * 0.001)
    np.testing.assert_array_equal(contacts.normal_W, [[0, 0, 1]] * 2)
    along = (ONE.sphere_centres_L - ONE.com_L)[:, 0]
    expected = np.column_stack([com_W[0] + along, [com_W[1]] * 2, [-0.001] * 2])
    np.testing.assert_allclose(contacts.point_W, expected, atol=1e-15)


def test_a_tilted_link_touches_where_its_spheres_are_lowest():
    com_W, contacts = _touch(0.01, ROTATION)
    lowest_W = com_W + (ONE.sphere_centres_L - ONE.com_L) @ ROTATION.T - [0, 0, ONE.radius_m]
    np.testing.assert_allclose(contacts.point_W, lowest_W[lowest_W[:, 2] < 0], atol=1e-12)


def test_a_damper_brakes_what_sinks_and_never_pulls_back():
    twist_W = np.array([0.1, 0.2, -0.02, 0.3, -0.4, 0.5])
    com_W, contacts = _touch(ONE.radius_m - 0.002, twist_W=twist_W)
    velocity_W = twist_W[:3] + np.cross(twist_W[3:], contacts.point_W - com_W)
    np.testing.assert_allclose(contacts.load_n, 2000.0 * 0.002 - 30.0 * velocity_W[:, 2], rtol=1e-12)
    _, leaving = _touch(ONE.radius_m - 0.002, twist_W=(0, 0, 1.0, 0, 0, 0))
    np.testing.assert_array_equal(leaving.load_n, 0.0)


def test_velocities_and_axes_of_points_on_links():
    twist_W = np.array([[0.1, 0.2, -0.02, 0.3, -0.4, 0.5]])
    quat_xyzw = np.roll(so3.quat_wxyz_from_matrix(ROTATION), -1)[None]
    point_W, com_W = np.array([[0.1, 0.2, 0.3]]), np.array([[0.0, 0.1, -0.1]])
    velocity_W, along_W = on_links(np.array([0]), point_W, twist_W, com_W, quat_xyzw)
    np.testing.assert_allclose(velocity_W[0], twist_W[0, :3] + np.cross(twist_W[0, 3:], point_W[0] - com_W[0]))
    np.testing.assert_allclose(along_W[0], ROTATION[:, 0], atol=1e-12)


@pytest.mark.parametrize("skin", [{"contact_damping_n_s_m": 90.0}, {"contact_stiffness_n_m": 60000.0}])
def test_a_skin_too_hard_for_the_step_is_refused_and_a_shorter_step_bears_it(skin):
    with pytest.raises(InputError, match=r"sim\.physics\.contact_damping_n_s_m: .* throws a robot .* dt is 1 / 400 s"):
        SnakePhysics(PRESETS["sim35"], PhysicsSettings(**skin))
    physics = SnakePhysics(
        PRESETS["sim35"], PhysicsSettings(rate_hz=1600, **skin), T_W_base=lying_pose(PRESETS["sim35"])
    )
    try:
        for _ in range(800):
            physics.step()
        assert np.linalg.norm(physics.head_state()[1]) < 1e-3
    finally:
        physics.close()
