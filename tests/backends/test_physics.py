"""The rigid bodies: rest, friction at any yaw, servos, states, determinism."""

from dataclasses import fields, replace

import numpy as np
import pybullet
import pytest
from numba import typeof

from snakeslam.backends.sim.contacts import obstacle_contacts
from snakeslam.backends.sim.physics import PhysicsSettings, SnakePhysics, lying_pose, pose_with_head_at
from snakeslam.errors import BackendError
from snakeslam.geometry import se3, so3
from snakeslam.robot import kinematics
from snakeslam.robot.model import PRESETS

MODEL = PRESETS["sim35"]
FLAT = replace(MODEL, head_posture="flat")
SHORT = replace(FLAT, joint_count=8)


@pytest.fixture
def make():
    made = []

    def build(model=SHORT, **kwargs):
        made.append(SnakePhysics(model, PhysicsSettings(), **kwargs))
        return made[-1]

    yield build
    for physics in made:
        physics.close()


def _steps(physics, seconds):
    for _ in range(round(seconds / physics.dt_s)):
        physics.step()


@pytest.mark.parametrize("model", [FLAT, MODEL], ids=["flat", "raised"])
def test_it_lies_still_and_the_ground_bears_its_weight(make, model):
    physics = make(model, T_W_base=lying_pose(model, 0.3, -0.2, 0.7))
    start, _, _ = physics.head_state()
    _steps(physics, 1.0)
    T_WI, v_W, w_I = physics.head_state()
    # The skin gives by a millimetre, more under the raised neck.
    assert np.linalg.norm(T_WI[:3, 3] - start[:3, 3]) < 0.007
    assert np.linalg.norm(v_W) < 1e-6
    assert np.linalg.norm(w_I) < 1e-6
    borne_n = physics.floor_contacts().load_n.sum()
    assert borne_n == pytest.approx(36 * model.link_mass_kg * 9.81, rel=1e-4)


@pytest.mark.parametrize("yaw_deg", [0, 30, 135])
@pytest.mark.parametrize(("direction", "mu"), [(0, 0.6 / 3.0), (1, 0.6)])
def test_a_sliding_body_slows_by_mu_g_along_and_across_itself_at_any_yaw(make, yaw_deg, direction, mu):
    yaw = np.deg2rad(yaw_deg)
    physics = make(T_W_base=lying_pose(SHORT, yaw_rad=yaw))
    _steps(physics, 0.2)
    way_W = so3.from_yaw(yaw)[:, direction]
    pybullet.resetBaseVelocity(physics.body_id, way_W.tolist(), [0, 0, 0], physicsClientId=physics.client_id)
    physics.step()
    before = physics.head_state()[1]
    # Across it also begins to roll, which ends its slipping at 2/3 of the speed.
    _steps(physics, 0.04)
    change = physics.head_state()[1] - before
    np.testing.assert_allclose(change, -way_W * mu * 9.81 * 0.04, atol=0.01)


def test_states_agree_with_kinematics_and_with_each_other(make):
    physics = make(MODEL, T_W_base=lying_pose(MODEL, yaw_rad=2.0))
    target = MODEL.rest_q_rad + 0.3 * np.sin(np.arange(35)) * MODEL.is_yaw
    physics.set_target(target)
    _steps(physics, 0.1)
    before, _, _ = physics.head_state()
    physics.step()
    T_WI, v_W, w_I = physics.head_state()
    q_rad, dq_rad_s, torque_nm = physics.joint_state()
    Ts_WL = physics.Ts_WL
    np.testing.assert_allclose(kinematics.link_poses(MODEL, q_rad, Ts_WL[0]), Ts_WL, atol=1e-5)
    np.testing.assert_allclose(Ts_WL[-1] @ MODEL.T_HI, T_WI, atol=1e-12)
    assert np.linalg.norm(v_W) > 0.02
    np.testing.assert_allclose((T_WI[:3, 3] - before[:3, 3]) / physics.dt_s, v_W, atol=2e-3)
    turned = so3.log(before[:3, :3].T @ T_WI[:3, :3]) / physics.dt_s
    np.testing.assert_allclose(turned, w_I, atol=0.02)
    base_v, base_w = pybullet.getBaseVelocity(physics.body_id, physicsClientId=physics.client_id)
    at_origin = np.array(base_v) - np.cross(base_w, Ts_WL[0, :3, :3] @ MODEL.com_L)
    twist = kinematics.imu_jacobian(MODEL, Ts_WL) @ np.concatenate([at_origin, base_w, dq_rad_s])
    np.testing.assert_allclose(twist, np.concatenate([v_W, T_WI[:3, :3] @ w_I]), atol=1e-3)
    assert np.max(np.abs(torque_nm)) <= MODEL.torque_nm


