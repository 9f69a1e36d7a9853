"""Start, stop, drive, turn and changes of gait without a step, over random sequences of commands."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from snakeslam.gaits.blend import GaitBlend, PlainShape
from snakeslam.gaits.catalogue import GAITS, GaitSettings, resolve
from snakeslam.gaits.posture import posed_angles
from snakeslam.head.laws import HeadShape
from snakeslam.head.neck import neck_of
from snakeslam.robot.model import PRESETS

DT_S = 0.01
MODEL = PRESETS["sim35"]
DEEPEST = GaitSettings(alpha_pi=0.7, period_s=2.5)

command = st.tuples(
    st.one_of(
        st.just(DEEPEST),
        st.builds(
            GaitSettings,
            name=st.sampled_from(list(GAITS)),
            period_s=st.floats(2, 8),
            wavelength_joints=st.floats(14, 30),
        ),
    ),
    st.floats(-1, 1),
    st.sampled_from([-1.0, 0.0, 0.4, 1.0]),
    st.integers(1, 200),
)


def _play(commands, model=MODEL):
    blend = GaitBlend(model, resolve(GaitSettings(), model), model.rest_q_rad)
    angles = [model.rest_q_rad, model.rest_q_rad]
    for gait, turn, drive, steps in commands:
        blend.set_gait(resolve(gait, model, turn))
        angles += [blend.step(drive, DT_S) for _ in range(steps)]
    return np.array(angles), blend


@settings(max_examples=60, deadline=None)
@given(st.lists(command, min_size=1, max_size=8))
def test_no_sequence_of_commands_plans_a_step_or_more_than_the_joints_can(commands):
    """Changes on changes may plan a few per cent more, which the follower takes off."""
    angles, _ = _play(commands)
    rates = np.diff(angles, axis=0) / DT_S
    assert np.max(np.abs(rates)) < 1.1 * MODEL.limits.rate_rad_s
    assert np.max(np.abs(np.diff(rates, axis=0))) / DT_S < 1.1 * MODEL.limits.acceleration_rad_s2


def test_without_drive_nothing_moves_whatever_is_chosen():
    angles, blend = _play([(GaitSettings(name=name), 1.0, 0.0, 50) for name in GAITS])
    np.testing.assert_allclose(angles, np.broadcast_to(MODEL.rest_q_rad, angles.shape), atol=1e-12)
    assert blend.pace == 0.0


def test_a_stop_holds_within_half_a_second_even_amid_a_change():
    angles, _ = _play(
        [(GaitSettings(), 0.0, 1.0, 300), (GaitSettings(name="sidewinding"), 0, 1, 30), (GaitSettings(), 0, 0, 90)]
    )
    assert np.max(np.abs(np.diff(angles[-120:-90], axis=0))) > 1e-3
    np.testing.assert_array_equal(angles[-39:], np.broadcast_to(angles[-1], (39, 35)))


def test_a_change_settles_on_the_gait_itself():
    angles, blend = _play([(DEEPEST, 0.0, 1.0, 200), (GaitSettings(name="pedal"), 0.5, 1.0, 500)])
    assert blend.gait.name == "pedal"
    np.testing.assert_allclose(angles[-1], posed_angles(blend.gait, MODEL, blend.sigma)[0], atol=1e-3)


@pytest.mark.parametrize("drive", [1.0, -1.0])
def test_a_rolling_body_comes_upright_before_another_gait(drive):
    _, blend = _play([(GaitSettings(name="arc_rolling"), 0.0, drive, 500)])
    assert not np.isclose(np.sin(blend.sigma), 1.0, atol=0.05)
    blend.set_gait(resolve(GaitSettings(), MODEL))
    sigma = blend.sigma
    while blend.gait.name == "arc_rolling":
        assert abs(blend.sigma - sigma) <= 2 * np.pi + 0.05
        rolled = blend.sigma
        blend.step(drive, DT_S)
    assert np.sin(rolled) == pytest.approx(1.0, abs=1e-3)


def test_an_arc_does_not_roll_before_it_lies_flat():
    blend = GaitBlend(MODEL, resolve(GaitSettings(name="arc_rolling"), MODEL), MODEL.rest_q_rad)
    body = slice(0, MODEL.head_raise_joints[0] - 2)
    flat = np.where(MODEL.is_yaw, blend.gait.shape.amplitude_o, 0.0)[body]
    while blend.sigma == blend.gait.start_sigma:
        q_rad = blend.step(1.0, DT_S)[body]
    assert np.max(np.abs(q_rad - flat)) < 0.051


def test_a_turn_commanded_twenty_times_a_second_is_smooth():
    turns = np.sin(np.arange(80) / 5.0)
    angles, _ = _play([(GaitSettings(), float(turn), 1.0, 5) for turn in turns])
    assert np.max(np.abs(np.diff(angles, 2, axis=0))) / DT_S**2 < 0.5 * MODEL.limits.acceleration_rad_s2


SHAPES = {name: HeadShape(name, MODEL, neck_of(MODEL, 6)) for name in ("none", "direction", "position")}


def _winding(shape, steps, alpha_pi=0.5):
    blend = GaitBlend(MODEL, resolve(GaitSettings(alpha_pi=alpha_pi), MODEL), MODEL.rest_q_rad, SHAPES[shape])
    return blend, [blend.step(1.0, DT_S) for _ in range(steps)]


@pytest.mark.parametrize("after", ["none", "direction", "position"])
@pytest.mark.parametrize("before", ["none", "direction", "position"])
def test_a_change_of_shape_has_no_step_at_any_phase_and_settles(before, after):
    for steps in range(200, 600, 80):
        blend, angles = _winding(before, steps)
        blend.set_shape(SHAPES[after])
        angles += [blend.step(1.0, DT_S) for _ in range(300)]
        near = np.array(angles[steps - 20 :])
        assert np.max(np.abs(np.diff(near, 2, axis=0))) / DT_S**2 < 0.5 * MODEL.limits.acceleration_rad_s2
        np.testing.assert_allclose(near[-1], SHAPES[after](blend.gait, blend.sigma)[0], atol=0.02)


def test_the_PlainShape_is_the_posture():
    gait = resolve(GaitSettings(), MODEL)
    np.testing.assert_array_equal(PlainShape(MODEL)(gait, 1.2), posed_angles(gait, MODEL, 1.2))
    np.testing.assert_array_equal(PlainShape(MODEL)(gait, 1.2), SHAPES["none"](gait, 1.2))


def test_the_slope_of_a_shape_counts_in_a_change():
    """With a slope that lies, the change would begin with another rate: the neck's own is taken."""
    blend, angles = _winding("position", 330)
    gait = blend.gait
    q_rad, slope = SHAPES["position"](gait, blend.sigma)
    np.testing.assert_allclose((angles[-1] - angles[-2]) / DT_S, slope * gait.omega, atol=0.02)
    np.testing.assert_allclose(angles[-1], q_rad, atol=0.01)


