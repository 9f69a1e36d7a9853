"""Calibration files in Kalibr's form."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from snakeslam.calibration import SensorRig, dump_rig
from snakeslam.errors import InputError
from snakeslam.estimation.imaging.camera import PinholeCamera
from snakeslam.geometry import se3
from snakeslam.recording.datasets.calibration_files import read_rig

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


def load_rig(path: Path, notes: list[str] | None = None) -> SensorRig:
    return read_rig(path, [] if notes is None else notes, imu_rate_hz=200.0)


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
        ("cam0", "distortion_model", "omni"),
        ("cam0", "resolution", [640.5, 480]),
        ("cam0", "depth_scale", 0),
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


def changed(group: str, **keys: Any) -> dict[str, Any]:
    """The rig with keys of a group changed; those given as None left out."""
    values = {key: value for key, value in (RIG[group] | keys).items() if value is not None}
    return RIG | {group: values}


@pytest.mark.parametrize(
    ("model", "count", "allowed"),
    [
        ("radtan", 0, "4, 5, 8, 12, 14"),
        ("radtan", 3, "4, 5, 8, 12, 14"),
        ("radial-tangential", 6, "4, 5, 8, 12, 14"),
        ("plumb_bob", 15, "4, 5, 8, 12, 14"),
        ("equidistant", 5, "4"),
        ("fisheye", 0, "4"),
    ],
)
def test_a_model_accepts_its_numbers_of_coefficients(tmp_path: Path, model: str, count: int, allowed: str) -> None:
    rig = changed("cam0", distortion_model=model, distortion_coeffs=[0.01] * count)
    with pytest.raises(InputError) as caught:
        load_rig(write(tmp_path / "rig.yaml", rig))
    assert f"cam0.distortion_coeffs: {count} values (allowed: {allowed} for " in str(caught.value)


def test_coefficients_without_a_model_are_refused_unless_zero(tmp_path: Path) -> None:
    assert load_rig(
        write(tmp_path / "a.yaml", changed("cam0", distortion_model="none", distortion_coeffs=[0, 0, 0, 0]))
    )
    with pytest.raises(InputError, match=r"cam0\.distortion_coeffs: not zero without a distortion model"):
        load_rig(write(tmp_path / "b.yaml", changed("cam0", distortion_model=None)))


@pytest.mark.parametrize(
    ("name", "ours", "count"),
    [
        ("Radial-Tangential", "radtan", 4),
        ("plumb_bob", "radtan", 5),
        ("rational_polynomial", "radtan", 8),
        ("radtan", "radtan", 14),
        ("equi", "equidistant", 4),
        ("kannala_brandt", "equidistant", 4),
        ("fisheye", "equidistant", 4),
        ("None", "none", 0),
    ],
)
def test_models_have_the_names_of_other_tools(tmp_path: Path, name: str, ours: str, count: int) -> None:
    rig = changed("cam0", distortion_model=name, distortion_coeffs=[0.01] * count)
    assert load_rig(write(tmp_path / "rig.yaml", rig)).cam0.distortion_model == ours


@pytest.mark.parametrize("model", ["pinhole-equi", "fisheye", "kannala_brandt4"])
def test_a_camera_model_may_name_the_distortion(tmp_path: Path, model: str) -> None:
    rig = changed("cam0", camera_model=model, distortion_model=None)
    assert load_rig(write(tmp_path / "rig.yaml", rig)).cam0.distortion_model == "equidistant"


T_IC = np.linalg.inv(np.array(RIG["cam0"]["T_cam_imu"], dtype=float))
KALIBR_IMU = {"T_i_b": np.eye(4).tolist(), "model": "calibrated", "time_offset": 0.0, "rostopic": "/imu0"}
OPENVINS_IMU = KALIBR_IMU | {"model": "kalibr", "Tw": np.eye(3).tolist(), "Tg": np.zeros((3, 3)).tolist()}
STEREO = RIG | {"cam1": RIG["cam0"] | {"intrinsics": [1.0, 1.0, 1.0, 1.0], "T_cn_cnm1": np.eye(4).tolist()}}

FORMS: dict[str, dict[str, Any]] = {
    "two cameras": STEREO,
    "the second camera first": {"cam1": STEREO["cam1"], "cam0": RIG["cam0"], "imu0": RIG["imu0"]},
    "Kalibr's IMU result": changed("imu0", **KALIBR_IMU),
    "OpenVINS's IMU": changed("imu0", **OPENVINS_IMU),
    "camera to IMU": changed("cam0", T_cam_imu=None, T_imu_cam=T_IC.tolist()),
    "both ways": changed("cam0", T_imu_cam=T_IC.tolist()),
    "OpenCV's matrix": changed(
        "cam0", T_cam_imu=None, T_BS={"rows": 4, "cols": 4, "dt": "d", "data": T_IC.ravel().tolist()}
    ),
    "EuRoC's names": changed("cam0", distortion_coeffs=None, distortion_coefficients=RIG["cam0"]["distortion_coeffs"]),
    "no camera model": changed("cam0", camera_model=None),
    "no rate": changed("imu0", update_rate=None),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("head", ["", "%YAML:1.0\n", "# mine\n%YAML:1.0\n---\n", "\ufeff"])
def test_what_kalibr_and_openvins_write_is_read(tmp_path: Path, form: str, head: str) -> None:
    path = tmp_path / "rig.yaml"
    path.write_text(head + yaml.safe_dump(FORMS[form], sort_keys=False))
    notes: list[str] = []
    rig, expected = load_rig(path, notes), SensorRig.model_validate(RIG)
    np.testing.assert_allclose(rig.cam0.T_CI, expected.cam0.T_CI, atol=1e-12)
    assert rig.cam0.model_copy(update={"T_cam_imu": expected.cam0.T_cam_imu}) == expected.cam0
    assert rig.imu0 == expected.imu0
    assert len(notes) == (form == "no rate")


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("name", ["kalibr_imu_chain.yaml", "imu.yaml", "imu_config.yaml", "imu-2024-01-01.yaml"])
def test_the_imu_may_stand_in_a_file_beside_the_cameras(tmp_path: Path, name: str, flat: bool) -> None:
    path = write(tmp_path / "kalibr_imucam_chain.yaml", {"cam0": RIG["cam0"]})
    assert load_rig(path).imu0 is None
    write(tmp_path / name, RIG["imu0"] if flat else {"imu0": RIG["imu0"]})
    assert load_rig(path) == SensorRig.model_validate(RIG)


def test_openvins_main_file_names_the_two_others(tmp_path: Path) -> None:
    (tmp_path / "calib").mkdir()
    write(tmp_path / "calib/cams.yaml", {"cam0": RIG["cam0"]})
    write(tmp_path / "calib/imus.yaml", {"imu0": RIG["imu0"]})
    main = {"use_fej": True, "relative_config_imu": "calib/imus.yaml", "relative_config_imucam": "calib/cams.yaml"}
    assert load_rig(write(tmp_path / "estimator_config.yaml", main)) == SensorRig.model_validate(RIG)
    (tmp_path / "calib/imus.yaml").unlink()
    with pytest.raises(InputError, match=r"calib/imus\.yaml: the file is missing"):
        load_rig(tmp_path / "estimator_config.yaml")


def test_keys_that_are_not_used_are_noted(tmp_path: Path) -> None:
    notes: list[str] = []
    rig = changed("imu0", model="scale-misalignment", T_i_b=[[0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    rig["cam0"] = rig["cam0"] | {"lens": "wide"}
    assert load_rig(write(tmp_path / "rig.yaml", rig), notes) == SensorRig.model_validate(RIG)
    path = tmp_path / "rig.yaml"
    assert notes == [f"{path}: cam0.lens: not used", f"{path}: imu0.T_i_b, imu0.model: not used"]


LETTERS = "abcdefghijklmnopq"
MISTAKES: dict[str, tuple[object, str]] = {
    "two transforms": (changed("cam0", T_imu_cam=np.eye(4).tolist()), "cam0.T_imu_cam: is not the same transform as"),
    "no transform": (changed("cam0", T_cam_imu=None), "cam0.T_cam_imu: is missing"),
    "mirrored": (
        changed("cam0", T_cam_imu=np.diag([1.0, 1, -1, 1]).tolist()),
        "cam0.T_cam_imu: is not a rigid transform",
    ),
    "last row": (changed("cam0", T_cam_imu=[*np.eye(4)[:3].tolist(), [0, 0, 1, 1]]), "the last row must be 0 0 0 1"),
    "15 numbers": (changed("cam0", T_cam_imu=[0.0] * 15), "cam0.T_cam_imu: is missing or not 16 numbers"),
    "words": (changed("cam0", T_cam_imu="identity"), "cam0.T_cam_imu: is missing or not 16 numbers"),
    "omni": (changed("cam0", camera_model="omni"), "cam0.camera_model: Input should be 'pinhole'"),
    "no camera": ({"imu0": RIG["imu0"]}, "cam0: is missing"),
    "no group": (RIG | {"cam0": "wide"}, "cam0: is not a group of keys"),
    "no noise": (changed("imu0", gyroscope_noise_density=None), "imu0.gyroscope_noise_density: is missing"),
    "key twice": ("cam0: {resolution: [1, 1], resolution: [2, 2]}", "line 1: the key 'resolution' is given twice"),
    "bomb": ("a: &a [1, 1]\n" + "".join(f"{b}: &{b} [*{a}, *{a}]\n" for a, b in pairwise(LETTERS)), "too many values"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_calibration_that_cannot_be_is_one_line(tmp_path: Path, mistake: str) -> None:
    content, expected = MISTAKES[mistake]
    (tmp_path / "rig.yaml").write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    with pytest.raises(InputError) as caught:
        load_rig(tmp_path / "rig.yaml")
    assert expected in str(caught.value)
    assert str(tmp_path / "rig.yaml") in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("count", [4, 5, 8, 12, 14])
def test_every_number_of_coefficients_is_undone_by_the_camera(count: int) -> None:
    values = [-0.1, 0.02, 1e-3, 5e-4, 3e-3, 0.01, -4e-3, 2e-3, 5e-4, -3e-4, 2e-4, 1e-4, 5e-3, -3e-3][:count]
    camera = PinholeCamera(SensorRig.model_validate(changed("cam0", distortion_coeffs=values)).cam0)
    xy = np.array([[0.1, 0.2], [-0.5, 0.3], [0.6, -0.4], [0.0, 0.0]])
    px = camera.distort(xy)
    assert np.abs(px - (xy * [400.0, 401.0] + [320.0, 240.0])).max() > 1.0
    np.testing.assert_allclose(camera.normalise(px), xy, atol=1e-5)
