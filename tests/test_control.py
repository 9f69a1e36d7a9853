"""From command to targets: at rest until told, within the limits, deterministic, clear refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from snakeslam.control import Control
from snakeslam.errors import InputError
from snakeslam.gaits.catalogue import CATALOGUE, GaitSettings, resolve
from snakeslam.gaits.posture import posed_angles
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import GaitCommand, JointState
from snakeslam.robot.model import PRESETS

MODEL = PRESETS["sim35"]
STEP_NS = 10_000_000

commands = st.builds(
    GaitCommand,
    t_ns=st.just(0),
    gait=st.sampled_from(list(CATALOGUE)),
    drive=st.floats(-1, 1),
    turn=st.floats(-1, 1),
    alpha_pi=st.floats(0.05, 0.7),
    period_s=st.floats(2.5, 8),
)


def _control(**gait):
    return Control(MODEL, GaitSettings(**gait), HeadSettings())


def _run(control, steps, start=0, joints=None):
    return np.array([control.step((start + k) * STEP_NS, joints, None, None).q_rad for k in range(steps)])


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(commands, st.integers(1, 200)), min_size=1, max_size=6))
def test_no_sequence_of_commands_breaks_position_rate_or_acceleration(sequence):
    control, parts, start = _control(), [np.tile(MODEL.rest_q_rad, (2, 1))], 0
    for command, steps in sequence:
        control.command(command)
        parts.append(_run(control, steps, start))
        start += steps
    q_rad = np.concatenate(parts)
    rates = np.diff(q_rad, axis=0) / 0.01
    assert np.max(np.abs(q_rad)) <= MODEL.limits.position_rad + 1e-9
    assert np.max(np.abs(rates)) <= MODEL.limits.rate_rad_s + 1e-9
    assert np.max(np.abs(np.diff(rates, axis=0))) / 0.01 <= MODEL.limits.acceleration_rad_s2 + 1e-6


def test_it_rests_until_commanded_then_plays_the_gait():
    control = _control()
    np.testing.assert_array_equal(_run(control, 50), np.tile(MODEL.rest_q_rad, (50, 1)))
    control.command(GaitCommand(0, "serpentine"))
    q_rad = _run(control, 800, start=50)
    gait = resolve(GaitSettings(), MODEL)
    reach = np.max(np.abs(q_rad[400:]), axis=0)
    np.testing.assert_allclose(reach[:30:2], gait.shape.amplitude_o, rtol=0.01)
    period = np.abs(q_rad[-1] - q_rad[-401])
    assert np.max(period) < 1e-3
    posed, _ = posed_angles(gait, MODEL, 0.0)
    np.testing.assert_allclose(q_rad[-1, 31], posed[31])


def test_it_takes_up_the_angles_the_joints_are_in():
    q_rad = np.linspace(-0.3, 0.4, 35)
    joints = JointState(0, q_rad, np.zeros(35), np.zeros(35), np.zeros(35))
    control = _control()
    control.command(GaitCommand(0, "pedal"))
    targets = _run(control, 3, joints=joints)
    np.testing.assert_array_equal(targets[0], q_rad)
    assert np.max(np.abs(targets[2] - q_rad)) < 0.01


def test_parameters_of_the_configured_gait_hold_for_it_alone():
    configured = GaitSettings(alpha_pi=0.1, period_s=8)
    commands = {
        "serpentine": (GaitCommand(0, "serpentine"), configured),
        "pedal": (GaitCommand(0, "pedal"), GaitSettings(name="pedal")),
        "changed": (GaitCommand(0, "serpentine", alpha_pi=0.2), GaitSettings(alpha_pi=0.2, period_s=8)),
    }
    for command, expected in commands.values():
        control = Control(MODEL, configured, HeadSettings())
        control.command(command)
        reference = Control(MODEL, expected, HeadSettings())
        reference.command(GaitCommand(0, expected.name))
        np.testing.assert_allclose(_run(control, 1200)[-1], _run(reference, 1200)[-1], atol=1e-3)


def test_the_same_commands_give_the_same_targets():
    def play():
        control = _control(name="sidewinding")
        control.command(GaitCommand(0, "sidewinding", turn=0.3))
        first = _run(control, 120)
        control.command(GaitCommand(0, "helix_rolling", drive=-0.7))
        return np.concatenate([first, _run(control, 300, start=120)]).tobytes()

    assert play() == play()


def test_a_bad_command_is_refused_in_one_line_and_changes_nothing():
    control, untouched = _control(), _control()
    for one in (control, untouched):
        one.command(GaitCommand(0, "serpentine"))
    for bad, text in (
        (GaitCommand(0, "walking"), r"gait.name"),
        (GaitCommand(0, "serpentine", period_s=-1.0), r"gait.period_s"),
        (GaitCommand(0, "serpentine", period_s=float("nan")), r"gait.period_s"),
        (GaitCommand(0, "serpentine", alpha_pi=0.7, period_s=0.6), r"gait.period_s.*too fast"),
    ):
        with pytest.raises(InputError, match=text) as caught:
            control.command(bad)
        assert "\n" not in str(caught.value)
    np.testing.assert_array_equal(_run(control, 100), _run(untouched, 100))
    with pytest.raises(InputError, match="time goes back"):
        control.step(0, None, None, None)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1.5, -2.0])
@pytest.mark.parametrize("key", ["drive", "turn"])
def test_drive_and_turn_beyond_one_are_refused(key, value):
    with pytest.raises(InputError, match=f"{key}.*allowed: -1 to 1"):
        _control().command(GaitCommand(0, "serpentine", **{key: value}))