@pytest.mark.parametrize("drive", [1.0, -1.0, 0.5])
def test_taking_up_other_angles_goes_on_from_them_with_their_rates(drive):
    blend, _ = _winding("position", 250)
    for _ in range(120):
        last = blend.step(drive, DT_S)
    rng = np.random.default_rng(0)
    q_rad, dq_rad_s = last + rng.uniform(-0.3, 0.3, 35), rng.uniform(-1.0, 1.0, 35)
    blend.resume_from(q_rad, dq_rad_s)
    first, second = blend.step(drive, DT_S), blend.step(drive, DT_S)
    assert np.max(np.abs(first - q_rad - dq_rad_s * DT_S)) < 2e-3
    np.testing.assert_allclose((second - first) / DT_S, dq_rad_s, atol=0.25)
    for _ in range(600):
        last = blend.step(drive, DT_S)
    np.testing.assert_allclose(last, SHAPES["position"](blend.gait, blend.sigma)[0], atol=0.02)


def test_taking_up_angles_at_rest_stays_there():
    blend, _ = _winding("direction", 200)
    for _ in range(60):
        blend.step(0.0, DT_S)
    q_rad = np.linspace(-0.5, 0.5, 35)
    blend.resume_from(q_rad, np.full(35, 0.7))
    np.testing.assert_allclose(blend.step(0.0, DT_S), q_rad, atol=1e-12)
