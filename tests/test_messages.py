"""Messages cannot be changed after they are made."""

import dataclasses

import numpy as np
import pytest

from snakeslam.messages import CameraFrame, GroundTruth, Health, ImuSample, PoseEstimate, Verdict


def test_arrays_are_read_only_and_of_the_declared_type() -> None:
    sample = ImuSample(1, np.array([1, 2, 3]), np.array([0.0, 0.0, 9.81]))
    assert sample.gyro_I.dtype == np.float64
    with pytest.raises(ValueError, match="read-only"):
        sample.gyro_I[0] = 5.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        sample.t_ns = 2  # type: ignore[misc]


def test_the_sender_keeps_its_own_array_writable() -> None:
    gray = np.zeros((2, 3), dtype=np.uint8)
    frame = CameraFrame(0, 0, gray)
    gray[0, 0] = 7
    assert gray.flags.writeable
    assert not frame.gray.flags.writeable


def test_unknown_parts_stay_none() -> None:
    assert CameraFrame(0, 0, np.zeros((2, 2), np.uint8)).depth_m is None
    assert GroundTruth(0, np.eye(4)).v_W is None


@pytest.mark.parametrize("verdict", list(Verdict))
def test_tracked_means_that_the_camera_supports_the_pose(verdict: Verdict) -> None:
    assert verdict.tracked == (verdict.value in {"good", "degraded"})


def test_messages_have_no_further_attributes() -> None:
    pose = PoseEstimate(0, np.eye(4), np.zeros(3), np.eye(9), Health(Verdict.GOOD))
    with pytest.raises((AttributeError, TypeError)):
        pose.extra = 1  # type: ignore[attr-defined]
