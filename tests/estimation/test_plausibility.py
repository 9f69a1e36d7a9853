"""Units, signs and axes that are wrong are said in one line, and nothing is tracked with them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from snakeslam.calibration import SensorRig
from snakeslam.config import load_config
from snakeslam.errors import InputError
from snakeslam.estimation.base import FrameEstimate
from snakeslam.estimation.settings import EstimatorSettings
from snakeslam.estimation.start.plausibility import accelerometer_fault, gyro_fault
from snakeslam.estimation.vio.odometry import VisualInertialOdometry
from snakeslam.geometry import se3, so3
from snakeslam.messages import ImuSample
from snakeslam.slam import build_estimator
from tests.estimation.wall import RIG, Wall


def rig(**changes: object) -> SensorRig:
    return RIG.model_copy(update={"cam0": RIG.cam0.model_copy(update=changes)})


def rows(T: np.ndarray) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in T.tolist())


IN_MM = rows(se3.from_rt(RIG.cam0.T_CI[:3, :3], np.array([50.0, -20.0, 10.0])))
CALIBRATIONS = [
    ({"intrinsics": (0.61, 0.95, 0.49, 0.52)}, "focal length"),
    ({"intrinsics": (200.0, 200.0, 140.0, 110.0)}, None),
    ({"intrinsics": (200.0, 200.0, 1159.5, 119.5)}, "principal point"),
    ({"intrinsics": (200e3, 200e3, 159.5, 119.5)}, "focal length"),
    ({"T_cam_imu": IN_MM}, "m away from the IMU"),
]


@pytest.mark.parametrize(("changes", "words"), CALIBRATIONS)
@pytest.mark.parametrize("mode", ["vio", "visual"])
def test_a_calibration_that_no_camera_has_is_refused(changes: dict[str, object], words: str | None, mode: str) -> None:
    settings = load_config().estimator.model_copy(update={"mode": mode})
    if words is None:
        build_estimator(settings, rig(**changes), 0)
        return
    with pytest.raises(InputError, match=words):
        build_estimator(settings, rig(**changes), 0)


def run(spoil: Callable[[ImuSample], ImuSample]) -> list[FrameEstimate]:
    vio = VisualInertialOdometry(EstimatorSettings(), RIG, seed=0)
    packets = Wall(depth=False, start_s=2.0).packets(2.5)
    spoiled = (spoil(p) if isinstance(p, ImuSample) else p for p in packets)
    return [e for e in map(vio.process, spoiled) if e is not None]


FAULTS = [
    (lambda s: replace(s, accel_I=s.accel_I / 9.81), "is it in g"),
    (lambda s: replace(s, gyro_I=s.gyro_I * 180.0 / np.pi), "deg/s"),
]


@pytest.mark.parametrize(("spoil", "words"), FAULTS, ids=["g", "deg"])
def test_a_wrong_unit_is_said_and_nothing_is_tracked(spoil: Callable[[ImuSample], ImuSample], words: str) -> None:
    estimates = run(spoil)
    assert not any(e.pose is not None for e in estimates)
    assert any(words in reason for e in estimates for reason in e.health.reasons)


def test_a_plausible_imu_is_not_suspected() -> None:
    said = [reason for e in run(lambda s: s) for reason in e.health.reasons]
    assert not any("gyro" in reason or "accelerometer" in reason or "extrinsics" in reason for reason in said)


def test_gravity_is_looked_for_in_the_mean(rng: np.random.Generator) -> None:
    def samples(scale: float) -> list[ImuSample]:
        return [
            ImuSample(k * 5_000_000, np.zeros(3), scale * (np.array([0.0, 0.0, 9.81]) + rng.normal(0, 4.0, 3)))
            for k in range(100)
        ]

    assert accelerometer_fault(samples(1.0), 9.81) is None
    assert "is it in g" in (accelerometer_fault(samples(1.0 / 9.81), 9.81) or "")
    assert accelerometer_fault(samples(1e-3), 9.81) is not None
    assert accelerometer_fault(samples(0.0)[:10], 9.81) is None


def test_the_gyro_is_compared_with_the_image(rng: np.random.Generator) -> None:
    image, R_CI = rng.normal(0, 0.1, (6, 3)), RIG.cam0.T_CI[:3, :3]
    noisy = image + rng.normal(0, 0.005, image.shape)
    assert gyro_fault(image, noisy + 0.02, R_CI, 0.2) is None
    assert "deg/s" in (gyro_fault(image, np.rad2deg(noisy), R_CI, 0.2) or "")
    assert "sign" in (gyro_fault(image, -noisy, R_CI, 0.2) or "")
    assert "inverted" in (gyro_fault(image, noisy @ R_CI.T @ R_CI.T, R_CI, 0.2) or "")
    assert "deg wrong" in (gyro_fault(image, noisy @ so3.exp(np.array([0.0, np.pi / 2, 0.0])).T, R_CI, 0.2) or "")
    assert gyro_fault(image * 1e-3, -noisy, R_CI, 0.2) is None
