"""How a recording plays: which frame comes next and when, by a clock of the test's own."""

import pytest

from snakeslam.runtime.bus.commands import ControlPlayback
from snakeslam.runtime.session.playback import Player

FRAMES, PERIOD_NS = 100, 50_000_000


class Clock:
    """Wall time that passes when the test says so."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def make() -> tuple[Player, Clock]:
    clock = Clock()
    return Player([7 + PERIOD_NS * k for k in range(FRAMES)], clock), clock


def play(player: Player, clock: Clock, seconds: float) -> list[int]:
    """Show what is due for so long; return the frames."""
    until, shown = clock.now_s + seconds, []
    while clock.now_s < until - 1e-6:
        k = player.next()
        if k is None:
            clock.now_s = until
            break
        shown.append(k)
        player.on_shown(k)
        clock.now_s += player.wait_s()
    return shown


@pytest.mark.parametrize(("speed", "frames"), [(1.0, 20), (2.0, 40), (0.5, 10)])
def test_frames_come_in_the_recordings_own_time_multiplied_by_the_speed(speed: float, frames: int) -> None:
    player, clock = make()
    player.control(ControlPlayback(speed=speed))
    shown = play(player, clock, 1.0)
    assert abs(len(shown) - frames) <= 1
    assert shown == list(range(len(shown)))
    assert player.pace == pytest.approx(speed, rel=0.15)


def test_paused_it_shows_nothing_and_goes_on_where_it_was() -> None:
    player, clock = make()
    play(player, clock, 0.5)
    player.control(ControlPlayback(paused=True))
    before = player.shown
    assert play(player, clock, 60.0) == []
    player.control(ControlPlayback(paused=False))
    assert play(player, clock, 0.2)[0] == before + 1


def test_seeking_ahead_computes_every_frame_without_waiting() -> None:
    player, clock = make()
    play(player, clock, 0.2)
    player.control(ControlPlayback(paused=True, position_s=2.0))
    started_s = clock.now_s
    shown = play(player, clock, 1e-3)
    assert clock.now_s - started_s < 0.01
    assert shown == list(range(shown[0], 41))
    assert (player.shown, player.seeking, player.paused) == (40, False, True)


def test_seeking_back_shows_that_frame_and_computes_nothing() -> None:
    player, clock = make()
    play(player, clock, 2.0)
    computed = player.computed
    player.control(ControlPlayback(position_s=0.52))
    assert player.next() == 10
    assert play(player, clock, 0.1)[0] == 10
    assert player.computed == computed
    assert player.state().seeks == 1


def test_steps_add_up_and_pause_and_stay_inside() -> None:
    player, clock = make()
    play(player, clock, 1.0)
    before = player.shown
    for _ in range(3):
        player.control(ControlPlayback(step=-1))
    play(player, clock, 1.0)
    assert (player.shown, player.paused) == (before - 3, True)
    player.control(ControlPlayback(step=-1000))
    play(player, clock, 1.0)
    assert player.shown == 0
    player.control(ControlPlayback(step=1000))
    play(player, clock, 1.0)
    assert (player.shown, player.at_end) == (FRAMES - 1, True)


def test_frames_that_are_no_longer_kept_are_not_asked_for() -> None:
    player, clock = make()
    play(player, clock, 2.0)
    player.oldest = 15
    player.control(ControlPlayback(position_s=0.0))
    assert player.next() == 15


def test_play_at_the_end_begins_anew() -> None:
    player, clock = make()
    play(player, clock, 60.0)
    assert player.at_end
    assert play(player, clock, 5.0) == []
    player.control(ControlPlayback(paused=False))
    assert not player.at_end
    assert play(player, clock, 0.2)[:2] == [0, 1]


def test_a_machine_that_is_too_slow_does_not_race_afterwards() -> None:
    player, clock = make()
    play(player, clock, 0.2)
    clock.now_s += 10.0
    assert len(play(player, clock, 0.5)) <= 12
