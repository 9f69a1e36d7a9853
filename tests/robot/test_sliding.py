"""The head's velocity from joint motion and Coulomb friction, against the simulator, and what it rests on."""

import numpy as np
import pytest

from snakeslam.backends.sim.physics import SnakePhysics, pose_with_head_at
from snakeslam.backends.sim.settings import PhysicsSettings
from snakeslam.control import Control
from snakeslam.gaits.catalogue import GaitSettings
from snakeslam.geometry import se3
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import GaitCommand
from snakeslam.robot.friction import contact_velocities, sliding_velocity
from snakeslam.robot.kinematics import link_poses_from_imu
from snakeslam.robot.model import PRESETS

MODEL = PRESETS["sim35"]
PERIOD_S = 2.5


def _crawl(gait, ratio):
    """Joints, rates and the head's true motion over the second period, at 20 Hz."""
    physics = SnakePhysics(MODEL, PhysicsSettings(), ratio, pose_with_head_at(MODEL, 0.0, 0.0))
    control = Control(MODEL, GaitSettings(name=gait, period_s=PERIOD_S), HeadSettings(controller="none"))
    control.command(GaitCommand(0, gait))
    seen = []
    for k in range(round(2 * PERIOD_S * 100)):
        physics.set_target(control.step(k * 10_000_000, None, None, None).q_rad)
        for _ in range(4):
            physics.step()
        if k * 0.01 >= PERIOD_S and k % 5 == 0:
            seen.append((*physics.joint_state()[:2], *physics.head_state()))
    physics.close()
    return seen


@pytest.mark.parametrize(
    ("gait", "ratio", "bound_m_s"),
    [
        ("serpentine", 10.0, 0.06),
        ("sidewinding", 3.0, 0.04),
        ("arc_rolling", 3.0, 0.015),
        ("helix_rolling", 3.0, 0.015),
    ],
)
def test_the_velocity_is_the_simulators(gait, ratio, bound_m_s):
    errors, speeds, guess = [], [], None
    for q_rad, dq_rad_s, T_WI, v_W, w_I in _crawl(gait, ratio):
        found = sliding_velocity(MODEL, q_rad, dq_rad_s, w_I, T_WI[2, :3], ratio, guess)
        guess = found.v_I
        errors.append(found.v_I - T_WI[:3, :3].T @ v_W)
        speeds.append(v_W)
        assert np.linalg.eigvalsh(found.cov)[0] >= 0.005**2 - 1e-12
    error, speed = (float(np.sqrt(np.mean(np.sum(np.square(x), axis=1)))) for x in (errors, speeds))
    assert error < bound_m_s
    assert error < 0.35 * speed


def test_contact_velocities_are_those_of_the_kinematics():
    rng = np.random.default_rng(2)
    q_rad, dq_rad_s, w_I = rng.uniform(-0.4, 0.4, 35), rng.uniform(-1.0, 1.0, 35), rng.uniform(-1.0, 1.0, 3)
    link, p_L = np.array([0, 7, 20, 35]), rng.uniform(-0.05, 0.05, (4, 3))
    h = 1e-6

    def points(t):
        T_WI = np.eye(4)
        T_WI[:3, :3] = np.eye(3) + t * np.array([[0, -w_I[2], w_I[1]], [w_I[2], 0, -w_I[0]], [-w_I[1], w_I[0], 0]])
        Ts = link_poses_from_imu(MODEL, q_rad + t * dq_rad_s, T_WI)
        return np.array([se3.act(Ts[k], p) for k, p in zip(link, p_L, strict=True)])

    Ts_IL = link_poses_from_imu(MODEL, q_rad, np.eye(4))
    found = contact_velocities(MODEL, Ts_IL, dq_rad_s, w_I, link, points(0.0))
    np.testing.assert_allclose(found, (points(h) - points(-h)) / (2 * h), atol=1e-6)


def test_joints_at_rest_say_that_the_head_is_at_rest():
    found = sliding_velocity(MODEL, MODEL.rest_q_rad, np.zeros(35), np.zeros(3), np.array([0.0, 0.0, 1.0]), 3.0)
    np.testing.assert_allclose(found.v_I, 0.0, atol=1e-9)