def test_servos_answer_with_their_lag_and_never_faster_than_they_can(make):
    physics = make()
    _steps(physics, 0.1)
    target = np.zeros(8)
    target[6] = 0.1
    physics.set_target(target)
    _steps(physics, 0.03)
    assert 0.04 < physics.joint_state()[0][6] < 0.075
    target[6] = 1.2
    physics.set_target(target)
    fastest = 0.0
    for _ in range(300):
        physics.step()
        fastest = max(fastest, np.max(np.abs(physics.joint_state()[1])))
    assert physics.joint_state()[0][6] == pytest.approx(1.2, abs=0.01)
    assert 4.0 < fastest <= 6.0 + 0.02


def test_a_command_beyond_the_joint_is_clipped(make):
    physics = make()
    physics.set_target(9.0 * np.eye(8)[6])
    _steps(physics, 1.0)
    assert physics.joint_state()[0][6] <= SHORT.limits.position_rad + 0.02


def test_the_same_start_gives_the_same_bytes(make):
    def play():
        physics = make(MODEL)
        for k in range(40):
            physics.set_target(MODEL.rest_q_rad + 0.2 * np.sin(0.1 * k + np.arange(35)) * MODEL.is_yaw)
            _steps(physics, 0.01)
        return physics.head_state()[0].tobytes()

    assert play() == play()


def test_it_starts_with_its_head_where_asked(make):
    physics = make(MODEL, T_W_base=pose_with_head_at(MODEL, 1.5, -2.0, np.pi / 2))
    T_WI, _, _ = physics.head_state()
    np.testing.assert_allclose(T_WI[:2, 3], [1.5, -2.0], atol=1e-5)
    np.testing.assert_allclose(T_WI[:3, 0], [0, 1, 0], atol=1e-5)


def _box(physics, halfs_m, centre_W):
    client = physics.client_id
    shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=halfs_m, physicsClientId=client)
    return pybullet.createMultiBody(0, shape, basePosition=centre_W, physicsClientId=client)


def test_a_wall_stops_it_and_the_friction_law_acts_there_too(make):
    physics = make(T_W_base=se3.from_rt(np.eye(3), np.array([0, 0, SHORT.radius_m])))
    wall = _box(physics, [0.05, 1, 0.2], [SHORT.length_m + 0.15, 0, 0.2])
    pybullet.resetBaseVelocity(physics.body_id, [0.8, 0, 0], [0, 0, 0], physicsClientId=physics.client_id)
    touched = False
    for _ in range(200):
        physics.step()
        touched |= bool(pybullet.getContactPoints(physics.body_id, wall, physicsClientId=physics.client_id))
    assert touched
    assert physics.head_state()[0][0, 3] < SHORT.length_m + 0.1 - SHORT.joint_length_m / 2 + 0.02


def test_an_obstacle_bears_it_as_the_floor_does(make):
    physics = make(T_W_base=se3.from_rt(np.eye(3), np.array([0, 0, 0.4 + SHORT.radius_m])))
    _box(physics, [1, 1, 0.2], [0, 0, 0.2])
    _steps(physics, 1.0)
    borne = obstacle_contacts(physics.body_id, physics.client_id)
    assert len(borne.load_n) > 4
    assert borne.load_n.sum() == pytest.approx(9 * SHORT.link_mass_kg * 9.81, rel=0.02)
    # Arrays of another form than the floor's would be compiled for, and stop a live robot for seconds.
    assert _forms(borne) == _forms(physics.floor_contacts())


def _forms(contacts):
    return [typeof(getattr(contacts, field.name)) for field in fields(contacts)]


def test_it_closes_twice():
    physics = SnakePhysics(SHORT, PhysicsSettings())
    physics.close()
    physics.close()
    with pytest.raises(BackendError, match="closed"):
        physics.step()
