"""The server's memory of the E-stop."""

from snakeslam.runtime.session.estop import EStopMemory


def test_the_first_reason_is_kept_until_it_is_cleared() -> None:
    memory = EStopMemory()
    memory.report(None)
    assert memory.reason is None
    memory.latch("button")
    memory.latch("another")
    memory.report("robot")
    assert memory.reason == "button"
    memory.clear(memory.latched)
    assert memory.reason is None


def test_an_estop_during_a_reset_is_not_cleared_by_it() -> None:
    memory = EStopMemory()
    memory.latch("first")
    latched = memory.latched
    memory.latch("again")
    memory.clear(latched)
    assert memory.reason == "first"


def test_a_robot_that_is_found_latched_is_known() -> None:
    memory = EStopMemory()
    memory.report("from before")
    assert memory.reason == "from before"
