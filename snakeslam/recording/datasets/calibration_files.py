"""Calibration files of other tools: Kalibr's and OpenVINS's chains, EuRoC's sensor.yaml, a camera's or an IMU's alone.

The first camera and the first IMU are read. Keys that nobody here needs are ignored; of those that are unknown, or
would change what is measured, a note is made.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from snakeslam.calibration import CameraCalibration, ImuCalibration, SensorRig, distortion_model, rigid_problem
from snakeslam.errors import InputError
from snakeslam.geometry import se3
from snakeslam.messages import Float
from snakeslam.recording.datasets.common import validated
from snakeslam.yaml_reader import read_yaml

CHAIN_NAMES = ("calibration.yaml", "camchain.yaml", "kalibr_imucam_chain.yaml", "camchain-imucam*.yaml")
IMU_NAMES = ("kalibr_imu_chain.yaml", "imu.yaml", "imu0.yaml", "imu_config.yaml", "imu-*.yaml")
RELATIVE_FILES = ("relative_config_imucam", "relative_config_imu")
"""Where OpenVINS's main file names the other two."""
IMU_KEYS = (
    "gyroscope_noise_density",
    "gyroscope_random_walk",
    "accelerometer_noise_density",
    "accelerometer_random_walk",
)
CAMERA_ALIASES = {"distortion_coefficients": "distortion_coeffs", "update_rate": "rate_hz"}
IMU_ALIASES = {"rate_hz": "update_rate"}
TRANSFORMS = ("T_cam_imu", "T_imu_cam", "T_BS")
"""IMU to camera; the two others camera to IMU (to the body)."""
UNUSED = frozenset(
    {"rostopic", "topic", "cam_overlaps", "T_cn_cnm1", "sensor_type", "sensor_id", "comment", "is_fisheye", "T_BS"}
)
UNCORRECTED_MODELS = ("calibrated", "kalibr", "rpng")
"""IMU models whose corrections stand in matrices beside them, which are reported where they correct anything."""


def find_chain(folders: Sequence[Path]) -> Path | None:
    """Return the first calibration file of a usual name in ``folders``; None without one."""
    return _find(folders, CHAIN_NAMES)


def read_rig(path: Path, notes: list[str], imu_rate_hz: float | None) -> SensorRig:
    """Read a chain of cameras and IMUs; InputError names the file and the key.

    ``imu_rate_hz`` is the measured rate of the recording's IMU, None where the recording has none: the place of the
    camera may then be unknown. An IMU that the file lacks is looked for in the files beside it.
    """
    groups = {key: (path, value) for key, value in read_mapping(path).items()}
    for key in RELATIVE_FILES:
        if key in groups:
            other = path.parent / str(groups[key][1])
            groups |= {name: (other, value) for name, value in read_mapping(other).items()}
    groups |= _flat_groups(groups, path)
    camera = _first(groups, "cam")
    if camera is None:
        raise InputError(f"{path}: cam0", "is missing", "a camera's calibration in Kalibr's form")
    camera_path, values = groups[camera]
    cam0 = read_camera(camera_path, camera, _group(camera_path, camera, values), notes, imu_rate_hz is None)
    return SensorRig(cam0=cam0, imu0=_imu_of(groups, path, notes, imu_rate_hz))


def read_imu_file(path: Path, notes: list[str], rate_hz: float | None) -> ImuCalibration:
    """Read an IMU's noise from a file of its own, flat or below ``imu0``; errors as in ``read_rig``."""
    groups = {key: (path, value) for key, value in read_mapping(path).items()}
    groups |= _flat_groups(groups, path)
    found = _imu_of(groups, path, notes, rate_hz)
    if found is None:
        raise InputError(f"{path}: imu0", "is missing", "an IMU's noise in Kalibr's form")
    return found


def find_imu_file(folders: Sequence[Path]) -> Path | None:
    """Return the first file of an IMU's usual name in ``folders``; None without one."""
    return _find(folders, IMU_NAMES)


def read_camera(
    path: Path, group: str, values: Mapping[str, Any], notes: list[str], extrinsics_unknown: bool = False
) -> CameraCalibration:
    """Return the camera of the keys ``values`` in any of the forms; InputError names the file and the key.

    With ``extrinsics_unknown`` a transform that is missing is taken to be the identity.
    """
    known = _renamed(values, CAMERA_ALIASES)
    T_CI = _camera_transform(path, group, known)
    if T_CI is None and extrinsics_unknown:
        T_CI = np.eye(4)
    if T_CI is not None:
        known["T_cam_imu"] = T_CI.tolist()
    known.pop("T_imu_cam", None)
    _split_model(known)
    return validated(CameraCalibration, _known(CameraCalibration, path, group, known, notes), path, group)


def read_imu_noise(
    path: Path, group: str, values: Mapping[str, Any], notes: list[str], rate_hz: float | None
) -> ImuCalibration:
    """Return the noise of the keys ``values``; a rate that is missing is the measured one."""
    known = _renamed(values, IMU_ALIASES)
    if known.get("update_rate") is None and rate_hz is not None:
        known["update_rate"] = rate_hz
        notes.append(f"{path}: {_key(group, 'update_rate')} is missing; its samples have {rate_hz:.4g} Hz")
    if known.get("model", "calibrated") in UNCORRECTED_MODELS:
        known.pop("model", None)
    if not known.get("time_offset", 0):
        known.pop("time_offset", None)
    return validated(ImuCalibration, _known(ImuCalibration, path, group, known, notes), path, group)


