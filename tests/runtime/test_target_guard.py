"""The target guard: whatever control asks for, the servos get finite targets within the limits, or a hold."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from snakeslam.messages import Float, JointTarget
from snakeslam.robot.limits import JointLimits
from snakeslam.runtime.robot.target_guard import NOT_FINITE, RESUME_S, STEP_S, TargetGuard

LIMITS = JointLimits(position_rad=1.5, rate_rad_s=6.0, acceleration_rad_s2=40.0)
AMPLITUDE_RAD, OMEGA = np.array([0.5, 1.0]), 2.0 * np.pi / 2.0


def gait(step: int) -> JointTarget:
    """A wave that is fast but within the limits, from rest."""
    return JointTarget(step * 10_000_000, AMPLITUDE_RAD * (1.0 - np.cos(OMEGA * step * STEP_S)) / 2.0)


def run(guard: TargetGuard, steps: range) -> Float:
    return np.array([guard.step(gait(k)).q_rad for k in steps])


def test_what_is_within_the_limits_passes_bit_for_bit() -> None:
    """Or a scripted run, whose bytes are compared, could not go through the guard."""
    assert np.array_equal(run(TargetGuard(LIMITS), range(200)), [gait(k).q_rad for k in range(200)])


def test_the_first_target_after_the_latch_brakes_already() -> None:
    guard = TargetGuard(LIMITS)
    q = run(guard, range(40))
    speed = np.abs(q[-1] - q[-2]) / STEP_S
    guard.latch("test")
    after = np.vstack([q[-2:], run(guard, range(40, 120))])
    rates = np.abs(np.diff(after, axis=0)) / STEP_S
    expected = np.maximum(speed - LIMITS.acceleration_rad_s2 * STEP_S, 0.0)
    assert speed.max() > 0.5
    assert np.allclose(rates[1], expected)
    assert np.all(np.diff(rates, axis=0) <= 1e-9)
    assert np.all(rates[9:] == 0.0)


def test_braking_stays_within_the_joints_range() -> None:
    guard = TargetGuard(LIMITS)
    for k in range(40):
        guard.step(JointTarget(k, np.full(2, 1.5)))
    guard.latch("test")
    held = [guard.step(JointTarget(k, np.zeros(2))).q_rad for k in range(50)]
    assert 0.5 < np.max(held) <= 1.5


def test_from_the_fastest_it_is_held_within_a_fifth_of_a_second() -> None:
    guard = TargetGuard(LIMITS)
    q = np.array([guard.step(JointTarget(k, np.array([-1.5 if k < 60 else 1.5]))).q_rad for k in range(85)])
    assert np.abs(np.diff(q, axis=0)).max() / STEP_S > 5.0
    guard.hold("test")
    held = np.array([guard.step(JointTarget(k, np.array([1.5]))).q_rad for k in range(60)])
    assert np.ptp(held[16:]) == 0.0


def test_clearing_it_moves_nothing_however_long() -> None:
    guard = TargetGuard(LIMITS)
    run(guard, range(40))
    guard.latch("test")
    held = run(guard, range(40, 140))[-1]
    guard.reset()
    assert guard.estop_reason is None
    assert np.array_equal(run(guard, range(140, 700)), np.tile(held, (560, 1)))


@pytest.mark.parametrize("how", ["latch", "hold"])
def test_it_resumes_only_on_request_and_without_a_jerk(how: str) -> None:
    guard = TargetGuard(LIMITS)
    run(guard, range(40))
    getattr(guard, how)("test")
    held = run(guard, range(40, 140))[-1]
    if how == "latch":
        guard.resume()
        assert np.array_equal(run(guard, range(140, 142))[-1], held), "a latched guard does not resume"
        guard.reset()
    guard.resume()
    assert guard.held_because is None
    q = np.vstack([held, run(guard, range(142, 142 + round(RESUME_S / STEP_S) + 50))])
    rates = np.diff(q, axis=0) / STEP_S
    assert np.max(np.abs(rates)) <= LIMITS.rate_rad_s + 1e-9
    assert np.max(np.abs(np.diff(rates, axis=0))) / STEP_S <= LIMITS.acceleration_rad_s2 + 1e-6
    assert np.allclose(q[-1], gait(141 + round(RESUME_S / STEP_S) + 50).q_rad)


def test_made_latched_it_never_leaves_the_measured_posture() -> None:
    guard = TargetGuard(LIMITS, "from before")
    assert guard.estop_reason == guard.held_because == "from before"
    measured = np.array([0.3, -0.2])
    guard.start_at(measured)
    assert np.array_equal(run(guard, range(50)), np.tile(measured, (50, 1)))


def test_it_starts_from_the_measured_angles_within_the_limits() -> None:
    guard = TargetGuard(LIMITS)
    guard.start_at(np.array([1.0, -1.0]))
    q = np.vstack([[1.0, -1.0], [guard.step(JointTarget(k, np.zeros(2))).q_rad for k in range(100)]])
    assert np.abs(np.diff(q, axis=0)[0]).max() <= LIMITS.acceleration_rad_s2 * STEP_S**2 + 1e-12
    assert np.allclose(q[-1], 0.0, atol=1e-3)


def test_the_first_reason_stays() -> None:
    guard = TargetGuard(LIMITS)
    guard.latch("first")
    guard.latch("second")
    assert guard.estop_reason == guard.held_because == "first"


def test_an_estop_in_a_hold_keeps_it_from_resuming() -> None:
    guard = TargetGuard(LIMITS)
    held = run(guard, range(40))
    guard.hold("the link")
    guard.latch("the button")
    held = run(guard, range(40, 100))[-1]
    guard.resume()
    assert np.array_equal(run(guard, range(100, 150)), np.tile(held, (50, 1)))
    assert (guard.estop_reason, guard.held_because) == ("the button", "the link")


@pytest.mark.parametrize("calls", [["reset"], ["resume"], ["reset", "resume"]])
def test_what_is_not_latched_cannot_be_disturbed(calls: list[str]) -> None:
    guard = TargetGuard(LIMITS)
    run(guard, range(10))
    for call in calls:
        getattr(guard, call)()
    assert np.allclose(run(guard, range(10, 20)), [gait(k).q_rad for k in range(10, 20)], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_target_that_is_not_finite_is_a_hold(bad: float) -> None:
    guard = TargetGuard(LIMITS)
    before = run(guard, range(40))[-1]
    q = guard.step(JointTarget(40, np.array([0.1, bad]))).q_rad
    assert np.all(np.isfinite(q))
    assert np.abs(q - before).max() < 0.05
    assert guard.held_because == NOT_FINITE
    held = run(guard, range(41, 141))
    assert np.ptp(held[50:], axis=0).max() == 0.0


anything = st.one_of(st.floats(-3.0, 3.0), st.floats(allow_nan=True, allow_infinity=True))
deeds = st.one_of(
    st.tuples(st.just("step"), st.lists(anything, min_size=2, max_size=2)),
    st.tuples(st.just("steps"), st.lists(st.floats(-3.0, 3.0), min_size=2, max_size=2)),
    st.tuples(st.sampled_from(["latch", "hold", "reset", "resume"]), st.none()),
)


@settings(max_examples=80, deadline=None)
@given(st.lists(deeds, max_size=30), st.lists(anything, min_size=2, max_size=2))
def test_whatever_happens_what_leaves_is_finite_and_within_the_limits(deeds: list, first: list[float]) -> None:
    guard = TargetGuard(LIMITS)
    guard.start_at(np.zeros(2))
    q = [np.zeros(2), guard.step(JointTarget(0, np.array(first))).q_rad]
    for deed, value in deeds:
        if deed in ("step", "steps"):
            times = range(1 if deed == "step" else 15)
            q.extend(guard.step(JointTarget(0, np.array(value))).q_rad for _ in times)
        else:
            getattr(guard, deed)(*(["test"] if deed in ("latch", "hold") else []))
    rates = np.diff(q, axis=0, prepend=np.zeros((1, 2))) / STEP_S
    assert np.all(np.isfinite(q))
    assert np.abs(q).max() <= LIMITS.position_rad
    assert np.abs(rates).max() <= LIMITS.rate_rad_s + 1e-9
    assert np.abs(np.diff(rates, axis=0)).max() / STEP_S <= LIMITS.acceleration_rad_s2 + 1e-6
