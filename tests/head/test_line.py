"""The line of the head: late estimates carried on by the gyroscope, jumps, turns."""

import numpy as np
import pytest

from snakeslam.head.line import CORRECTION_S, JUMP_M, JUMP_RAD, STEERING_RATE_RAD_S, HeadLine
from tests.head.plane import gyro, pose_estimate

STEP_NS = 10_000_000
DT_S = 0.01
V = np.array([0.2, 0.05])


def yaw_at(t_s):
    return 0.4 * np.sin(2.0 * t_s)


def rate_at(t_s):
    return 0.8 * np.cos(2.0 * t_s)


def estimate(k, jump_rad=0.0, jump_W=(0.0, 0.0)):
    """The truth at step ``k``: on a straight course, the head swinging."""
    c, s = np.cos(jump_rad), np.sin(jump_rad)
    R = np.array([[c, -s], [s, c]])
    return pose_estimate(
        k * STEP_NS, *(R @ (V * k * DT_S) + jump_W), yaw=yaw_at(k * DT_S) + jump_rad, v=tuple(R @ V)
    )  # fmt: skip


def follow(line, start, stop, delay=12, every=5, world=estimate):
    for k in range(start, stop):
        newest = (k - delay) // every * every
        pose = world(newest) if delay is not None and newest >= 0 else None
        line.update(k * STEP_NS, pose, gyro(k * STEP_NS, rate_at(k * DT_S)))
    return line


def lay(line, turned_rad, offset_H):
    """Lay the line at an angle to the head, through a point in the head's level frame."""
    yaw = line.heading_rad + line.errors.yaw_rad
    c, s = np.cos(yaw), np.sin(yaw)
    line.lay(yaw + turned_rad, np.array([[c, -s], [s, c]]) @ offset_H)


@pytest.mark.parametrize("delay", [0, 5, 15, 40])
def test_late_estimates_are_carried_on_to_now(delay):
    line = follow(HeadLine(), 0, 100, delay)
    lay(line, 0.0, np.array([0.0, -0.1]))
    assert line.heading_rad == pytest.approx(yaw_at(0.99), abs=1e-3)
    heading, at = line.heading_rad, V * 0.99
    across = np.array([-np.sin(heading), np.cos(heading)])
    assert line.errors.lateral_m == pytest.approx(0.1, abs=1e-9)
    for k in range(100, 300):
        follow(line, k, k + 1, delay)
        assert line.errors.yaw_rad == pytest.approx(yaw_at(k * DT_S) - heading, abs=2e-3)
        assert line.errors.lateral_m == pytest.approx(0.1 + across @ (V * k * DT_S - at), abs=1e-6)


@pytest.mark.parametrize("delay", [0, 15])
def test_the_first_estimate_moves_the_line_not_the_errors(delay):
    """However late it is: the gyroscope has seen what happened since."""
    line = HeadLine()
    for k in range(60):
        line.update(k * STEP_NS, None, gyro(k * STEP_NS, rate_at(k * DT_S)))
    lay(line, -0.2, np.zeros(2))
    before = line.errors
    assert before.yaw_rad == pytest.approx(0.2)
    line.update(60 * STEP_NS, estimate(60 - delay, 1.9, (4.0, -3.0)), gyro(60 * STEP_NS, rate_at(0.6)))
    moved = yaw_at(0.6) - yaw_at(0.59)
    assert line.errors.yaw_rad == pytest.approx(before.yaw_rad + moved, abs=1e-3)
    assert abs(line.errors.lateral_m) < 0.02 + 0.21 * delay * DT_S
    assert line.heading_rad == pytest.approx(1.9 + yaw_at(0.59) - 0.2, abs=3e-3)


@pytest.mark.parametrize("jump_rad", [0.0, 0.5, -2.8])
@pytest.mark.parametrize("jump_W", [(0.0, 0.0), (2.0, -1.0)])
def test_a_jump_of_the_estimate_moves_the_line_not_the_errors(jump_rad, jump_W):
    steady, jumped = (follow(HeadLine(), 0, 100) for _ in range(2))
    for line in (steady, jumped):
        lay(line, 0.1, np.array([0.0, -0.05]))
    follow(steady, 100, 200)
    follow(jumped, 100, 200, world=lambda k: estimate(k, jump_rad, jump_W))
    assert jumped.errors.yaw_rad == pytest.approx(steady.errors.yaw_rad, abs=1e-6)
    assert jumped.errors.lateral_m == pytest.approx(steady.errors.lateral_m, abs=1e-6)
    turned = jumped.heading_rad - steady.heading_rad
    assert np.sin(turned - jump_rad) == pytest.approx(0.0, abs=1e-6)


