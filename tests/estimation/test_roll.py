"""The roll that control predicts reaches the front-end with the right sign and at the right time."""

import numpy as np
import pytest

from snakeslam.backends.sim.physics import SnakePhysics, pose_with_head_at
from snakeslam.backends.sim.settings import PhysicsSettings
from snakeslam.control import Control
from snakeslam.estimation.imaging.roll_prior import RollPrior, with_roll
from snakeslam.gaits.catalogue import GaitSettings
from snakeslam.geometry import so3
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import GaitCommand
from snakeslam.robot.model import PRESETS

STEP_NS = 10_000_000


def test_a_prior_interpolates_and_says_nothing_of_what_it_does_not_know():
    prior = RollPrior()
    assert prior.between(0, STEP_NS) is None
    for k in range(200):
        prior.add(k * STEP_NS, 0.02 * k)
    assert prior.between(150 * STEP_NS, 155 * STEP_NS + STEP_NS // 2) == pytest.approx(0.11)
    assert prior.between(20 * STEP_NS, 150 * STEP_NS) is None
    prior.add(200 * STEP_NS, None)
    assert prior.between(150 * STEP_NS, 155 * STEP_NS) is None


def test_only_the_rotation_about_the_optical_axis_is_replaced():
    rotation = so3.log(with_roll(so3.exp(np.array([0.02, -0.03, 0.5])), -0.1))
    np.testing.assert_allclose(rotation, [0.02, -0.03, -0.1], atol=1e-12)


def test_a_rolling_arc_rolls_its_camera_as_control_foresees():
    model = PRESETS["sim35"]
    physics = SnakePhysics(model, PhysicsSettings(), 3.0, pose_with_head_at(model, 0.0, 0.0))
    control = Control(model, GaitSettings(name="arc_rolling"), HeadSettings(controller="none"))
    prior, R_WC = RollPrior(), []
    control.command(GaitCommand(0, "arc_rolling"))
    for k in range(300):
        target = control.step(k * STEP_NS, None, None, None)
        prior.add(target.t_ns, target.head_roll_rad)
        physics.set_target(target.q_rad)
        for _ in range(4):
            physics.step()
        R_WC.append(physics.head_state()[0][:3, :3] @ model.T_CI[:3, :3].T)
    physics.close()
    foreseen = prior.between(250 * STEP_NS, 299 * STEP_NS)
    true = so3.log(R_WC[249].T @ R_WC[298])
    assert foreseen == pytest.approx(0.49 * np.pi / 2, rel=1e-6)
    assert true[2] == pytest.approx(foreseen, abs=0.08)
