"""Start, stop, drive, turn and changes of gait without a step, over random sequences of commands."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from snakeslam.gaits.blend import GaitBlend
from snakeslam.gaits.catalogue import CATALOGUE, GaitSettings, resolve
from snakeslam.gaits.posture import posed_angles
from snakeslam.robot.model import PRESETS

DT_S = 0.01
MODEL = PRESETS["sim35"]
DEEPEST = GaitSettings(alpha_pi=0.7, period_s=2.5)

command = st.tuples(
    st.one_of(
        st.just(DEEPEST),
        st.builds(
            GaitSettings,
            name=st.sampled_from(list(CATALOGUE)),
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
    angles, _ = _play(commands)
    rates = np.diff(angles, axis=0) / DT_S
    assert np.max(np.abs(rates)) < MODEL.limits.rate_rad_s
    assert np.max(np.abs(np.diff(rates, axis=0))) / DT_S < MODEL.limits.acceleration_rad_s2


def test_without_drive_nothing_moves_whatever_is_chosen():
    angles, blend = _play([(GaitSettings(name=name), 1.0, 0.0, 50) for name in CATALOGUE])
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
