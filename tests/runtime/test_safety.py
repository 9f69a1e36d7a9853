"""The robot's safety rules, each with the time given: what is obeyed, what is dropped, what holds the robot."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from snakeslam.messages import GaitCommand, HeadCommand, JointTarget
from snakeslam.robot.limits import JointLimits
from snakeslam.runtime.bus.commands import EStop, ResetEStop, RobotCommand, SetGait, SetHead, Start, Stop
from snakeslam.runtime.bus.wire import SentCommand
from snakeslam.runtime.robot.admission import FUTURE_NS, NOT_FINITE
from snakeslam.runtime.robot.deadman import DEADMAN_NS
from snakeslam.runtime.robot.safety import FROZEN, FROZEN_NS, LATCHED, LOST, SERVER, SLAM, Safety

LIMITS = JointLimits(position_rad=1.5, rate_rad_s=6.0, acceleration_rad_s2=40.0)
MS = 1_000_000
NOW = 10_000 * MS


def order(command: RobotCommand, number: int = 1, stamp_ns: int = NOW, sender: str = "page") -> SentCommand:
    return SentCommand(sender, number, stamp_ns, command)


def alive(now_ns: int = NOW) -> Safety:
    """Return a robot that moves, everything alive."""
    safety = Safety(LIMITS, LOST)
    for name in (SERVER, SLAM):
        safety.on_heartbeat(name, now_ns, now_ns)
    assert safety.start(now_ns) is None
    return safety


def wave(k: int) -> JointTarget:
    return JointTarget(k, np.array([0.5 - 0.5 * np.cos(2.0 * np.pi * k / 200.0)]))


def passed(safety: Safety, first: int, count: int, now_ns: int) -> np.ndarray:
    return np.array([safety.step(wave(first + k), now_ns).q_rad[0] for k in range(count)])


@pytest.mark.parametrize(
    ("stamp_ns", "words"),
    [
        (NOW, None),
        (NOW - DEADMAN_NS, None),
        (NOW - DEADMAN_NS - MS, "301 ms old"),
        (NOW + FUTURE_NS, None),
        (NOW + FUTURE_NS + MS, "51 ms from the future"),
    ],
)
def test_a_command_is_admitted_only_while_it_is_recent(stamp_ns: int, words: str | None) -> None:
    refusal = Safety(LIMITS, {}).refusal(order(Start(), stamp_ns=stamp_ns), NOW)
    assert (refusal is None) if words is None else (refusal is not None and words in refusal)


@pytest.mark.parametrize("number", [1, 2])
def test_a_command_that_was_overtaken_or_comes_twice_is_dropped(number: int) -> None:
    safety = Safety(LIMITS, {})
    assert safety.refusal(order(Stop(), 2), NOW) is None
    refusal = safety.refusal(order(Start(), number), NOW)
    assert refusal is not None
    assert "later command" in refusal
    assert safety.refusal(order(Start(), 3), NOW) is None
    assert safety.refusal(order(Start(), 1, sender="another"), NOW) is None


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("key", ["drive", "turn", "alpha_pi", "period_s"])
def test_a_command_that_is_not_finite_is_dropped(bad: float, key: str) -> None:
    given = {key: bad} if key in ("drive", "turn") else {"parameters": {key: bad}}
    command = SetGait(GaitCommand(0, "serpentine", **given))
    assert Safety(LIMITS, {}).refusal(order(command), NOW) == NOT_FINITE
    assert Safety(LIMITS, {}).refusal(order(SetHead(HeadCommand(0, turn_by_deg=bad))), NOW) is not None


@pytest.mark.parametrize("command", [EStop("x"), Stop()])
def test_what_can_only_stop_is_obeyed_however_late(command: RobotCommand) -> None:
    safety = Safety(LIMITS, {})
    safety.refusal(order(Start(), 9), NOW)
    for late in (order(command, 3), order(command, 10, 0), order(command, 11, NOW + 10**12)):
        assert safety.refusal(late, NOW) is None


def test_a_late_estop_does_not_let_an_earlier_start_through() -> None:
    safety = Safety(LIMITS, {})
    assert safety.refusal(order(EStop("x"), 5), NOW) is None
    assert safety.refusal(order(Start(), 4), NOW) is not None


def test_a_reset_is_no_stop_it_must_be_recent() -> None:
    assert Safety(LIMITS, {}).refusal(order(ResetEStop(), stamp_ns=NOW - 10**9), NOW) is not None


@pytest.mark.parametrize("silent", [SERVER, SLAM])
def test_a_silent_input_holds_the_robot_within_half_a_second(silent: str) -> None:
    safety = alive()
    other = SLAM if silent == SERVER else SERVER
    q, now_ns = [], NOW
    for k in range(150):
        now_ns = NOW + k * 10 * MS
        safety.on_heartbeat(other, now_ns, now_ns)
        q.append(safety.step(wave(k), now_ns).q_rad[0])
    rates = np.abs(np.diff(q))
    assert rates[20] > 1e-3
    assert np.all(rates[50:] == 0.0)
    assert safety.held_because == LOST[silent]
    assert not safety.moving
    assert safety.estop_reason is None


def test_a_link_that_comes_back_moves_nothing_until_a_start() -> None:
    safety = alive()
    passed(safety, 0, 50, NOW)
    later = NOW + DEADMAN_NS + MS
    held = passed(safety, 50, 50, later)[-1]
    for name in (SERVER, SLAM):
        safety.on_heartbeat(name, later, later)
    assert np.all(passed(safety, 100, 100, later) == held)
    assert safety.start(later) is None
    assert np.ptp(passed(safety, 200, 300, later)) > 0.1


def test_nothing_starts_without_its_inputs() -> None:
    safety = Safety(LIMITS, LOST)
    assert safety.start(NOW) == LOST[SERVER]
    safety.on_heartbeat(SERVER, NOW, NOW)
    assert safety.start(NOW) == LOST[SLAM]
    safety.on_heartbeat(SLAM, NOW, NOW)
    assert safety.start(NOW) is None
    assert safety.moving


def test_heartbeats_that_arrive_late_or_early_keep_nothing_alive() -> None:
    """A link that delays everything by a second is a lost link, however many heartbeats come through it."""
    for offset_ns in (-(10**9), 10**9):
        safety = alive()
        now_ns = NOW + DEADMAN_NS + MS
        safety.on_heartbeat(SERVER, now_ns + offset_ns, now_ns)
        safety.on_heartbeat(SLAM, now_ns, now_ns)
        assert safety.lost(now_ns) == LOST[SERVER]


def test_a_stopped_robot_requires_nothing() -> None:
    """A robot that was stopped is not held for a lost input, and moves again at the next start."""
    safety = alive()
    safety.stop()
    safety.step(wave(0), NOW + 10 * DEADMAN_NS)
    assert safety.held_because is None


def test_a_robot_whose_own_loop_was_frozen_is_held() -> None:
    safety = alive()
    safety.on_iteration(NOW)
    safety.on_iteration(NOW + FROZEN_NS)
    assert safety.moving
    safety.on_iteration(NOW + 2 * FROZEN_NS + MS)
    assert not safety.moving
    assert safety.held_because == FROZEN


def test_an_estop_is_cleared_without_a_move_and_refuses_starts() -> None:
    safety = alive()
    passed(safety, 0, 50, NOW)
    safety.latch("button")
    held = passed(safety, 50, 50, NOW)[-1]
    assert safety.start(NOW) == LATCHED
    safety.reset()
    assert np.all(passed(safety, 100, 200, NOW) == held)
    assert not safety.moving


actions = st.one_of(
    st.tuples(st.just("step"), st.floats(allow_nan=True, allow_infinity=True)),
    st.tuples(st.just("step"), st.floats(-2.0, 2.0)),
    st.tuples(st.just("wait"), st.integers(0, 800)),
    st.tuples(st.sampled_from(["server", "slam"]), st.integers(-500, 500)),
    st.tuples(st.sampled_from(["start", "stop", "latch", "reset"]), st.none()),
)


@settings(max_examples=100, deadline=None)
@given(st.lists(actions, max_size=60))
def test_whatever_happens_it_moves_only_when_started_with_everything_alive(actions: list) -> None:
    safety, now_ns, q, dq = Safety(LIMITS, LOST), NOW, np.zeros(1), 0.0
    safety.step(JointTarget(0, q), now_ns, q)
    for action, value in actions:
        if action == "wait":
            now_ns += value * MS
        elif action in (SERVER, SLAM):
            safety.on_heartbeat(action, now_ns + value * MS, now_ns)
        elif action == "step":
            new = safety.step(JointTarget(0, np.array([value])), now_ns).q_rad
            rate = float(new[0] - q[0]) / 0.01
            assert np.isfinite(rate)
            assert abs(new[0]) <= LIMITS.position_rad
            assert abs(rate) <= LIMITS.rate_rad_s + 1e-9
            assert abs(rate - dq) <= LIMITS.acceleration_rad_s2 * 0.01 + 1e-9
            if safety.held_because is not None:
                assert abs(rate) <= max(abs(dq) - LIMITS.acceleration_rad_s2 * 0.01, 0.0) + 1e-9
            if safety.moving:
                assert safety.lost(now_ns) is None
                assert safety.estop_reason is None
            q, dq = new, rate
        else:
            argument = {"start": [now_ns], "latch": ["x"]}.get(action, [])
            getattr(safety, action)(*argument)
