"""Real time kept, lost, and measured."""

import pytest

from snakeslam.runtime.process.pacing import Pacer

MS = 1_000_000


class Clock:
    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def test_a_fast_loop_is_held_to_real_time() -> None:
    clock = Clock()
    pacer = Pacer(clock)
    for step in range(300):
        clock.now_s += 0.002 + pacer.wait_s(step * 10 * MS)
    assert clock.now_s - 100.0 == pytest.approx(2.99, abs=0.02)
    assert pacer.realtime_factor == pytest.approx(1.0, abs=0.02)


def test_a_slow_loop_never_waits_and_says_how_slow_it_is() -> None:
    clock = Clock()
    pacer = Pacer(clock)
    waits = []
    for step in range(300):
        waits.append(pacer.wait_s(step * 10 * MS))
        clock.now_s += 0.02 + waits[-1]
    assert max(waits) == 0.0
    assert pacer.realtime_factor == pytest.approx(0.5, abs=0.02)


def test_after_a_pause_it_does_not_rush_to_catch_up() -> None:
    clock = Clock()
    pacer = Pacer(clock, slack_s=0.1)
    for step in range(100):
        clock.now_s += pacer.wait_s(step * 10 * MS)
    clock.now_s += 5.0
    waits = [pacer.wait_s(step * 10 * MS) for step in range(100, 102)]
    assert waits[1] == pytest.approx(0.01, abs=1e-6)


def test_there_is_no_factor_before_there_is_time() -> None:
    pacer = Pacer(Clock())
    pacer.wait_s(0)
    assert pacer.realtime_factor is None
