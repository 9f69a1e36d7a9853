"""Back into the order of time: what the bus brings late, twice or not at all."""

import numpy as np

from snakeslam.geometry import se3, so3
from snakeslam.messages import (
    CameraFrame,
    Health,
    ImuSample,
    JointState,
    JointTarget,
    MapChunk,
    PoseEstimate,
    SlamUpdate,
    Verdict,
)
from snakeslam.runtime.bus.wire import Sensors
from snakeslam.runtime.process.clock import RobotClock
from snakeslam.runtime.slam.continuation import WorldContinuation
from snakeslam.runtime.slam.merge import LONGEST_WAIT_NS, Merge

MS = 1_000_000
ZERO = np.zeros(3)
GRAY = np.zeros((2, 2), np.uint8)


def period(k: int) -> Sensors:
    """Return control period ``k``: samples at 10 k + 5 and 10 k + 10 ms."""
    imu = tuple(ImuSample((10 * k + ms) * MS, ZERO, ZERO) for ms in (5, 10))
    joints = JointState((10 * k + 10) * MS, ZERO, ZERO, ZERO, ZERO)
    return Sensors("boot", k, 0, imu, joints, JointTarget(10 * k * MS, ZERO), ())


def frame(t_ms: int) -> CameraFrame:
    return CameraFrame(t_ms * MS, 0, GRAY)


def words(items: list) -> list[tuple[str, int]]:
    return [(type(item).__name__, item.t_ns // MS) for item in items]


def test_a_frame_follows_the_samples_up_to_its_stamp_and_precedes_the_later_ones() -> None:
    merge = Merge()
    for k in range(3):
        assert merge.add_sensors(period(k)) == []
    assert words(merge.add_frame(frame(15))) == [
        ("JointTarget", 0), ("ImuSample", 5), ("ImuSample", 10), ("JointState", 10),
        ("JointTarget", 10), ("ImuSample", 15), ("CameraFrame", 15),
    ]  # fmt: skip
    assert words(merge.add_frame(frame(20)))[0] == ("ImuSample", 20)


def test_a_frame_waits_for_its_samples() -> None:
    merge = Merge()
    merge.add_sensors(period(0))
    assert not merge.ready(frame(15))
    merge.add_sensors(period(1))
    assert merge.ready(frame(15))


def test_samples_do_not_wait_for_ever_and_a_frame_that_is_later_is_dropped() -> None:
    merge, given = Merge(), []
    for k in range(LONGEST_WAIT_NS // (10 * MS) + 10):
        given += merge.add_sensors(period(k))
    assert [item.t_ns for item in given] == sorted(item.t_ns for item in given)
    assert 50 * MS < given[-1].t_ns <= 100 * MS
    assert merge.add_frame(frame(20)) == []
    assert words(merge.add_frame(frame(500)))[-1] == ("CameraFrame", 500)


def test_what_never_came_is_counted() -> None:
    merge = Merge()
    for k in (4, 5, 9):
        merge.add_sensors(period(k))
    assert merge.lost == 3


def pose(yaw_rad: float, p_W: list[float], tilt_rad: float = 0.0) -> PoseEstimate:
    R = so3.from_yaw(yaw_rad) @ so3.exp(np.array([tilt_rad, 0.0, 0.0]))
    cov = np.diag(np.arange(1.0, 10.0))
    return PoseEstimate(1, se3.from_rt(R, np.array(p_W)), np.array([1.0, 0.0, 0.0]), cov, Health(Verdict.GOOD))


def update(estimate: PoseEstimate | None) -> SlamUpdate:
    chunk = MapChunk(3, 1, np.eye(4), np.zeros((1, 3), np.float32), np.zeros((1, 3), np.uint8))
    none = np.zeros(0)
    return SlamUpdate(1, 1, estimate, Health(Verdict.GOOD), np.zeros((0, 2)), none, none, (chunk,))


def test_a_slam_that_is_started_again_continues_in_the_old_world() -> None:
    last = pose(0.5, [3.0, 1.0, 0.1], tilt_rad=0.2)
    continuation = WorldContinuation(last, first_key=700)
    assert continuation.moved(update(None)).chunks == ()
    first = continuation.moved(update(pose(0.0, [0.0, 0.0, 0.0], tilt_rad=0.2)))
    assert first.pose is not None
    assert np.allclose(first.pose.T_WI, last.T_WI)
    assert [chunk.key for chunk in first.chunks] == [703]
    ahead = continuation.moved(update(pose(0.0, [1.0, 0.0, 0.0])))
    assert ahead.pose is not None
    forward_W = np.array([np.cos(0.5), np.sin(0.5), 0.0])
    assert np.allclose(ahead.pose.T_WI[:3, 3], last.T_WI[:3, 3] + forward_W)
    assert np.allclose(ahead.pose.v_W, forward_W)
    assert np.allclose(np.diag(ahead.pose.cov)[[0, 1, 2, 5, 8]], [1.0, 2.0, 3.0, 6.0, 9.0])
    assert np.isclose(forward_W @ ahead.pose.cov[3:6, 3:6] @ forward_W, 4.0)


def test_without_one_before_nothing_is_moved() -> None:
    plain = update(pose(0.3, [1.0, 2.0, 3.0]))
    assert WorldContinuation(None, 50).moved(plain) is plain


def test_the_robots_clock_is_read_behind_by_the_least_delay_and_never_ahead() -> None:
    rng, now_ns = np.random.default_rng(1), 0
    clock = RobotClock(lambda: now_ns)
    assert clock.now_ns() is None
    ahead_ns = 10**15
    for k in range(1, 400):
        sent_ns = k * 50 * MS
        now_ns = sent_ns + round(float(rng.exponential(20.0)) * MS) + 2 * MS
        clock.add(sent_ns + ahead_ns)
        read_ns = clock.now_ns()
        assert read_ns is not None
        assert read_ns <= now_ns + ahead_ns - 2 * MS
        if k > 100:
            assert read_ns >= now_ns + ahead_ns - 10 * MS


def test_a_clock_that_drifts_is_followed() -> None:
    now_ns = 0
    clock = RobotClock(lambda: now_ns)
    for k in range(1000):
        now_ns = k * 50 * MS
        clock.add(round(now_ns * (1.0 - 1e-3)))
    read_ns = clock.now_ns()
    assert read_ns is not None
    assert abs(read_ns - now_ns * (1.0 - 1e-3)) < 11 * MS