def transform(where: str, value: object) -> Float:
    """Return a rigid transform (4, 4) from rows, 16 numbers, or OpenCV's matrix; InputError otherwise."""
    data = value.get("data") if isinstance(value, dict) else value
    try:
        T = np.array(data, dtype=np.float64).reshape(4, 4)
    except (TypeError, ValueError) as error:
        raise InputError(where, "is missing or not 16 numbers", "4 rows of 4 numbers") from error
    if (problem := rigid_problem(T)) is not None:
        raise InputError(where, f"is not a rigid transform: {problem}")
    return T


def read_mapping(path: Path) -> dict[str, Any]:
    """Return the keys of a YAML file; InputError where it is missing or has none."""
    if path.exists() and not path.is_file():
        raise InputError(str(path), "is not a file")
    try:
        found = read_yaml(path)
    except FileNotFoundError as error:
        raise InputError(str(path), "the file is missing") from error
    if not isinstance(found, dict):
        raise InputError(str(path), "has no keys", "a calibration in Kalibr's form")
    return found


def _find(folders: Sequence[Path], names: Sequence[str]) -> Path | None:
    found = (path for folder in folders for name in names for path in sorted(folder.glob(name)))
    return next(found, None)


def _flat_groups(groups: Mapping[str, tuple[Path, Any]], path: Path) -> dict[str, tuple[Path, Any]]:
    """Return the groups that a file of one sensor lacks: its keys stand at the top."""
    if _first(groups, "cam") is not None or _first(groups, "imu") is not None:
        return {}
    flat = {key: value for key, (_, value) in groups.items()}
    if "intrinsics" in flat:
        return {"cam0": (path, flat)}
    return {"imu0": (path, flat)} if any(key in flat for key in IMU_KEYS) else {}


def _first(groups: Mapping[str, tuple[Path, Any]], kind: str) -> str | None:
    """Return the group of the first camera or IMU: cam0, else that of the smallest number."""
    numbers = [int(name.removeprefix(kind)) for name in groups if name.removeprefix(kind).isdecimal()]
    names = [f"{kind}{number}" for number in sorted(numbers) if f"{kind}{number}" in groups]
    return names[0] if names else None


def _group(path: Path, name: str, values: object) -> dict[str, Any]:
    if not isinstance(values, dict):
        raise InputError(f"{path}: {name}", "is not a group of keys")
    return values


def _imu_of(
    groups: Mapping[str, tuple[Path, Any]], path: Path, notes: list[str], rate_hz: float | None
) -> ImuCalibration | None:
    name = _first(groups, "imu")
    if name is not None:
        imu_path, values = groups[name]
        return read_imu_noise(imu_path, name, _group(imu_path, name, values), notes, rate_hz)
    beside = find_imu_file([path.parent]) if rate_hz is not None else None
    return None if beside is None or beside == path else read_imu_file(beside, notes, rate_hz)


def _renamed(values: Mapping[str, Any], aliases: Mapping[str, str]) -> dict[str, Any]:
    """Return the keys by our names; our own name wins where both stand there."""
    renamed = {aliases.get(key, key): value for key, value in values.items() if aliases.get(key) not in values}
    return {key: value for key, value in renamed.items() if value is not None}


def _camera_transform(path: Path, group: str, values: Mapping[str, Any]) -> Float | None:
    """Return T_CI of whichever transforms are given; InputError where two disagree."""
    found = {key: transform(f"{path}: {_key(group, key)}", values[key]) for key in TRANSFORMS if key in values}
    Ts_CI = {key: T if key == "T_cam_imu" else se3.inv(T) for key, T in found.items()}
    first = next(iter(Ts_CI), None)
    for key, T in Ts_CI.items():
        if first is not None and not np.allclose(T, Ts_CI[first], atol=1e-3):
            raise InputError(f"{path}: {_key(group, key)}", f"is not the same transform as {first}", "one of the two")
    return None if first is None else Ts_CI[first]


def _split_model(values: dict[str, Any]) -> None:
    """Give a camera model such as Kalibr's ``pinhole-equi``, or others' ``fisheye``, as pinhole and its distortion."""
    word = str(values.get("camera_model", "pinhole")).strip().lower().replace("_", "-")
    if distortion_model(word) == "equidistant":
        word = f"pinhole-{word}"
    model, _, distortion = word.partition("-")
    if distortion:
        values.setdefault("distortion_model", distortion)
    values["camera_model"] = model


def _known(
    model: type[CameraCalibration | ImuCalibration], path: Path, group: str, values: Mapping[str, Any], notes: list[str]
) -> dict[str, Any]:
    """Return what ``model`` has fields for; other keys are noted unless they change nothing."""
    others = [key for key in values if key not in model.model_fields and key not in UNUSED]
    ignored = [_key(group, key) for key in others if not _changes_nothing(values[key])]
    if ignored:
        notes.append(f"{path}: {', '.join(ignored[:6])}{', ...' * (len(ignored) > 6)}: not used")
    return {key: value for key, value in values.items() if key in model.model_fields}


def _changes_nothing(value: object) -> bool:
    """Whether a correction is none: a matrix of zeros or the identity."""
    data = value.get("data") if isinstance(value, dict) else value
    if not isinstance(data, list):
        return False
    try:
        matrix = np.array(data, dtype=np.float64)
    except (TypeError, ValueError):
        return False
    side = round(np.sqrt(matrix.size))
    identity = np.eye(side).ravel() if side * side == matrix.size else np.zeros(matrix.size)
    return bool(not matrix.any() or np.array_equal(matrix.ravel(), identity))


def _key(group: str, key: str) -> str:
    return f"{group}.{key}" if group else key
