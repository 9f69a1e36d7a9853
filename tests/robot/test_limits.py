"""The follower that never breaks a limit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from snakeslam.robot.limits import JointLimits, LimitedFollower

LIMITS = JointLimits(position_rad=1.5, rate_rad_s=6.0, acceleration_rad_s2=40.0)
DT_S = 0.01


def _follow(targets_rad, dt_s=DT_S, limits=LIMITS):
    follower = LimitedFollower(limits, np.zeros(1))
    return np.array([follower.step(np.array([target]), dt_s)[0] for target in targets_rad])


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.floats(-4, 4), st.integers(1, 40)), min_size=1, max_size=8),
    st.sampled_from([0.002, 0.01, 0.03]),
)
def test_no_target_breaks_position_rate_or_acceleration(segments, dt_s):
    targets = np.concatenate([np.full(length, target) for target, length in segments])
    q_rad = _follow(targets, dt_s)
    rate = np.diff(q_rad, prepend=0.0) / dt_s
    acceleration = np.diff(rate, prepend=0.0) / dt_s
    assert np.max(np.abs(q_rad)) <= LIMITS.position_rad + 1e-9
    assert np.max(np.abs(rate)) <= LIMITS.rate_rad_s + 1e-9
    assert np.max(np.abs(acceleration)) <= LIMITS.acceleration_rad_s2 + 1e-6


def test_a_target_within_the_limits_is_met_exactly():
    t_s = np.arange(1, 400) * DT_S
    targets = 0.7 * (1.0 - np.cos(2.0 * t_s))
    np.testing.assert_allclose(_follow(targets), targets, atol=1e-9)


@pytest.mark.parametrize("target", [1.2, -0.3, 5.0])
def test_a_step_is_reached_and_kept(target):
    q_rad = _follow(np.full(200, target))
    np.testing.assert_allclose(q_rad[120:], np.clip(target, -1.5, 1.5), atol=1e-3)
    overshoot = np.max(np.sign(target) * q_rad) - min(abs(target), 1.5)
    assert overshoot < 0.02