def test_a_small_correction_is_an_error_to_be_steered_out_without_a_jerk():
    steady, corrected = (follow(HeadLine(), 0, 100) for _ in range(2))
    yaw, aside = 0.5 * JUMP_RAD, np.array([0.0, 0.5 * JUMP_M])
    for line in (steady, corrected):
        lay(line, -yaw_at(0.99), np.zeros(2))
        follow(line, 100, 112)
    late = estimate(100)
    line = corrected
    line.update(
        112 * STEP_NS,
        pose_estimate(late.t_ns + 1, *(late.T_WI[:2, 3] + aside), yaw=yaw_at(1.0) + yaw, v=tuple(V)),
        gyro(112 * STEP_NS, rate_at(1.12)),
    )
    follow(steady, 112, 113)
    assert line.heading_rad == steady.heading_rad
    assert line.errors.yaw_rad - steady.errors.yaw_rad == pytest.approx(yaw, abs=1e-4)
    assert line.errors.lateral_m == pytest.approx(steady.errors.lateral_m, abs=1e-4)
    for k in range(113, 138):
        line.update(k * STEP_NS, None, gyro(k * STEP_NS, rate_at(k * 0.01)))
    follow(steady, 113, 138)
    come_in = aside[1] * (1.0 - np.exp(-0.26 / CORRECTION_S))
    assert line.errors.lateral_m - steady.errors.lateral_m == pytest.approx(come_in, rel=0.05)


def still(line, start, stop, pose=None):
    for k in range(start, stop):
        line.update(k * STEP_NS, pose, gyro(k * STEP_NS, 0.0))
    return line


@pytest.mark.parametrize("angle_rad", [0.7, -0.3])
@pytest.mark.parametrize("pose", [None, pose_estimate(0, 1.0, 2.0, 0.3)], ids=["gyro", "estimate"])
def test_it_turns_at_its_rate_about_the_head(angle_rad, pose):
    line = still(HeadLine(), 0, 10, pose)
    lay(line, 0.0, np.array([0.0, -0.2]))
    before = line.errors
    start = line.heading_rad
    line.steer_by(angle_rad)
    still(line, 10, 110, pose)
    step = np.copysign(min(abs(angle_rad), STEERING_RATE_RAD_S), angle_rad)
    assert line.heading_rad - start == pytest.approx(step, abs=1e-9)
    assert line.errors.lateral_m == pytest.approx(before.lateral_m, abs=1e-9)
    still(line, 110, 700, pose)
    assert line.heading_rad - start == pytest.approx(angle_rad, abs=1e-9)
    assert line.errors.yaw_rad == pytest.approx(-angle_rad, abs=1e-9)
    assert line.errors.lateral_m == pytest.approx(before.lateral_m, abs=1e-9)


def test_it_turns_by_estimates_alone_too():
    line = HeadLine()
    for k in range(100):
        line.update(k * STEP_NS, pose_estimate(k * STEP_NS), None)
        if k == 49:
            line.steer_by(-1.0)
    assert line.errors.yaw_rad == pytest.approx(50 * DT_S * STEERING_RATE_RAD_S)


def test_laying_it_anew_forgets_a_turn():
    line = still(HeadLine(), 0, 10)
    line.steer_by(1.0)
    lay(line, 0.0, np.zeros(2))
    assert still(line, 10, 100).heading_rad == 0.0


def test_without_any_estimate_the_gyroscope_alone_holds_the_heading():
    line = HeadLine()
    assert line.errors.yaw_rad == line.errors.lateral_m == 0.0
    for k in range(400):
        line.update(k * STEP_NS, None, gyro(k * STEP_NS, rate_at(k * DT_S)))
    assert line.errors.yaw_rad == pytest.approx(yaw_at(3.99), abs=1e-3)
    assert line.errors.lateral_m == 0.0


def test_the_turn_is_the_one_about_the_vertical():
    """A head that looks up by 40 deg and turns about the world's z."""
    tilted = pose_estimate(0)
    c, s = np.cos(0.7), np.sin(0.7)
    T_WI = tilted.T_WI.copy()
    T_WI[:3, :3] = [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]
    pose = type(tilted)(0, T_WI, np.zeros(3), np.eye(9), tilted.health)
    line = HeadLine()
    for k in range(101):
        sample = gyro(k * STEP_NS, 0.0)
        line.update(k * STEP_NS, pose, type(sample)(sample.t_ns, T_WI[2, :3] * 0.3, sample.accel_I))
    assert line.errors.yaw_rad == pytest.approx(0.3, abs=2e-3)
