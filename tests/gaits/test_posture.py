"""The raised head over a gait, on level ground by forward kinematics."""

from dataclasses import replace

import numpy as np
import pytest

from snakeslam.gaits.catalogue import GAITS, GaitSettings, resolve
from snakeslam.gaits.parametric import joint_angles
from snakeslam.gaits.posture import posed_angles
from snakeslam.geometry import se3, so3
from snakeslam.robot import kinematics
from snakeslam.robot.model import PRESETS

MODELS = [pytest.param(model, id=name) for name, model in PRESETS.items()]


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("name", list(GAITS))
def test_slopes_are_the_derivative_of_the_angles(model, name):
    gait, h = resolve(GaitSettings(name=name), model), 1e-6
    for sigma in (0.3, 2.0, 5.0):
        numeric = (posed_angles(gait, model, sigma + h)[0] - posed_angles(gait, model, sigma - h)[0]) / (2 * h)
        np.testing.assert_allclose(posed_angles(gait, model, sigma)[1], numeric, atol=1e-8)


@pytest.mark.parametrize("model", MODELS)
def test_a_serpentine_head_stays_level_and_high_at_every_phase(model):
    gait = resolve(GaitSettings(), model)
    for sigma in np.linspace(0, 2 * np.pi, 9):
        q_rad, _ = posed_angles(gait, model, sigma)
        T_WH = kinematics.link_poses(model, q_rad, np.eye(4))[-1]
        np.testing.assert_allclose(T_WH[2, :3], [0, 0, 1], atol=1e-12)
        assert T_WH[2, 3] == pytest.approx(2 * model.joint_length_m * np.sin(np.deg2rad(22)))


@pytest.mark.parametrize("model", MODELS)
def test_a_rolling_body_keeps_its_head_up_while_the_head_turns_about_its_axis(model):
    gait = resolve(GaitSettings(name="arc_rolling"), model)
    for roll in np.linspace(0, 2 * np.pi, 13):
        q_rad, _ = posed_angles(gait, model, gait.start_sigma + roll)
        T_W_base = se3.from_rt(so3.exp(np.array([roll, 0, 0])), np.zeros(3))
        Ts_WL = kinematics.link_poses(model, q_rad, T_W_base)
        body_W = Ts_WL[: model.head_raise_joints[0] - 1, :3, 3]
        _, spread, axes = np.linalg.svd(body_W - body_W.mean(axis=0))
        up_W = axes[2] * np.sign(axes[2, 2])
        assert spread[2] < 0.02
        assert up_W @ [0, 0, 1] > 0.99
        height = up_W @ (Ts_WL[-1, :3, 3] - body_W.mean(axis=0))
        assert height == pytest.approx(2 * model.joint_length_m * np.sin(np.deg2rad(22)), abs=0.01)
        assert abs(np.rad2deg(np.arcsin(up_W @ Ts_WL[-1, :3, 0]))) < 5.0


def test_flat_heads_and_rolling_helices_play_the_plain_gait():
    raised = PRESETS["sim35"]
    flat = replace(raised, head_posture="flat")
    for model, name in ((flat, "serpentine"), (flat, "arc_rolling"), (raised, "helix_rolling")):
        gait = resolve(GaitSettings(name=name), model)
        np.testing.assert_array_equal(posed_angles(gait, model, 1.0)[0], joint_angles(gait.shape, 35, 1.0))
