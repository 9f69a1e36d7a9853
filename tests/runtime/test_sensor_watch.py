"""Streams that stop, or whose stamps cannot be right."""

from collections.abc import Callable

import pytest

from snakeslam.messages import Health, Verdict
from snakeslam.runtime.slam.sensor_watch import CAMERA, IMU, JOINTS, SILENT_NS, SensorWatch, with_faults

STEP_NS = 10_000_000
FRAME_NS = 50_000_000
Stamp = Callable[[int], int]


def run(watch: SensorWatch, from_s: float, to_s: float, stamp: Stamp = lambda t_ns: t_ns, **every_ns: int) -> None:
    """Advance the robot's time; each stream named gives a message every so many ns, the camera's stamped otherwise."""
    for t_ns in range(round(from_s * 1e9), round(to_s * 1e9), STEP_NS):
        watch.advance(t_ns)
        for name, interval_ns in every_ns.items():
            if t_ns % interval_ns == 0:
                watch.add(name, stamp(t_ns) if name == CAMERA else t_ns)


def full() -> SensorWatch:
    watch = SensorWatch([CAMERA, IMU, JOINTS])
    run(watch, 0.0, 3.0, camera=FRAME_NS, IMU=STEP_NS, joints=STEP_NS)
    assert watch.faults() == ()
    assert watch.missing() is None
    return watch


@pytest.mark.parametrize("silent", [CAMERA, IMU, JOINTS])
def test_a_stream_that_stops_is_reported_within_half_a_second_and_cleared_when_it_returns(silent: str) -> None:
    watch = full()
    streams = {CAMERA: FRAME_NS, IMU: STEP_NS, JOINTS: STEP_NS}
    others = {name: every_ns for name, every_ns in streams.items() if name != silent}
    run(watch, 3.0, 3.0 + SILENT_NS * 1e-9 - FRAME_NS * 1e-9, **others)
    assert watch.missing() is None
    run(watch, 3.0, 3.45, **others)
    assert [fault.name for fault in watch.faults()] == [silent]
    assert f"the {silent}" in (watch.missing() or "")
    run(watch, 3.45, 3.55, **streams)
    assert watch.missing() is None


@pytest.mark.parametrize(
    ("stamp", "words"),
    [
        (lambda t_ns: t_ns + 5_000_000_000, "ahead"),
        (lambda t_ns: t_ns - 5_000_000_000, "behind"),
        (lambda t_ns: min(t_ns, 2_950_000_000), "no later"),
    ],
)
def test_images_with_wrong_stamps_are_no_images(stamp: Stamp, words: str) -> None:
    watch = full()
    run(watch, 3.0, 3.5, stamp, camera=FRAME_NS, IMU=STEP_NS, joints=STEP_NS)
    missing = watch.missing() or ""
    assert "the camera is silent" in missing
    assert words in missing


def test_a_slow_camera_is_not_silent_between_its_images() -> None:
    watch = SensorWatch([CAMERA])
    run(watch, 0.0, 6.0, camera=1_000_000_000)
    assert watch.missing() is None
    run(watch, 6.0, 9.1)
    assert watch.missing() is not None


def test_before_the_first_image_nothing_may_move() -> None:
    watch = SensorWatch([CAMERA])
    watch.advance(0)
    assert watch.faults() == ()
    assert watch.missing() == "the camera is silent"


def test_a_verdict_does_not_outlive_its_images() -> None:
    good = Health(Verdict.GOOD, (), tracks=180, innovation=1.0)
    watch = full()
    run(watch, 3.0, 3.5, IMU=STEP_NS, joints=STEP_NS)
    shown = with_faults(good, watch.faults())
    assert (shown.verdict, shown.tracks, shown.innovation) == (Verdict.BLIND, 0, None)
    assert shown.reasons == ("the camera is silent",)
    run(watch, 3.5, 4.0, camera=FRAME_NS, joints=STEP_NS)
    shown = with_faults(good, watch.faults())
    assert (shown.verdict, shown.tracks) == (Verdict.DEGRADED, 180)
    assert with_faults(good, ()) is good


def test_a_silent_camera_does_not_connect_a_new_map() -> None:
    watch = full()
    run(watch, 3.0, 3.5, IMU=STEP_NS, joints=STEP_NS)
    assert not with_faults(Health(Verdict.DEGRADED, map_connected=False), watch.faults()).map_connected
