"""The governor lowers the pace at once, raises it late and slowly, and never lowers it to zero."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from snakeslam.config import GovernorSettings
from snakeslam.messages import Health, Verdict
from snakeslam.runtime.bus.topics import Governed, Phase
from snakeslam.runtime.robot.governor import Governor, tracking_quality

SETTINGS = GovernorSettings(enabled=True)
GOOD = Health(Verdict.GOOD, (), 150, 1.0)
FEW = Health(Verdict.DEGRADED, (), 10, 1.0)
BLIND = Health(Verdict.BLIND, (), 0)
FRAME_NS = 50_000_000


def play(governor: Governor, health: Health, frames: int, t_ns: int = 0) -> list[Governed]:
    return [governor.step(t_ns + k * FRAME_NS, health) for k in range(frames)]


def test_while_all_is_well_nothing_is_touched() -> None:
    assert set(play(Governor(SETTINGS), GOOD, 50)) == {Governed()}


@pytest.mark.parametrize(
    ("health", "quality", "words"),
    [
        (GOOD, 1.0, None),
        (BLIND, 0.0, "blind"),
        (Health(Verdict.LOST, (), 100), 0.0, "lost"),
        (Health(Verdict.GOOD, (), 40), 0.5, "40 features"),
        (Health(Verdict.DEGRADED, (), 150, 4.0), 0.5, "innovations 4.0"),
        (Health(Verdict.DEGRADED, (), 30, 5.0), 0.25, ""),
        (Health(Verdict.GOOD, (), 0), 1.0, None),
    ],
)
def test_the_worst_sign_counts(health: Health, quality: float, words: str | None) -> None:
    found, reason = tracking_quality(health, SETTINGS)
    assert found == pytest.approx(quality)
    assert reason is None if words is None else words in (reason or "")


def test_pace_falls_fast_waits_and_returns_slowly() -> None:
    governor = Governor(SETTINGS)
    play(governor, GOOD, 2)
    fall = play(governor, FEW, 10, 2 * FRAME_NS)
    assert fall[0].pace == pytest.approx(0.9)
    assert (fall[0].phase, fall[-1].phase) == (Phase.SLOWING, Phase.SLOW)
    assert fall[-1].pace == SETTINGS.least_pace
    assert "10 features" in (fall[-1].reason or "")
    rise = play(governor, GOOD, 100, 12 * FRAME_NS)
    assert {step.pace for step in rise[:19]} == {SETTINGS.least_pace}
    assert rise[30].phase is Phase.RETURNING
    steps = [b.pace - a.pace for a, b in pairwise(rise)]
    assert max(steps) <= SETTINGS.rise_per_s * 0.05 + 1e-9
    assert rise[-1] == Governed()


def test_a_view_that_comes_and_goes_with_the_swing_keeps_it_slow() -> None:
    governor = Governor(SETTINGS)
    play(governor, FEW, 20)
    for swing in range(8):
        t_ns = (20 + 30 * swing) * FRAME_NS
        play(governor, GOOD, 15, t_ns)
        play(governor, FEW, 15, t_ns + 15 * FRAME_NS)
        assert governor.now.pace == SETTINGS.least_pace


@given(st.lists(st.tuples(st.sampled_from(Verdict), st.integers(0, 300), st.floats(0, 1e6) | st.none(),
                          st.integers(-10**9, 10**10)), max_size=60))  # fmt: skip
def test_whatever_comes_the_pace_stays_within_its_bounds_and_rates(
    frames: list[tuple[Verdict, int, float | None, int]],
) -> None:
    governor, t_ns, before = Governor(SETTINGS), 0, 1.0
    for verdict, tracks, innovation, dt_ns in frames:
        t_ns += dt_ns
        pace = governor.step(t_ns, Health(verdict, (), tracks, innovation)).pace
        assert SETTINGS.least_pace <= pace <= 1.0
        assert before - 0.5 * SETTINGS.fall_per_s - 1e-9 <= pace <= before + 0.5 * SETTINGS.rise_per_s + 1e-6
        before = pace
