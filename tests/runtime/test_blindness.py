"""How long a moving robot may see nothing."""

import pytest

from snakeslam.config import SafetySettings
from snakeslam.messages import Health, Verdict
from snakeslam.runtime.robot.blindness import Blindness

FRAME_S = 0.05
SEEN, BLIND = Health(Verdict.GOOD, tracks=150), Health(Verdict.BLIND)
STATIONARY = Health(Verdict.DEGRADED, ("few features: 0",), tracks=0)


def watch(max_blind_s: float = 5.0) -> Blindness:
    return Blindness(SafetySettings(max_blind_s=max_blind_s), min_features=5)


def show(blindness: Blindness, from_s: float, to_s: float, health: Health) -> None:
    for k in range(round((to_s - from_s) / FRAME_S)):
        blindness.add(round((from_s + k * FRAME_S) * 1e9), health)


def too_long(blindness: Blindness, t_s: float) -> bool:
    return blindness.too_long(round(t_s * 1e9))


def test_the_limit_counts_from_the_first_blind_image() -> None:
    blindness = watch()
    show(blindness, 0.0, 2.0, SEEN)
    show(blindness, 2.0, 8.0, BLIND)
    assert not too_long(blindness, 6.99)
    assert too_long(blindness, 7.01)


@pytest.mark.parametrize(("seen_s", "counts"), [(0.1, False), (0.5, True)])
def test_sight_must_last_to_count(seen_s: float, counts: bool) -> None:
    blindness = watch()
    show(blindness, 0.0, 4.0, BLIND)
    show(blindness, 4.0, 4.0 + seen_s, SEEN)
    show(blindness, 4.0 + seen_s, 6.0, BLIND)
    assert too_long(blindness, 6.0) is not counts


def test_a_start_and_a_back_up_give_time() -> None:
    blindness = watch()
    show(blindness, 0.0, 6.0, BLIND)
    blindness.hold()
    blindness.back_up(round(6e9))
    assert not too_long(blindness, 9.0)
    assert not blindness.backed_up(round(9.9e9))
    assert blindness.backed_up(round(10e9))
    blindness.end_back_up()
    assert too_long(blindness, 10.1)
    blindness.start(round(11e9))
    assert not too_long(blindness, 15.9)
    assert too_long(blindness, 16.1)


def test_a_robot_that_is_certain_only_because_it_is_stationary_sees_nothing() -> None:
    blindness = watch()
    show(blindness, 0.0, 6.0, BLIND)
    blindness.hold()
    show(blindness, 6.0, 8.0, STATIONARY)
    assert blindness.held
    show(blindness, 8.0, 9.0, SEEN)
    assert not blindness.held


def test_zero_is_never() -> None:
    blindness = watch(0.0)
    show(blindness, 0.0, 100.0, BLIND)
    assert not too_long(blindness, 1000.0)
