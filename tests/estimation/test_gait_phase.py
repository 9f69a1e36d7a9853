"""The phase of a gait, from joint rates alone."""

import numpy as np
import pytest

from snakeslam.estimation.gait.phase import GaitPhase
from snakeslam.messages import Float

UP_I = np.array([0.0, 0.0, 1.0])
JOINT = np.arange(35)


def crawl(t_s: float, wavelength: float = 20.0, rate_rad_s: float = 0.5) -> Float:
    return rate_rad_s * np.cos(2.0 * np.pi * (t_s / 4.0 + JOINT / wavelength))


def phases(gait: GaitPhase, rates: list[Float], up_I: Float = UP_I) -> list[Float]:
    return [gait.update(dq_rad_s, up_I)[0] for dq_rad_s in rates]


def test_the_phase_of_a_crawl_rotates_like_cosine_and_sine() -> None:
    times = np.arange(0.0, 8.0, 0.05)
    along = np.array(phases(GaitPhase(), [crawl(t) for t in times]))[40:]
    phase = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
    assert np.abs(np.diff(phase)).mean() == pytest.approx(2.0 * np.pi * 0.05 / 4.0, rel=0.02)
    assert np.all(np.sign(np.diff(phase)) == np.sign(phase[-1] - phase[0]))
    assert 0.7 < np.linalg.norm(along, axis=1).min() <= np.linalg.norm(along, axis=1).max() < 1.4


def test_half_the_pace_is_half_as_much() -> None:
    gait = GaitPhase()
    full = phases(gait, [crawl(t) for t in np.arange(0.0, 8.0, 0.05)])
    assert np.linalg.norm(gait.update(crawl(8.0, rate_rad_s=0.25), UP_I)[0]) == pytest.approx(
        np.linalg.norm(full[-1]) / 2.0, rel=0.15
    )


def test_directions_of_a_slow_start_are_replaced() -> None:
    """Directions found in the first slow rates are found again at full pace."""
    gait, times = GaitPhase(), np.arange(0.0, 12.0, 0.05)
    along = phases(gait, [crawl(t, rate_rad_s=min(0.5, 0.05 + 0.1 * t)) for t in times])
    assert np.linalg.norm(along[-1]) < 1.6


def test_another_gait_has_other_directions() -> None:
    gait = GaitPhase()
    phases(gait, [crawl(t) for t in np.arange(0.0, 8.0, 0.05)])
    assert gait.complete
    rates = [np.where(JOINT % 2 == 0, 0.5, -0.5) * np.cos(np.pi * t / 2.0) for t in np.arange(0.0, 2.0, 0.05)]
    assert any(gait.update(dq_rad_s, UP_I)[0].tolist() == [0.0, 0.0] for dq_rad_s in rates)


def test_stationary_joints_and_a_rolling_head_have_no_phase() -> None:
    assert not np.any(phases(GaitPhase(), [np.zeros(35)] * 50))
    gait = GaitPhase()
    for t_s in np.arange(0.0, 8.0, 0.05):
        up_I = np.array([0.0, np.sin(2.0 * np.pi * t_s / 2.0), np.cos(2.0 * np.pi * t_s / 2.0)])
        assert not np.any(gait.update(crawl(t_s), up_I)[0])
