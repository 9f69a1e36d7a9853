"""A sway that repeats with the gait is learned and cancelled; nothing else is."""

import numpy as np
import pytest

from snakeslam.head.rhythm import LEARNED_PER_PERIOD, MOST_M_S, GaitRhythm

DT_S = 0.01
GAIN_RAD_S = 8.0
PERIOD_S = 2.0


def held_against(disturbance_m_s: float, periods: int = 20, offset_m_s: float = 0.0) -> tuple[np.ndarray, GaitRhythm]:
    """Return the sway of a head that feedback holds against a sideways velocity of the gait's period, (K,) m."""
    rhythm, lateral_m, sway_m = GaitRhythm(), 0.0, []
    for t_s in np.arange(0.0, periods * PERIOD_S, DT_S):
        rhythm.learn(lateral_m, GAIN_RAD_S, 1.0, PERIOD_S, DT_S)
        drift = disturbance_m_s * np.sin(2.0 * np.pi * t_s / PERIOD_S + 0.7) + offset_m_s
        lateral_m += (drift - GAIN_RAD_S * lateral_m + rhythm.correction_m_s) * DT_S
        sway_m.append(lateral_m)
    return np.array(sway_m), rhythm


def test_what_repeats_goes_away() -> None:
    sway_m, _ = held_against(0.08)
    period = int(PERIOD_S / DT_S)
    assert np.ptp(sway_m[:period]) > 0.015
    assert np.ptp(sway_m[-period:]) < 2e-4


def test_it_is_learned_at_the_rate_it_says() -> None:
    sway_m, _ = held_against(0.08, periods=5)
    period = int(PERIOD_S / DT_S)
    left = np.ptp(sway_m[4 * period :]) / np.ptp(sway_m[2 * period : 3 * period])
    assert left == pytest.approx(np.exp(-2 * LEARNED_PER_PERIOD), rel=0.15)


def test_a_steady_drift_is_left_to_feedback() -> None:
    sway_m, _ = held_against(0.0, offset_m_s=0.08)
    last = sway_m[-int(PERIOD_S / DT_S) :]
    assert last.mean() == pytest.approx(0.08 / GAIN_RAD_S, rel=0.2)
    assert np.ptp(last) < 1e-3


def test_a_robot_at_rest_learns_nothing() -> None:
    rhythm = GaitRhythm()
    for _ in range(100):
        rhythm.learn(0.1, GAIN_RAD_S, 0.0, PERIOD_S, DT_S)
    assert rhythm == GaitRhythm()


def test_a_sway_beyond_reach_asks_for_no_more_than_the_limit() -> None:
    _, rhythm = held_against(1.0)
    assert 0.9 * MOST_M_S < abs(rhythm.coefficient_m_s) <= MOST_M_S
