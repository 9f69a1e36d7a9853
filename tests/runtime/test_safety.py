"""The guard: the last word on every joint target."""

import numpy as np
import pytest

from snakeslam.messages import Float, JointTarget
from snakeslam.robot.limits import JointLimits
from snakeslam.runtime.safety import RESUME_S, STEP_S, Guard

LIMITS = JointLimits(position_rad=1.5, rate_rad_s=6.0, acceleration_rad_s2=40.0)
AMPLITUDE_RAD, OMEGA = np.array([0.5, 1.0]), 2.0 * np.pi / 2.0


def gait(step: int) -> JointTarget:
    """A wave that is fast but within the limits."""
    return JointTarget(step * 10_000_000, AMPLITUDE_RAD * np.sin(OMEGA * step * STEP_S + np.array([0.0, 1.0])))


def run(guard: Guard, steps: range) -> Float:
    return np.array([guard.step(gait(k)).q_rad for k in steps])


def test_it_passes_everything_on_until_it_is_latched() -> None:
    assert np.array_equal(run(Guard(LIMITS), range(50)), [gait(k).q_rad for k in range(50)])


def test_the_first_target_after_the_latch_brakes_already() -> None:
    guard = Guard(LIMITS)
    q = run(guard, range(40))
    speed = np.abs(q[-1] - q[-2]) / STEP_S
    guard.latch("test")
    after = np.vstack([q[-2:], run(guard, range(40, 120))])
    rates = np.abs(np.diff(after, axis=0)) / STEP_S
    expected = np.maximum(speed - LIMITS.acceleration_rad_s2 * STEP_S, 0.0)
    assert np.allclose(rates[1], expected)
    assert np.all(np.diff(rates, axis=0) <= 1e-9)
    # 1 rad at 0.5 Hz is 3.14 rad/s at most: at rest within 80 ms.
    assert np.all(rates[9:] == 0.0)


def test_braking_stays_within_the_joints_range() -> None:
    guard = Guard(LIMITS)
    for k in range(20):
        guard.step(JointTarget(k, np.full(2, 1.5 - 0.05 * (20 - k))))
    guard.latch("test")
    held = [guard.step(JointTarget(k, np.zeros(2))).q_rad for k in range(50)]
    assert np.max(held) <= 1.5


def test_clearing_it_moves_nothing_however_long() -> None:
    guard = Guard(LIMITS)
    run(guard, range(40))
    guard.latch("test")
    held = run(guard, range(40, 140))[-1]
    guard.reset()
    assert guard.reason is None
    assert np.array_equal(run(guard, range(140, 700)), np.tile(held, (560, 1)))


def test_it_resumes_only_when_told_and_without_a_jerk() -> None:
    guard = Guard(LIMITS)
    run(guard, range(40))
    guard.latch("test")
    run(guard, range(40, 140))
    guard.resume()
    held = guard.step(gait(140)).q_rad
    assert np.array_equal(guard.step(gait(141)).q_rad, held), "a latched guard does not resume"
    guard.reset()
    guard.resume()
    q = np.vstack([held, run(guard, range(142, 142 + round(RESUME_S / STEP_S) + 50))])
    rates = np.diff(q, axis=0) / STEP_S
    assert np.max(np.abs(rates)) <= LIMITS.rate_rad_s + 1e-9
    assert np.max(np.abs(np.diff(rates, axis=0))) / STEP_S <= LIMITS.acceleration_rad_s2 + 1e-6
    assert np.allclose(q[-1], gait(141 + round(RESUME_S / STEP_S) + 50).q_rad)


def test_made_latched_it_never_leaves_the_first_posture() -> None:
    guard = Guard(LIMITS, "from before")
    assert guard.reason == "from before"
    assert np.array_equal(run(guard, range(50)), np.tile(gait(0).q_rad, (50, 1)))


def test_the_first_reason_stays() -> None:
    guard = Guard(LIMITS)
    guard.latch("first")
    guard.latch("second")
    assert guard.reason == "first"


@pytest.mark.parametrize("calls", [["reset"], ["resume"], ["reset", "resume"]])
def test_what_is_not_latched_cannot_be_disturbed(calls: list[str]) -> None:
    guard = Guard(LIMITS)
    run(guard, range(10))
    for call in calls:
        getattr(guard, call)()
    assert np.array_equal(run(guard, range(10, 20)), [gait(k).q_rad for k in range(10, 20)])
