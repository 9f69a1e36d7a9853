"""The two presets, their frames and their URDF."""

import numpy as np
import pybullet
import pytest
from pydantic import ValidationError

from snakeslam.geometry import se3
from snakeslam.robot import kinematics
from snakeslam.robot.model import PRESETS, RobotSettings, snake_model

MODELS = [pytest.param(model, id=name) for name, model in PRESETS.items()]


def test_the_presets_are_the_papers_robots():
    sim, prototype = PRESETS["sim35"], PRESETS["orthogonal24"]
    assert (sim.joint_count, sim.joint_length_m) == (35, 0.08995)
    assert (prototype.joint_count, prototype.joint_length_m, 2 * prototype.radius_m) == (24, 0.096, 0.064)


def test_the_settings_choose_model_and_posture():
    model = snake_model(RobotSettings(model="orthogonal24", head_posture="flat"))
    assert (model.name, model.head_posture) == ("orthogonal24", "flat")
    np.testing.assert_array_equal(model.rest_q_rad, np.zeros(24))
    with pytest.raises(ValidationError):
        RobotSettings(model="sim36")


@pytest.mark.parametrize("model", MODELS)
def test_the_raised_head_is_level_and_carries_the_camera_at_a_hand_above_ground(model):
    T_W_base = se3.from_rt(np.eye(3), np.array([0.0, 0.0, model.radius_m]))
    T_WH = kinematics.link_poses(model, model.rest_q_rad, T_W_base)[-1]
    np.testing.assert_allclose(T_WH[:3, :3], np.eye(3), atol=1e-12)
    assert 0.095 <= (T_WH @ model.T_HC)[2, 3] <= 0.106
    assert [model.is_yaw[joint] for joint in model.head_raise_joints] == [False, True, False]


@pytest.mark.parametrize("model", MODELS)
def test_the_camera_looks_forward_and_its_picture_is_upright(model):
    T_HC = model.T_HC
    np.testing.assert_allclose(T_HC[:3, 2], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(T_HC[:3, 1], [0, 0, -1], atol=1e-12)
    assert np.linalg.det(T_HC[:3, :3]) == pytest.approx(1.0)
    np.testing.assert_allclose(T_HC @ model.T_CI, model.T_HI, atol=1e-12)


@pytest.mark.parametrize("model", MODELS)
def test_pybullet_reads_the_same_masses_inertias_and_limits(model, tmp_path):
    path = tmp_path / "snake.urdf"
    path.write_text(model.urdf())
    client = pybullet.connect(pybullet.DIRECT)
    try:
        body = pybullet.loadURDF(str(path), flags=pybullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)
        assert pybullet.getNumJoints(body, physicsClientId=client) == model.joint_count
        for link in range(-1, model.joint_count):
            info = pybullet.getDynamicsInfo(body, link, physicsClientId=client)
            assert info[0] == pytest.approx(model.link_masses_kg[link + 1])
            np.testing.assert_allclose(info[2], np.diag(model.inertia_L), rtol=1e-9)
            np.testing.assert_allclose(info[3], model.com_L, atol=1e-9)
        for joint in range(model.joint_count):
            info = pybullet.getJointInfo(body, joint, physicsClientId=client)
            assert info[1] == f"joint_{joint + 1}".encode()
            np.testing.assert_allclose(info[13], model.axes_L[joint])
            assert info[9] == pytest.approx(model.limits.position_rad)
            assert (info[10], info[11]) == (model.torque_nm, model.limits.rate_rad_s)
    finally:
        pybullet.disconnect(client)
