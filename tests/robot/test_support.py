"""What the links of a body at rest bear."""

from dataclasses import replace

import numpy as np
import pytest

from snakeslam.robot.kinematics import link_poses
from snakeslam.robot.model import PRESETS
from snakeslam.robot.support import LEAST_SHARE, posture_loads

MODELS = [pytest.param(model, id=name) for name, model in PRESETS.items()]


@pytest.mark.parametrize("model", MODELS)
def test_a_flat_body_bears_its_weight_evenly(model):
    loads = posture_loads(replace(model, head_posture="flat"))
    np.testing.assert_allclose(loads, 1.0, atol=1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_the_loads_of_a_raised_head_are_the_weight_and_balance(model):
    """Up to the least share of the links in the air; the moment to a third of a link's length: spheres, not centres."""
    loads = posture_loads(model)
    in_air = np.count_nonzero(loads <= LEAST_SHARE)
    assert 2 <= in_air <= 8
    assert abs(np.sum(loads) - model.link_count) <= LEAST_SHARE * in_air + 1e-9
    x = link_poses(model, model.rest_q_rad, np.eye(4))[:, 0, 3] + model.joint_length_m / 2.0
    borne = np.where(loads > LEAST_SHARE, loads, 0.0)
    assert np.sum(borne * x) / np.sum(borne) == pytest.approx(np.mean(x), abs=model.joint_length_m / 3.0)


@pytest.mark.parametrize("model", MODELS)
def test_a_raised_head_rests_on_the_links_behind_it(model):
    loads = posture_loads(model)
    lower, _, _ = model.head_raise_joints
    heaviest = int(np.argmax(loads))
    assert lower - 6 <= heaviest <= lower
    assert loads[heaviest] > 1.5
    np.testing.assert_array_equal(loads[lower + 2 :], LEAST_SHARE)
    np.testing.assert_allclose(loads[:10], 1.0, atol=0.25)
