"""How old a message is, by the time of a robot that is real, simulated, slow, or was frozen."""

import pytest

from snakeslam.runtime.robot.time import RobotTime

MS = 1_000_000


def played(pace: float, *, simulated: bool = True) -> RobotTime:
    """A robot that has gone on for 100 control periods at ``pace``, up to 1 s of its own time."""
    found = RobotTime(simulated=simulated)
    for k in range(101):
        found.add(round(k * 10 * MS / pace), k * 10 * MS)
    return found


def test_a_real_robots_time_is_the_clock() -> None:
    time = played(0.2, simulated=False)
    assert time.at(123 * MS) == 123 * MS
    assert time.of_stamp(5100 * MS, 5000 * MS) == 5100 * MS


@pytest.mark.parametrize("pace", [1.0, 0.25, 0.1])
def test_in_a_slow_simulator_a_message_ages_as_slowly(pace: float) -> None:
    time = played(pace)
    now_ns = round(1000 * MS / pace)
    assert time.at(now_ns) == 1000 * MS
    age_ns = time.at(now_ns) - time.of_stamp(now_ns - 400 * MS, now_ns)
    assert age_ns == pytest.approx(400 * MS * pace, abs=10 * MS)


def test_the_future_stays_as_far_ahead_and_the_past_beyond_memory_as_far_behind() -> None:
    time = played(0.5)
    assert time.of_stamp(2100 * MS, 2000 * MS) - time.at(2000 * MS) == 100 * MS
    assert time.at(-500 * MS) == -500 * MS


def test_a_freeze_counts_in_full_and_a_wait_does_not() -> None:
    waits, freezes = played(1.0), played(1.0)
    for k in range(1, 31):
        waits.add((1000 + k * 50) * MS, 1000 * MS)
    freezes.add(2500 * MS, 1000 * MS)
    assert waits.at(2500 * MS) == waits.of_stamp(1100 * MS, 2500 * MS)
    assert freezes.at(2500 * MS) - freezes.of_stamp(1100 * MS, 2500 * MS) >= 1400 * MS


def test_time_never_goes_back() -> None:
    time = played(0.3)
    found = [time.at(k * 7 * MS) for k in range(1000)]
    assert found == sorted(found)
