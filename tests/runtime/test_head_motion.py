"""The head's motion, against motions that are known."""

from itertools import pairwise

import numpy as np
import pytest

from snakeslam.geometry import so3
from snakeslam.messages import Float, Health, ImuSample, PoseEstimate, Verdict
from snakeslam.runtime.view.head_motion import HeadMotionMeter
from snakeslam.studies.metrics import head_motion
from snakeslam.studies.trajectories import Trajectory

PERIOD_S = 4.0
SWING_RAD = np.deg2rad(40.0)
SWAY_M = 0.2
COURSE_RAD = np.pi / 6


def swinging(t_s: float, speed_m_s: float = 0.1, course_rad: float = COURSE_RAD) -> Float:
    """Return T_WI of a moving head whose yaw and lateral position swing with the gait."""
    phase = 2 * np.pi * t_s / PERIOD_S
    T = np.eye(4)
    T[:3, :3] = so3.from_yaw(course_rad + SWING_RAD * np.cos(phase))
    T[:3, 3] = so3.from_yaw(course_rad) @ [speed_m_s * t_s, SWAY_M * np.sin(phase), 0.1]
    return T


def watched(until_s: float, rate_hz: float = 20.0, gyro: bool = False, **motion: float) -> HeadMotionMeter:
    meter = HeadMotionMeter(PERIOD_S)
    times = np.arange(0.0, until_s, 1.0 / rate_hz)
    for before, t_s in pairwise(times):
        for k in range(10 if gyro else 0):
            at = before + (t_s - before) * (k + 1) / 10
            rate = -SWING_RAD * 2 * np.pi / PERIOD_S * np.sin(2 * np.pi * at / PERIOD_S)
            meter.on_imu(ImuSample(round(at * 1e9), np.array([0.0, 0.0, rate]), np.zeros(3)))
        T = swinging(float(t_s), **motion)
        meter.on_pose(PoseEstimate(round(t_s * 1e9), T, np.zeros(3), np.eye(9), Health(Verdict.GOOD)))
    return meter


@pytest.mark.parametrize("until_s", [12.0, 12.6, 13.3])
def test_a_swing_has_no_part_in_the_mean(until_s: float) -> None:
    motion = watched(until_s).motion()
    last_s = until_s - 0.05
    assert motion.heading_deg == pytest.approx(30.0, abs=0.2)
    assert motion.yaw_deg == pytest.approx(40.0 * np.cos(2 * np.pi * last_s / PERIOD_S), abs=0.3)
    assert motion.yaw_rms_deg == pytest.approx(40.0 / np.sqrt(2), abs=0.2)
    assert motion.sway_m == pytest.approx(2 * SWAY_M, rel=0.03)
    assert motion.window_s == PERIOD_S


def test_the_page_shows_what_a_study_measures() -> None:
    t_s = np.arange(0.0, 12.0, 0.05)
    poses = Trajectory(np.round(t_s * 1e9).astype(np.int64), np.array([swinging(float(t)) for t in t_s]))
    study, live = head_motion(poses.at(t_s >= 7.9), PERIOD_S), watched(12.0).motion()
    assert live.yaw_rms_deg == pytest.approx(study.yaw_rms_deg, rel=0.02)
    assert live.sway_m == pytest.approx(study.sway_pp_m, rel=0.02)
    assert live.peak_yaw_rate_deg_s == pytest.approx(study.peak_yaw_rate_deg_s, rel=0.02)


def test_the_gyroscope_gives_the_peak_rate_of_one_period_and_not_of_before() -> None:
    meter = watched(12.0, gyro=True)
    peak = np.rad2deg(SWING_RAD) * 2 * np.pi / PERIOD_S
    assert meter.motion().peak_yaw_rate_deg_s == pytest.approx(peak, rel=0.01)
    for t_s in np.arange(12.0, 12.0 + 1.2 * PERIOD_S, 0.005):
        meter.on_imu(ImuSample(round(t_s * 1e9), np.zeros(3), np.zeros(3)))
    assert meter.motion().peak_yaw_rate_deg_s == pytest.approx(0.0, abs=1e-9)


def test_one_spike_of_a_sample_is_no_peak() -> None:
    """20 ms hold four samples of 200 Hz."""
    meter = HeadMotionMeter(PERIOD_S)
    for k in range(200):
        rate = np.deg2rad(80.0) if k == 100 else 0.0
        meter.on_imu(ImuSample(5_000_000 * k, np.array([0.0, 0.0, rate]), np.zeros(3)))
    assert meter.motion().peak_yaw_rate_deg_s == pytest.approx(20.0, abs=0.1)


def test_a_heading_across_the_back_is_no_jump() -> None:
    motion = watched(12.0, course_rad=np.pi).motion()
    assert motion.heading_deg is not None
    assert abs(motion.heading_deg) == pytest.approx(180.0, abs=0.3)
    assert motion.yaw_rms_deg == pytest.approx(40.0 / np.sqrt(2), abs=0.2)


def test_without_travel_sway_is_across_the_mean_heading() -> None:
    assert watched(12.0, speed_m_s=0.0).motion().sway_m == pytest.approx(2 * SWAY_M, rel=0.02)


def test_a_new_period_is_the_new_window() -> None:
    meter = watched(12.0)
    meter.period_s = PERIOD_S / 2
    meter.on_pose(PoseEstimate(round(12e9), swinging(12.0), np.zeros(3), np.eye(9), Health(Verdict.GOOD)))
    motion = meter.motion()
    assert motion.window_s == PERIOD_S / 2
    # Half a swing only, from one side to the other.
    assert motion.sway_m is not None
    assert motion.sway_m < 1.3 * SWAY_M


def test_nothing_is_said_before_there_is_enough() -> None:
    empty = HeadMotionMeter(PERIOD_S).motion()
    assert (empty.yaw_deg, empty.yaw_rms_deg, empty.yaw_rate_deg_s, empty.sway_m) == (None, None, None, None)
    meter = watched(12.0)
    meter.restart()
    assert meter.motion() == empty
