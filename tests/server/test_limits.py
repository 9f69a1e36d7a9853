"""How often one caller may ask."""

from server.limits import MAX_CALLERS, Limiter, Rate, Rates


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def limiter(clock: Clock) -> Limiter:
    return Limiter(Rates(read=Rate(5.0, 2.0), write=Rate(1.0, 1.0)), clock)


def test_a_burst_then_a_steady_rate() -> None:
    clock = Clock()
    limits = limiter(clock)
    assert [limits.allows("read", "a") for _ in range(6)] == [True] * 5 + [False]
    clock.now_s = 1.0
    assert [limits.allows("read", "a") for _ in range(3)] == [True, True, False]
    clock.now_s = 1000.0
    assert sum(limits.allows("read", "a") for _ in range(100)) == 5


def test_callers_and_kinds_do_not_share() -> None:
    limits = limiter(Clock())
    assert [limits.allows("write", who) for who in ("a", "b", "a")] == [True, True, False]
    assert limits.allows("read", "a")


def test_the_number_of_callers_remembered_is_bounded_and_a_flood_gains_nothing() -> None:
    clock = Clock()
    limits = limiter(clock)
    assert limits.allows("write", "busy")
    for k in range(MAX_CALLERS - 1):
        limits.allows("write", f"other {k}")
    assert not limits.allows("write", "busy")
    clock.now_s = 3600.0
    limits.allows("write", "one more")
    assert len(limits._buckets) == 1
