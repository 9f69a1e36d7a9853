"""Closed loop on the plane of ``plane.py``: what the head does, with what the controller does not know."""

import numpy as np
import pytest

from snakeslam.head.line import LineErrors
from snakeslam.head.neck import neck_of
from snakeslam.head.predictive import LARGEST_RAD, PredictiveNeck
from snakeslam.messages import HeadCommand
from snakeslam.robot.friction import resistive_map
from snakeslam.robot.support import posture_loads
from tests.head.plane import DT_S, FLAT, PERIOD_S, Plane, contacts, pose_estimate, ride


def test_the_plane_itself_slides_where_least_is_dissipated():
    """Every other twist dissipates more: the reweighted squares have converged."""
    rng = np.random.default_rng(0)
    plane = Plane(ratio=3.0, lag_s=0.03, yaw=0.4)
    for k in range(8):
        q_before, yaw = plane.q_rad, plane.head[2]
        plane.step(np.where(FLAT.is_yaw, 0.4 * np.sin(0.31 * np.arange(35) + 0.03 * k), 0.0))
    moved = (contacts(plane.q_rad, yaw)[0] - contacts(q_before, yaw)[0]) / DT_S
    arms, heading = contacts((plane.q_rad + q_before) / 2.0, yaw)

    def dissipated(twist):
        v = moved + twist[:2] + twist[2] * np.stack([-arms[:, 1], arms[:, 0]], axis=-1)
        c, s = np.cos(heading), np.sin(heading)
        return np.sum(np.hypot(c * v[:, 0] + s * v[:, 1], 3.0 * (-s * v[:, 0] + c * v[:, 1])))

    least = dissipated(plane.twist)
    assert least > 0.1
    for change in 0.02 * rng.normal(size=(50, 3)):
        assert dissipated(plane.twist + change) > least


@pytest.fixture(scope="module", params=[3.0, 10.0], ids=["ratio 3", "ratio 10"])
def rides(request):
    """One ride with each controller at .5 pi."""
    return {name: ride(name, ratio=request.param) for name in ("none", "direction", "position", "predictive")}


def test_each_controller_is_better_than_the_one_before(rides):
    """Measured: about 66, 21, .8 and .9, .3 and .1 deg."""
    none, direction, position, predictive = (one.yaw_rms_deg for one in rides.values())
    assert predictive < position < direction < none
    assert none > 55.0
    assert direction < 25.0
    assert position < 3.0


def test_predictive_holds_the_head_still_and_does_not_stop_the_robot(rides):
    """Measured at ratio 3 and 10: .3 and .1 deg, 1 and .5 deg/s, 23 and 18 mm."""
    head = rides["predictive"]
    assert head.yaw_rms_deg < 0.8
    assert head.peak_rate_deg_s < 5.0
    assert head.sway_m < 0.05
    assert head.sway_m < 0.3 * rides["position"].sway_m
    assert head.speed_m_s > 0.8 * rides["none"].speed_m_s


@pytest.mark.parametrize(
    ("unknown", "yaw_deg", "sway_m"),
    [
        ({"alpha_pi": 0.3}, 0.5, 0.05),
        ({"alpha_pi": 0.7}, 1.5, 0.1),
        ({"lag_s": 0.08, "delay_s": 0.05, "ratio": 10.0}, 0.8, 0.05),
        ({"supposed": 1.0}, 0.8, 0.1),
        ({"supposed": 30.0, "delay_s": 0.15}, 0.8, 0.05),
        ({"supposed": 1.0, "ratio": 10.0, "lag_s": 0.08, "delay_s": 0.15}, 0.8, 0.1),
        ({"neck": 4}, 0.8, 0.05),
        ({"sensors": "gyro"}, 0.8, 0.08),
        ({"sensors": "none"}, 3.0, 0.1),
    ],
    ids=str,
)
def test_lag_delay_and_a_wrong_friction_ratio_cost_little(unknown, yaw_deg, sway_m):
    """Measured: .08 to .42 deg and 18 to 51 mm, the most sway where friction is supposed to have no direction."""
    head = ride("predictive", **unknown)
    assert head.yaw_rms_deg < yaw_deg
    assert head.sway_m < sway_m
    assert np.max(np.abs(head.targets[:, FLAT.is_yaw][:, -6:])) <= LARGEST_RAD + 1e-9


