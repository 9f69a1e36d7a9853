"""Calibration files in Kalibr's form."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from snakeslam.calibration import SensorRig, dump_rig, load_rig
from snakeslam.errors import InputError
from snakeslam.geometry import se3

RIG: dict[str, Any] = {
    "cam0": {
        "T_cam_imu": [[0, -1, 0, 0.02], [0, 0, -1, 0], [1, 0, 0, -0.01], [0, 0, 0, 1]],
        "camera_model": "pinhole",
        "intrinsics": [400.0, 401.0, 320.0, 240.0],
        "distortion_model": "radtan",
        "distortion_coeffs": [0.1, -0.2, 0.0, 0.0],
        "resolution": [640, 480],
        "timeshift_cam_imu": 0.003,
        "depth_scale": 1000.0,
    },
    "imu0": {
        "gyroscope_noise_density": 1e-3,
        "gyroscope_random_walk": 1e-5,
        "accelerometer_noise_density": 1e-2,
        "accelerometer_random_walk": 1e-4,
        "update_rate": 200.0,
    },
}


def write(path: Path, rig: object) -> Path:
    path.write_text(yaml.safe_dump(rig))
    return path


def test_a_rig_survives_the_file(tmp_path: Path) -> None:
    rig = load_rig(write(tmp_path / "a.yaml", RIG))
    dump_rig(rig, tmp_path / "b.yaml")
    assert load_rig(tmp_path / "b.yaml") == rig
    assert rig.cam0.timeshift_cam_imu == 0.003


def test_what_kalibr_adds_is_let_pass(tmp_path: Path) -> None:
    extra = {"rostopic": "/cam0", "cam_overlaps": []}
    rig = RIG | {"cam0": RIG["cam0"] | extra, "imu0": RIG["imu0"] | {"rostopic": "/imu0"}}
    assert load_rig(write(tmp_path / "a.yaml", rig)) == SensorRig.model_validate(RIG)


def test_the_transforms_are_inverse_and_map_imu_to_camera() -> None:
    cam0 = SensorRig.model_validate(RIG).cam0
    np.testing.assert_allclose(cam0.T_CI @ cam0.T_IC, np.eye(4), atol=1e-15)
    ahead_C = se3.act(cam0.T_CI, np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(ahead_C, [0.02, 0.0, 0.99])


@pytest.mark.parametrize(
    ("group", "key", "value"),
    [
        ("cam0", "T_cam_imu", [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
        ("cam0", "T_cam_imu", [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]),
        ("cam0", "T_cam_imu", [[1, 0, 0, 0]]),
        ("cam0", "intrinsics", [-400.0, 401.0, 320.0, 240.0]),
        ("cam0", "distortion_model", "fisheye"),
        ("cam0", "resolution", [640.5, 480]),
        ("cam0", "depth_scale", 0),
        ("cam0", "lens", "wide"),
        ("imu0", "update_rate", float("nan")),
    ],
)
def test_a_wrong_value_names_file_and_key(tmp_path: Path, group: str, key: str, value: object) -> None:
    path = write(tmp_path / "rig.yaml", RIG | {group: RIG[group] | {key: value}})
    with pytest.raises(InputError) as caught:
        load_rig(path)
    assert str(path) in str(caught.value)
    assert f"{group}.{key}" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["cam0: [", "", "just words", "\x00"])
def test_a_file_that_is_no_calibration(tmp_path: Path, text: str) -> None:
    (tmp_path / "rig.yaml").write_text(text)
    with pytest.raises(InputError, match=r"rig\.yaml"):
        load_rig(tmp_path / "rig.yaml")


@pytest.mark.parametrize("number", [1, 2, 3])
def test_the_benchmark_cameras_are_valid(checkout: Path, number: int) -> None:
    rig = load_rig(checkout / "configs" / "calib" / f"tum_fr{number}.yaml")
    assert rig.imu0 is None
    assert rig.cam0.depth_scale == 5000.0
    assert rig.cam0.resolution == (640, 480)
