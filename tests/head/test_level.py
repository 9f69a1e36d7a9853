"""Beyond the plane: the head kept level and looking ahead, and what that rests on."""

import numpy as np

from snakeslam.backends.sim.physics import SnakePhysics, pose_with_head_at
from snakeslam.backends.sim.settings import PhysicsSettings
from snakeslam.control import Control
from snakeslam.gaits.catalogue import GaitSettings
from snakeslam.geometry import so3
from snakeslam.head.attitude import HeadAttitude
from snakeslam.head.level import PhaseSeries
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import GaitCommand, Health, ImuSample, JointState, PoseEstimate, Verdict
from snakeslam.robot.model import PRESETS

MODEL = PRESETS["sim35"]
STEP_NS = 10_000_000
PERIOD_S = 3.0


def _attitudes(gait, controller):
    """The head's attitude over the third period, fed back 50 to 100 ms late with a gyro."""
    physics = SnakePhysics(MODEL, PhysicsSettings(), 3.0, pose_with_head_at(MODEL, 0.0, 0.0))
    control = Control(MODEL, GaitSettings(name=gait, period_s=PERIOD_S), HeadSettings(controller=controller))
    control.command(GaitCommand(0, gait))
    poses, imu, R_WI = [], None, []
    for k in range(round(3 * PERIOD_S * 100)):
        t_ns = k * STEP_NS
        q_rad, dq_rad_s, torque = physics.joint_state()
        pose = poses[-2] if len(poses) > 1 else None
        target = control.step(t_ns, JointState(t_ns, q_rad, dq_rad_s, torque, torque), pose, imu)
        physics.set_target(target.q_rad)
        for _ in range(4):
            physics.step()
        T_WI, v_W, w_I = physics.head_state()
        imu = ImuSample(t_ns + STEP_NS, w_I, np.zeros(3))
        if k % 5 == 0:
            poses.append(PoseEstimate(t_ns + STEP_NS, T_WI, v_W, np.eye(9), Health(Verdict.GOOD)))
        if k * 0.01 >= 2 * PERIOD_S:
            R_WI.append(T_WI[:3, :3])
    physics.close()
    return np.array(R_WI)


def _rms_deg(R_WI):
    """RMS of yaw about its mean, pitch and roll."""
    yaw = np.unwrap(so3.yaw(R_WI))
    pitch, roll = -np.arcsin(R_WI[:, 2, 0]), np.arctan2(R_WI[:, 2, 1], R_WI[:, 2, 2])
    return np.rad2deg([np.std(yaw), np.sqrt(np.mean(pitch**2)), np.sqrt(np.mean(roll**2))])


def test_a_sidewinding_head_is_much_stiller_than_without():
    without, level = (_rms_deg(_attitudes("sidewinding", controller)) for controller in ("none", "predictive"))
    assert level[0] < 0.35 * without[0]
    assert level[1] < 0.6 * without[1]
    assert level[2] < without[2]


def test_a_series_learns_what_repeats_and_foretells_it():
    series, rng = PhaseSeries(), np.random.default_rng(0)

    def seen(sigma):
        return np.array([0.3 + np.cos(sigma), 0.5 * np.sin(2 * sigma), 0.2 * np.cos(3 * sigma + 1)])

    for sigma in np.arange(0, 4 * np.pi, 0.0157):
        series.learn(sigma, seen(sigma) + 0.01 * rng.standard_normal(3))
    for sigma in np.linspace(0, 6, 20):
        np.testing.assert_allclose(series.at(sigma), seen(sigma), atol=0.02)


def test_the_attitude_is_the_estimates_carried_on_by_the_gyro():
    attitude, w_I = HeadAttitude(), np.array([0.3, -0.5, 0.8])

    def true(k):
        return so3.exp(np.array([0.1, 0.2, -0.3])) @ so3.exp(w_I * k * 0.01)

    for k in range(100):
        pose = None
        if k >= 20 and k % 5 == 0:
            T_WI = np.eye(4)
            T_WI[:3, :3] = true(k - 12)
            pose = PoseEstimate((k - 12) * STEP_NS, T_WI, np.zeros(3), np.eye(9), Health(Verdict.GOOD))
        attitude.update(k * STEP_NS, pose, ImuSample(k * STEP_NS, w_I, np.zeros(3)))
    np.testing.assert_allclose(attitude.R_WI, true(99), atol=1e-9)


def test_without_an_estimate_it_is_the_turn_since_the_start():
    attitude = HeadAttitude()
    np.testing.assert_array_equal(attitude.R_WI, np.eye(3))
    for k in range(11):
        attitude.update(k * STEP_NS, None, ImuSample(k * STEP_NS, np.array([0.0, 0.0, 1.0]), np.zeros(3)))
    np.testing.assert_allclose(attitude.R_WI, so3.from_yaw(0.1), atol=1e-9)
