"""Which drive input counts: order, age, and a clock that is only known through messages."""

from itertools import count

import pytest

from server.deadman import SILENT_S, Deadman, DriveSample
from snakeslam.runtime.robot.deadman import DEADMAN_S

NOW_S, THEIRS_S = 5000.0, 12.0


def deadman(delay_s: float = 0.02) -> Deadman:
    """An input whose pings took at least ``delay_s``."""
    found = Deadman()
    found.synchronise(THEIRS_S, NOW_S + delay_s)
    found.synchronise(THEIRS_S + 0.1, NOW_S + 0.1 + delay_s + 0.05)
    return found


def test_input_in_order_and_in_time_counts() -> None:
    driver = deadman()
    assert driver.add(DriveSample(1, THEIRS_S + 1.0, 1.0, -0.31), NOW_S + 1.02) is None
    assert (driver.drive, driver.turn) == (1.0, -0.3)
    assert driver.driving
    assert driver.add(DriveSample(2, THEIRS_S + 1.1, 0.0, 0.0), NOW_S + 1.12) is None
    assert not driver.driving


@pytest.mark.parametrize(
    ("seq", "late_s", "why"),
    [(1, 0.0, "out of order"), (0, 0.0, "out of order"), (2, DEADMAN_S + 0.05, "stale"), (2, -0.5, "from the future")],
)
def test_what_does_not_count_changes_nothing(seq: int, late_s: float, why: str) -> None:
    driver = deadman()
    assert driver.add(DriveSample(1, THEIRS_S + 1.0, 1.0, 0.0), NOW_S + 1.02) is None
    assert driver.add(DriveSample(seq, THEIRS_S + 1.1, -1.0, 0.0), NOW_S + 1.12 + late_s) == why
    assert driver.drive == 1.0
    assert driver.add(DriveSample(3, THEIRS_S + 1.2, 0.0, 0.0), NOW_S + 1.22) is None


def test_without_a_ping_no_clock_is_known() -> None:
    assert Deadman().add(DriveSample(1, 0.0, 1.0, 0.0), NOW_S) == "before any ping"


def test_silence_lets_go_only_of_a_robot_that_is_driven() -> None:
    driver = deadman()
    assert not driver.silent(NOW_S + 100.0)
    driver.add(DriveSample(1, THEIRS_S + 1.0, 0.5, 0.0), NOW_S + 1.0)
    assert not driver.silent(NOW_S + 1.0 + SILENT_S - 0.01)
    assert driver.silent(NOW_S + 1.0 + SILENT_S + 0.01)
    driver.release()
    assert not driver.silent(NOW_S + 2.0)


def test_a_page_whose_clock_was_suspended_is_believed_again_after_some_pings() -> None:
    driver = deadman()
    slept_s = 60.0
    assert driver.add(DriveSample(1, THEIRS_S + 1.0, 1.0, 0.0), NOW_S + 1.0 + slept_s) == "stale"
    for k in range(20):
        driver.synchronise(THEIRS_S + 2.0 + k, NOW_S + 2.0 + k + slept_s)
    assert driver.add(DriveSample(2, THEIRS_S + 30.0, 1.0, 0.0), NOW_S + 30.0 + slept_s) is None


SEQ = count(1)


def given(driver: Deadman, drive: float, late_s: float = 0.0) -> bool:
    """Give the next input; return whether a press would begin for the session."""
    seq = next(SEQ)
    driver.add(DriveSample(seq, THEIRS_S + seq, drive, 0.0), NOW_S + seq + late_s)
    return driver.pop_begins()


def test_a_press_begins_once_and_again_only_after_a_zero() -> None:
    driver = deadman()
    assert [given(driver, drive) for drive in (1.0, 1.0, -0.5, 0.0, 1.0, 1.0)] == [
        True,
        False,
        False,
        False,
        True,
        False,
    ]


def test_a_late_press_must_be_released_and_a_late_zero_releases() -> None:
    driver = deadman()
    assert not given(driver, 1.0, late_s=5.0)
    assert not given(driver, 1.0)
    assert not given(driver, 0.0, late_s=5.0)
    assert not driver.driving
    assert given(driver, 1.0)


def test_an_input_that_the_server_has_released_was_not_released_by_its_sender() -> None:
    driver = deadman()
    assert given(driver, 1.0)
    driver.release()
    assert not given(driver, 1.0)


def test_a_drive_that_was_held_down_on_the_socket_before_begins_no_press() -> None:
    driver = deadman()
    driver.pressed = True
    assert not given(driver, 1.0)
    assert not given(driver, 0.0)
    assert given(driver, 1.0)
