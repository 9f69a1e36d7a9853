"""The phase of a gait, from joint rates alone."""

import numpy as np
import pytest

from snakeslam.estimation.gait.wave import GaitWave
from snakeslam.messages import Float

UP_I = np.array([0.0, 0.0, 1.0])
JOINT = np.arange(35)


def crawl(t_s: float, wavelength: float = 20.0, rate_rad_s: float = 0.5) -> Float:
    return rate_rad_s * np.cos(2.0 * np.pi * (t_s / 4.0 + JOINT / wavelength))


def seen(wave: GaitWave, rates: list[Float], up_I: Float = UP_I) -> list[Float]:
    return [wave.see(dq_rad_s, up_I)[0] for dq_rad_s in rates]


def test_a_crawl_turns_like_cosine_and_sine() -> None:
    times = np.arange(0.0, 8.0, 0.05)
    along = np.array(seen(GaitWave(), [crawl(t) for t in times]))[40:]
    phase = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
    assert np.abs(np.diff(phase)).mean() == pytest.approx(2.0 * np.pi * 0.05 / 4.0, rel=0.02)
    assert np.all(np.sign(np.diff(phase)) == np.sign(phase[-1] - phase[0]))
    assert 0.7 < np.linalg.norm(along, axis=1).min() <= np.linalg.norm(along, axis=1).max() < 1.4


def test_half_the_pace_is_half_as_much() -> None:
    wave = GaitWave()
    full = seen(wave, [crawl(t) for t in np.arange(0.0, 8.0, 0.05)])
    assert np.linalg.norm(wave.see(crawl(8.0, rate_rad_s=0.25), UP_I)[0]) == pytest.approx(
        np.linalg.norm(full[-1]) / 2.0, rel=0.15
    )


def test_a_slow_start_is_not_the_measure() -> None:
    """Directions shown by the first slow rates are taken anew at full pace."""
    wave, times = GaitWave(), np.arange(0.0, 12.0, 0.05)
    along = seen(wave, [crawl(t, rate_rad_s=min(0.5, 0.05 + 0.1 * t)) for t in times])
    assert np.linalg.norm(along[-1]) < 1.6


def test_another_gait_shows_other_directions() -> None:
    wave = GaitWave()
    seen(wave, [crawl(t) for t in np.arange(0.0, 8.0, 0.05)])
    assert wave.complete
    rates = [np.where(JOINT % 2 == 0, 0.5, -0.5) * np.cos(np.pi * t / 2.0) for t in np.arange(0.0, 2.0, 0.05)]
    assert any(wave.see(dq_rad_s, UP_I)[0].tolist() == [0.0, 0.0] for dq_rad_s in rates)


def test_nothing_is_said_at_rest_and_of_a_head_that_rolls() -> None:
    assert not np.any(seen(GaitWave(), [np.zeros(35)] * 50))
    wave = GaitWave()
    for t_s in np.arange(0.0, 8.0, 0.05):
        up_I = np.array([0.0, np.sin(2.0 * np.pi * t_s / 2.0), np.cos(2.0 * np.pi * t_s / 2.0)])
        assert not np.any(wave.see(crawl(t_s), up_I)[0])
