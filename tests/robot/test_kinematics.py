"""Poses and Jacobians against PyBullet's own, which loads the model's URDF."""

import numpy as np
import pybullet
import pytest

from snakeslam.geometry import numeric, se3, so3
from snakeslam.robot import kinematics
from snakeslam.robot.model import PRESETS

MODELS = [pytest.param(model, id=name) for name, model in PRESETS.items()]


@pytest.fixture
def load(tmp_path):
    client = pybullet.connect(pybullet.DIRECT)

    def load_model(model):
        path = tmp_path / f"{model.name}.urdf"
        path.write_text(model.urdf())
        return client, pybullet.loadURDF(str(path), flags=pybullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)

    yield load_model
    pybullet.disconnect(client)


def _random_state(model, seed):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1.2, 1.2, model.joint_count), se3.from_rt(so3.exp(rng.normal(size=3)), rng.normal(size=3))


@pytest.mark.parametrize("model", MODELS)
def test_link_poses_agree_with_pybullet(model, load):
    client, body = load(model)
    q_rad, T_W_base = _random_state(model, 3)
    quat = so3.quat_wxyz_from_matrix(T_W_base[:3, :3])
    pybullet.resetBasePositionAndOrientation(
        body, se3.act(T_W_base, model.com_L).tolist(), np.roll(quat, -1).tolist(), physicsClientId=client
    )
    for index, angle in enumerate(q_rad):
        pybullet.resetJointState(body, index, angle, physicsClientId=client)
    states = pybullet.getLinkStates(body, range(model.joint_count), computeForwardKinematics=1, physicsClientId=client)
    positions_W = np.array([state[4] for state in states])
    quats_wxyz = np.roll([state[5] for state in states], 1, axis=-1)
    Ts_WL = kinematics.link_poses(model, q_rad, T_W_base)
    np.testing.assert_allclose(Ts_WL[0], T_W_base, atol=1e-12)
    np.testing.assert_allclose(Ts_WL[1:, :3, 3], positions_W, atol=1e-6)
    np.testing.assert_allclose(Ts_WL[1:, :3, :3], so3.matrix_from_quat_wxyz(quats_wxyz), atol=1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_jacobians_agree_with_pybullet(model, load):
    """PyBullet's are in the frame of the base's centre of mass, base columns (angular, linear) first.

    Its point is relative to the link's frame (the joint), whatever its guide says of centres of mass.
    """
    client, body = load(model)
    q_rad, _ = _random_state(model, 5)
    still = [0.0] * model.joint_count
    T_base = se3.from_rt(np.eye(3), -model.com_L)
    Ts = kinematics.link_poses(model, q_rad, T_base)
    about_com = np.eye(6 + model.joint_count)
    about_com[:3, 3:6] = so3.hat(model.com_L)
    for link in (1, model.joint_count // 2, model.joint_count):
        offset = np.array([0.01, -0.02, 0.03])
        expected = np.vstack(
            pybullet.calculateJacobian(
                body, link - 1, offset.tolist(), q_rad.tolist(), still, still, physicsClientId=client
            )
        )
        ours = kinematics.link_jacobian(model, Ts, link, offset) @ about_com
        np.testing.assert_allclose(ours[:, 6:], expected[:, 6:], atol=1e-6)
        np.testing.assert_allclose(ours[:, [3, 4, 5, 0, 1, 2]], expected[:, :6], atol=1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_imu_jacobian_agrees_with_finite_differences(model):
    q_rad, T_W_base = _random_state(model, 7)
    Ts_WL = kinematics.link_poses(model, q_rad, T_W_base)
    R_WI = (Ts_WL[-1] @ model.T_HI)[:3, :3]

    def moved(d):
        T = se3.from_rt(so3.exp(d[3:6]) @ T_W_base[:3, :3], T_W_base[:3, 3] + d[:3])
        T_WI = kinematics.link_poses(model, q_rad + d[6:], T)[-1] @ model.T_HI
        return np.concatenate([T_WI[:3, 3], so3.log(T_WI[:3, :3] @ R_WI.T)])

    expected = numeric.jacobian(moved, 6 + model.joint_count)
    np.testing.assert_allclose(kinematics.imu_jacobian(model, Ts_WL), expected, atol=1e-7)


@pytest.mark.parametrize("model", MODELS)
def test_poses_from_the_imu_are_those_from_the_tail_and_batches_agree(model):
    rng = np.random.default_rng(11)
    q_rad = rng.uniform(-1, 1, (4, model.joint_count))
    Ts_W_base = se3.exp(rng.normal(size=(4, 6)))
    Ts_WL = kinematics.link_poses(model, q_rad, Ts_W_base)
    assert Ts_WL.shape == (4, model.link_count, 4, 4)
    np.testing.assert_allclose(
        kinematics.link_poses_from_imu(model, q_rad, Ts_WL[:, -1] @ model.T_HI), Ts_WL, atol=1e-12
    )
    np.testing.assert_allclose(kinematics.link_poses(model, q_rad[2], Ts_W_base[2]), Ts_WL[2], atol=1e-14)


def test_positive_pitch_lifts_the_front_and_positive_yaw_turns_it_left():
    model = PRESETS["sim35"]
    for index, axis in ((1, 2), (0, 1)):
        q_rad = np.zeros(model.joint_count)
        q_rad[index] = 0.1
        assert kinematics.link_poses(model, q_rad, np.eye(4))[-1, axis, 3] > 0.1
