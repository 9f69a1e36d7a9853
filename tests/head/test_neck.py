"""Where the neck is, how far it bends, and which necks are refused."""

from dataclasses import replace

import numpy as np
import pytest

from snakeslam.config import Config
from snakeslam.control import Control
from snakeslam.errors import InputError
from snakeslam.gaits.catalogue import GAITS, GaitSettings, resolve
from snakeslam.head.laws import HeadShape, check, effect, feeds_back, largest_neck_angle, settled
from snakeslam.head.neck import free_yaw_joints, neck_of
from snakeslam.head.settings import HeadSettings
from snakeslam.robot.model import PRESETS
from tests.head.plane import FLAT

RAISED = PRESETS["sim35"]


def serpentine(alpha_pi, model=FLAT):
    return resolve(GaitSettings(alpha_pi=alpha_pi), model)


def test_a_flat_neck_ends_with_the_last_joint_a_raised_one_before_the_frozen():
    flat, raised = neck_of(FLAT, 4), neck_of(RAISED, 4)
    np.testing.assert_array_equal(flat.joints, [28, 30, 32, 34])
    np.testing.assert_array_equal(raised.joints, [26, 28, 30, 34])
    l0 = FLAT.joint_length_m
    np.testing.assert_allclose(flat.sections_m, np.array([28, 30, 32, 34, 36]) * l0)
    np.testing.assert_allclose(raised.sections_m, np.array([26, 28, 30, 33, 36]) * l0)
    assert flat.length_m == pytest.approx(8 * l0)
    assert 32 in free_yaw_joints(FLAT)
    assert 32 not in free_yaw_joints(RAISED)


@pytest.mark.parametrize(("joints", "degrees"), [(4, (45, 71, 92)), (5, (34, 55, 72)), (6, (28, 45, 60))], ids=str)
def test_the_largest_neck_angle_is_that_of_the_derivation(joints, degrees):
    angles = [
        np.rad2deg(largest_neck_angle("position", serpentine(alpha_pi), FLAT, neck_of(FLAT, joints)))
        for alpha_pi in (0.3, 0.5, 0.7)
    ]
    np.testing.assert_allclose(angles, degrees, atol=0.6)


@pytest.mark.parametrize(("joints", "alpha_pi"), [(2, 0.3), (2, 0.5), (2, 0.7), (3, 0.5), (3, 0.7)])
@pytest.mark.parametrize("controller", ["position", "predictive"])
def test_a_neck_that_would_bend_too_far_is_refused_in_one_line(joints, alpha_pi, controller):
    settings = HeadSettings(controller=controller, neck_joints=joints)
    with pytest.raises(InputError, match=rf"head.neck_joints: {joints} yaw joints would bend \d+ deg") as caught:
        check(settings, FLAT, serpentine(alpha_pi))
    assert "\n" not in str(caught.value)
    check(settings.model_copy(update={"controller": "none"}), FLAT, serpentine(alpha_pi))


@pytest.mark.parametrize("alpha_pi", [0.1, 0.3, 0.5, 0.7])
@pytest.mark.parametrize("joints", [4, 5, 6])
def test_the_recommended_necks_are_within_the_limits(joints, alpha_pi):
    check(HeadSettings(controller="position", neck_joints=joints), FLAT, serpentine(alpha_pi))


@pytest.mark.parametrize("count", [0, 13])
def test_a_neck_that_the_body_does_not_have_is_refused(count):
    with pytest.raises(InputError, match=r"head.neck_joints.*allowed: 1 to"):
        neck_of(FLAT, count)


def test_no_controller_touches_another_gait_or_the_body():
    neck = neck_of(FLAT, 6)
    body = np.setdiff1d(np.arange(FLAT.joint_count), neck.joints)
    for controller in ("direction", "position", "predictive"):
        shape, plain = (HeadShape(one, FLAT, neck) for one in (controller, "none"))
        for name in ("sidewinding", "arc_rolling", "helix_rolling", "pedal"):
            gait = resolve(GaitSettings(name=name), FLAT)
            np.testing.assert_array_equal(shape(gait, 0.7), plain(gait, 0.7))
        held, winding = (one(serpentine(0.3), 0.7)[0] for one in (shape, plain))
        np.testing.assert_array_equal(held[body], winding[body])
        assert np.max(np.abs(held - winding)) > 0.05


def test_a_turn_bends_the_neck_as_well():
    turned, straight = (resolve(GaitSettings(alpha_pi=0.3), FLAT, turn) for turn in (0.5, 0.0))
    neck = neck_of(FLAT, 6)
    shape = HeadShape("position", FLAT, neck)
    bent = shape(turned, 1.0)[0] - shape(straight, 1.0)[0]
    np.testing.assert_allclose(bent[FLAT.is_yaw], turned.shape.beta_o, atol=1e-9)


def test_a_raised_neck_keeps_its_posture():
    shape = HeadShape("position", RAISED, neck_of(RAISED, 6))
    q_rad, slope = shape(serpentine(0.5, RAISED), 0.9)
    joints = list(RAISED.head_raise_joints)
    np.testing.assert_array_equal(q_rad[joints], RAISED.rest_q_rad[joints])
    np.testing.assert_array_equal(slope[joints], 0.0)
    assert replace(RAISED, head_posture="flat") == FLAT


@pytest.mark.parametrize("model", PRESETS)
@pytest.mark.parametrize("gait", GAITS)
def test_the_default_head_control_is_predictive_and_no_gait_refuses_it(model, gait):
    """A gait that has no predictive control plays as without it, and the page says so."""
    config, robot = Config(), PRESETS[model]
    assert config.head.controller == "predictive"
    control = Control(robot, GaitSettings(name=gait), config.head)
    assert control.head.controller == "predictive"
    resolved = resolve(GaitSettings(name=gait), robot)
    assert feeds_back("predictive", resolved) == (gait != "arc_rolling")
    assert effect("predictive", resolved).startswith("No effect") == (gait == "arc_rolling")


def test_a_neck_whose_length_is_left_open_is_long_enough_for_the_gait():
    """The short robot in long waves: four joints, its usual neck, would have to bend by 101 degrees."""
    short = PRESETS["orthogonal24"]
    wide = resolve(GaitSettings(alpha_pi=0.5, wavelength_joints=40), short)
    with pytest.raises(InputError, match="4 yaw joints would bend 101 deg"):
        settled(HeadSettings(neck_joints=4), short, wide)
    count = settled(HeadSettings(), short, wide).neck_joints
    assert count is not None
    assert count > 4
    check(HeadSettings(neck_joints=count), short, wide)
    assert settled(HeadSettings(), short, resolve(GaitSettings(), short)).neck_joints == 4
