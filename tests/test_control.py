"""From command to targets: at rest until told, within the limits, deterministic, clear refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from snakeslam.control import Control
from snakeslam.errors import InputError
from snakeslam.gaits.catalogue import GAITS, GaitSettings, resolve
from snakeslam.gaits.posture import posed_angles
from snakeslam.head.settings import HeadSettings
from snakeslam.messages import GaitCommand, HeadCommand, JointState
from snakeslam.robot.limits import LimitedFollower
from snakeslam.robot.model import PRESETS
from tests.head.plane import gyro, pose_estimate

MODEL = PRESETS["sim35"]
STEP_NS = 10_000_000

commands = st.builds(
    GaitCommand,
    t_ns=st.just(0),
    gait=st.sampled_from(list(GAITS)),
    drive=st.floats(-1, 1),
    turn=st.floats(-1, 1),
    parameters=st.fixed_dictionaries({"alpha_pi": st.floats(0.05, 0.7), "period_s": st.floats(2.5, 8)}),
)


def _control(**gait):
    return Control(MODEL, GaitSettings(**gait), HeadSettings(controller="none"))


def _run(control, steps, start=0, joints=None):
    return np.array([control.step((start + k) * STEP_NS, joints, None, None).q_rad for k in range(steps)])


CONTROLLERS = ("none", "direction", "position", "predictive")


def _held(controller="predictive", **gait):
    control = Control(MODEL, GaitSettings(**gait), HeadSettings(controller=controller))
    control.command(GaitCommand(0, "serpentine", parameters=gait))
    return control


def _sensed(control, steps, start=0):
    """As ``_run``, with an estimate and a gyroscope that see a head that holds still."""
    stamps = [(start + k) * STEP_NS for k in range(steps)]
    return np.array([control.step(t, None, pose_estimate(t), gyro(t, 0.0)).q_rad for t in stamps])


@pytest.fixture
def wanted(monkeypatch):
    """What is asked of the follower, a row a step."""
    rows, step = [], LimitedFollower.step

    def spy(self, target_rad, dt_s):
        rows.append(np.array(target_rad))
        return step(self, target_rad, dt_s)

    monkeypatch.setattr(LimitedFollower, "step", spy)
    return rows


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


def test_it_starts_from_the_angles_the_joints_are_in():
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
        "changed": (GaitCommand(0, "serpentine", parameters={"alpha_pi": 0.2}), GaitSettings(alpha_pi=0.2, period_s=8)),
    }
    for command, expected in commands.values():
        control = Control(MODEL, configured, HeadSettings(controller="none"))
        control.command(command)
        reference = Control(MODEL, expected, HeadSettings(controller="none"))
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
        (GaitCommand(0, "serpentine", parameters={"period_s": -1.0}), r"gait.period_s"),
        (GaitCommand(0, "serpentine", parameters={"period_s": float("nan")}), r"gait.period_s"),
        (GaitCommand(0, "serpentine", parameters={"alpha_pi": 0.7, "period_s": 0.6}), r"gait.period_s.*too fast"),
    ):
        with pytest.raises(InputError, match=text) as caught:
            control.command(bad)
        assert "\n" not in str(caught.value)
    np.testing.assert_array_equal(_run(control, 100), _run(untouched, 100))
    with pytest.raises(InputError, match="time goes back"):
        control.step(0, None, None, None)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1.5, -2.0])
@pytest.mark.parametrize("key", ["drive", "turn"])
def test_drive_and_steering_beyond_one_are_refused(key, value):
    with pytest.raises(InputError, match=f"{key}.*allowed: -1 to 1"):
        _control().command(GaitCommand(0, "serpentine", **{key: value}))


def test_switching_head_controllers_at_any_phase_is_no_jump(wanted):
    """Every pair in turn, each at another phase, some amid the change before: what is asked for is smooth itself.

    Only feedback may begin with another rate, which the follower takes up within a few steps and .05 rad.
    """
    control, parts, start = _held("none", alpha_pi=0.5), [], 0
    pairs = [b for k in range(4) for b in (CONTROLLERS[(k + j) % 4] for j in (1, 3, 2))]
    for k, controller in enumerate(["none", *pairs, *pairs]):
        control.command_head(HeadCommand(0, controller=controller))
        parts.append(_sensed(control, 47 + 13 * (k % 4), start))
        start += len(parts[-1])
    q_rad, asked = np.concatenate(parts)[1:], np.array(wanted)
    assert np.max(np.abs(np.diff(asked, axis=0))) / 0.01 < 4.0
    assert np.max(np.abs(asked - q_rad)) < 0.05
    rates = np.diff(q_rad, axis=0) / 0.01
    assert np.max(np.abs(np.diff(rates, axis=0))) / 0.01 <= MODEL.limits.acceleration_rad_s2 + 1e-6


def test_drive_0_stops_every_joint_under_feedback_and_goes_on(wanted):
    control = _held(alpha_pi=0.5)
    moving = _sensed(control, 300)
    control.command(GaitCommand(0, "serpentine", drive=0.0, parameters={"alpha_pi": 0.5}))
    _sensed(control, 60, 300)
    stationary = _sensed(control, 200, 360)
    np.testing.assert_allclose(stationary, np.broadcast_to(stationary[0], stationary.shape), atol=1e-9)
    control.command(GaitCommand(0, "serpentine", parameters={"alpha_pi": 0.5}))
    onward = _sensed(control, 200, 560)
    assert np.max(np.abs(onward[0] - stationary[-1])) < 0.01
    assert np.max(np.abs(onward[-1] - stationary[-1])) > 0.2
    assert np.max(np.abs(np.diff(moving, axis=0))) > 0.005
    assert np.max(np.abs(np.diff(np.array(wanted), 2, axis=0))) / 0.01**2 < MODEL.limits.acceleration_rad_s2


def test_reversing_under_feedback_runs_the_wave_back(wanted):
    control = _held(alpha_pi=0.3)
    forward = _sensed(control, 400)
    control.command(GaitCommand(0, "serpentine", drive=-1.0, parameters={"alpha_pi": 0.3}))
    back = _sensed(control, 500, 400)
    assert np.max(np.abs(back)) <= np.max(np.abs(forward)) + 0.2
    assert np.max(np.abs(np.diff(np.array(wanted), 2, axis=0))) / 0.01**2 < MODEL.limits.acceleration_rad_s2
    body = slice(0, 12, 2)
    for rows, ahead in ((forward[-150:], -1.0), (back[-150:], 1.0)):
        rate = np.gradient(rows[:, body], 0.01, axis=0)
        slope = np.gradient(rows[:, body], axis=1)
        assert np.sign(np.sum(rate * slope)) == -ahead


@pytest.mark.parametrize("alpha_pi", [0.1, 0.7])
def test_predictive_without_any_sensor_stays_bounded(alpha_pi):
    control = _held(alpha_pi=alpha_pi)
    q_rad = _run(control, 1200)
    assert np.all(np.isfinite(q_rad))
    assert np.max(np.abs(q_rad)) <= np.deg2rad(89.0)
    period = q_rad[-401:]
    np.testing.assert_allclose(period[0], period[-1], atol=0.2)


@pytest.mark.parametrize("name", [name for name in GAITS if name != "serpentine"])
def test_another_gait_and_back_under_predictive_control_is_smooth(name, wanted):
    """By the model alone: where nothing answers, estimates that stand still would be an error that grows."""
    control, parts, start = _held(alpha_pi=0.3), [], 0
    for gait, steps in (("serpentine", 230), (name, 300), ("serpentine", 700)):
        control.command(GaitCommand(0, gait))
        parts.append(_run(control, steps, start))
        start += steps
    q_rad, asked = np.concatenate(parts)[1:], np.array(wanted)
    assert np.max(np.abs(np.diff(asked, axis=0))) / 0.01 < 4.0
    assert np.max(np.abs(asked - q_rad)) < 0.05
    fresh = _run(_held(alpha_pi=0.3), 800)[400:]
    reach, expected = (np.max(np.abs(rows[:, ::2][:, :11]), axis=0) for rows in (q_rad[-400:], fresh))
    np.testing.assert_allclose(reach, expected, atol=0.05)


def test_feedback_is_deterministic():
    def play():
        control = _held(alpha_pi=0.5)
        first = _sensed(control, 150)
        control.command_head(HeadCommand(0, turn_by_deg=20.0))
        second = _sensed(control, 100, 150)
        control.command_head(HeadCommand(0, controller="position"))
        return np.concatenate([first, second, _sensed(control, 100, 250)]).tobytes()

    assert play() == play()


def test_a_head_that_the_gait_cannot_have_is_refused_and_changes_nothing():
    control, untouched = (_held("position", alpha_pi=0.3) for _ in range(2))
    for bad in (HeadCommand(0, neck_joints=2), HeadCommand(0, controller="steady"), HeadCommand(0, turn_by_deg=9.0)):
        with pytest.raises(InputError, match="head") as caught:
            control.command_head(bad)
        assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=r"head.neck_joints.*deg in this gait"):
        Control(MODEL, GaitSettings(alpha_pi=0.5), HeadSettings(controller="position", neck_joints=2))
    deep = _held("position", alpha_pi=0.1)
    deep.command_head(HeadCommand(0, neck_joints=2))
    with pytest.raises(InputError, match=r"head.neck_joints"):
        deep.command(GaitCommand(0, "serpentine", parameters={"alpha_pi": 0.7}))
    assert control.head == untouched.head
    np.testing.assert_array_equal(_run(control, 100), _run(untouched, 100))


def test_under_predictive_control_steering_rotates_the_line_and_bends_no_gait():
    """The body follows its head: the drive pad's turn moves the line, and without it the gait's own offset."""

    def played(controller, turn):
        control = Control(MODEL, GaitSettings(), HeadSettings(controller=controller))
        control.command(GaitCommand(0, "serpentine", turn=turn))
        _run(control, 300)
        return control

    body = slice(0, 18, 2)
    straight, turned = (played("predictive", turn).step(3_000_000_000, None, None, None) for turn in (0.0, 1.0))
    np.testing.assert_allclose(turned.q_rad[body], straight.q_rad[body], atol=1e-12)
    bent = played("none", 1.0).step(3_000_000_000, None, None, None).q_rad[body]
    plain = played("none", 0.0).step(3_000_000_000, None, None, None).q_rad[body]
    np.testing.assert_allclose(bent - plain, np.deg2rad(6.0), atol=0.01)
