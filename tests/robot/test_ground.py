"""Levelling on a soft skin: the loads balance the weight, and the plane is the one under the body."""

import numpy as np
import pytest

from snakeslam.gaits.catalogue import GAITS, GaitSettings, resolve
from snakeslam.gaits.posture import posed_angles
from snakeslam.geometry import so3
from snakeslam.robot.ground import GRAVITY_M_S2, level
from snakeslam.robot.kinematics import link_poses_from_imu
from snakeslam.robot.model import PRESETS

MODEL = PRESETS["sim35"]
UP = np.array([0.0, 0.0, 1.0])
WEIGHT_N = float(MODEL.link_masses_kg.sum()) * GRAVITY_M_S2


def _ground(q_rad, R_WI=None, up_I=UP):
    T_WI = np.eye(4)
    T_WI[:3, :3] = np.eye(3) if R_WI is None else R_WI
    return level(MODEL, link_poses_from_imu(MODEL, q_rad, T_WI), up_I), link_poses_from_imu(MODEL, q_rad, T_WI)


def test_a_straight_body_rests_evenly_where_its_skin_is():
    ground, Ts_IL = _ground(np.zeros(35))
    np.testing.assert_allclose(ground.loads_n, WEIGHT_N / 72, rtol=1e-4)
    np.testing.assert_allclose(ground.normal_I, UP, atol=1e-9)
    np.testing.assert_allclose(ground.contacts_I[:, 2], Ts_IL[0, 2, 3] - MODEL.radius_m, atol=1e-9)


@pytest.mark.parametrize("name", list(GAITS))
def test_loads_balance_the_weight_and_its_moment_in_every_gait(name):
    gait = resolve(GaitSettings(name=name), MODEL)
    for phase in np.linspace(0.3, 6.0, 7):
        roll = phase if gait.rolls else 0.0
        q_rad = posed_angles(gait, MODEL, gait.start_sigma + phase)[0]
        up_I = so3.exp(np.array([-roll, 0.0, 0.0])) @ UP
        ground, Ts_IL = _ground(q_rad, up_I=up_I)
        com_I = np.mean(Ts_IL[:, :3, 3] + Ts_IL[:, :3, :3] @ MODEL.com_L, axis=0)
        assert ground.loads_n.min() >= 0.0
        assert ground.loads_n.sum() == pytest.approx(WEIGHT_N, rel=0.01)
        moment = np.cross(ground.contacts_I - com_I, ground.loads_n[:, None] * ground.normal_I).sum(axis=0)
        assert np.linalg.norm(moment) < 0.02 * WEIGHT_N


def test_the_answer_turns_with_the_body():
    gait = resolve(GaitSettings(name="sidewinding"), MODEL)
    q_rad = posed_angles(gait, MODEL, 1.0)[0]
    plain, _ = _ground(q_rad)
    R = so3.exp(np.array([0.4, -1.1, 2.0]))
    turned, _ = _ground(q_rad, R, R @ UP)
    np.testing.assert_allclose(turned.loads_n, plain.loads_n, atol=1e-3)
    np.testing.assert_allclose(turned.normal_I, R @ plain.normal_I, atol=1e-5)


def test_a_wrong_guess_of_up_is_put_right_where_the_body_is_spread():
    gait = resolve(GaitSettings(name="serpentine", alpha_pi=0.5), MODEL)
    q_rad = posed_angles(gait, MODEL, 1.0)[0]
    tilted = so3.exp(np.array([0.0, np.deg2rad(3.0), 0.0])) @ UP
    plain, _ = _ground(q_rad)
    guessed, _ = _ground(q_rad, up_I=tilted)
    assert np.rad2deg(np.arccos(guessed.normal_I @ plain.normal_I)) < 0.3