def test_a_turn_of_the_line_is_followed_by_head_and_robot():
    """45 deg at 8 deg/s, commanded after two periods; the head ends there and the robot goes there."""
    at = int(2 * PERIOD_S / DT_S)
    head = ride("predictive", periods=5, commands=[(at, HeadCommand(0, turn_by_deg=45.0))])
    yaw_deg = np.rad2deg(head.head[:, 2])
    reached = at + int(2 * PERIOD_S / DT_S)
    turned = np.mean(yaw_deg[reached:]) - np.mean(yaw_deg[at - 200 : at])
    assert turned == pytest.approx(45.0, abs=2.0)
    assert np.max(np.abs(np.diff(yaw_deg[at:]))) / DT_S < 30.0
    moved = head.head[-1, :2] - head.head[reached, :2]
    assert np.rad2deg(np.arctan2(moved[1], moved[0])) == pytest.approx(yaw_deg[-1], abs=10.0)


@pytest.mark.parametrize("sensors", ["both", "none"])
def test_taken_over_amid_its_widest_swing_the_head_is_not_thrown(sensors):
    """About 110 deg off the line at first; uncontrolled it turns at 150 deg/s."""
    at = 250
    taken = ride("none", sensors=sensors, commands=[(at, HeadCommand(0, controller="predictive"))])
    yaw_deg = np.rad2deg(taken.head[:, 2])
    assert abs(yaw_deg[at]) > 80.0
    assert np.max(np.abs(np.diff(yaw_deg[at:]))) / DT_S < 100.0
    assert np.max(np.abs(yaw_deg)) < 150.0
    if sensors == "both":
        assert np.std(yaw_deg[-150:]) < 0.8
        assert abs(yaw_deg[-1]) < 30.0


def test_a_steady_twist_is_the_one_of_the_model():
    """Where the neck can help, the model's own head obeys: twist = (v_mean, -8 e_y, -8 psi) in the line's axes."""
    neck = neck_of(FLAT, 6)
    rng = np.random.default_rng(2)
    q_rad = np.where(FLAT.is_yaw, 0.5 * np.sin(0.314 * np.arange(35)), 0.0)
    dq_rad_s = np.where(FLAT.is_yaw, rng.normal(0.0, 0.3, 35), 0.0)
    dq_rad_s[neck.joints] = 0.0
    one = PredictiveNeck(FLAT, neck, posture_loads(FLAT), 4.0, q_rad[neck.joints])
    errors = LineErrors(yaw_rad=0.02, lateral_m=-0.01)
    after = one.step(q_rad, dq_rad_s, errors, 1.0, PERIOD_S, 1e-4)
    taken = dq_rad_s.copy()
    taken[neck.joints] = (after - q_rad[neck.joints]) / 1e-4
    T_WI = pose_estimate(0, yaw=0.02).T_WI
    twist = resistive_map(FLAT, q_rad, T_WI, posture_loads(FLAT), 4.0) @ taken
    np.testing.assert_allclose(twist[1:], [0.08, -0.16], atol=0.02)


def test_at_pace_0_nothing_is_corrected():
    neck = neck_of(FLAT, 6)
    q_rad = np.where(FLAT.is_yaw, 0.3, 0.0)
    one = PredictiveNeck(FLAT, neck, posture_loads(FLAT), 4.0, np.full(6, 0.1), v_mean_m_s=0.2)
    np.testing.assert_array_equal(one.step(q_rad, np.zeros(35), LineErrors(0.2, 0.3), 0.0, PERIOD_S, 0.01), 0.1)
