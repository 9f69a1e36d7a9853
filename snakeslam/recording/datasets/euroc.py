"""EuRoC MAV folders [Burri16]: mav0/cam0, mav0/imu0 and, where known, mav0/state_groundtruth_estimate0."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from snakeslam.calibration import CameraCalibration, ImuCalibration, SensorRig
from snakeslam.errors import InputError
from snakeslam.geometry import se3, so3
from snakeslam.messages import Float, GroundTruth
from snakeslam.recording import tables
from snakeslam.recording.datasets.common import shift_frames, validated
from snakeslam.recording.recording import FrameFile, ImuTable, Recording

DISTORTION_MODELS = {"radial-tangential": "radtan", "radtan": "radtan", "equidistant": "equidistant", "none": "none"}
IMU_KEYS = (
    "gyroscope_noise_density",
    "gyroscope_random_walk",
    "accelerometer_noise_density",
    "accelerometer_random_walk",
)


def find_root(path: Path) -> Path | None:
    """Return the mav0 folder of ``path`` (the folder above it or itself), or None when it is no EuRoC folder."""
    if (path / "mav0").is_dir():
        return path / "mav0"
    return path if (path / "cam0").is_dir() else None


def read_euroc(path: Path) -> Recording:
    """Read an EuRoC folder; InputError names the file and the line or key."""
    root = find_root(path)
    if root is None:
        raise InputError(str(path), "is no EuRoC folder", "a folder with mav0/cam0")
    T_BI, imu0 = _read_imu_calibration(root / "imu0" / "sensor.yaml")
    cam0 = _read_camera_calibration(root / "cam0" / "sensor.yaml", T_BI)
    return Recording(
        name=(root.resolve().parent if root.name == "mav0" else root.resolve()).name,
        kind="euroc",
        rig=SensorRig(cam0=cam0.model_copy(update={"timeshift_cam_imu": 0.0}), imu0=imu0),
        frames=shift_frames(read_frames(root), cam0.timeshift_cam_imu),
        imu=read_imu(root / "imu0" / "data.csv"),
        truth=_read_truth(root / "state_groundtruth_estimate0" / "data.csv", T_BI),
    )


def read_frames(root: Path) -> tuple[FrameFile, ...]:
    """Return the stamped image files of cam0, in order."""
    table = root / "cam0" / "data.csv"
    rows = tables.read_table(table, tables.stamp_from_ns, columns=(2,), separator=",")
    return tuple(FrameFile(row.t_ns, root / "cam0" / "data" / row.cells[0]) for row in rows)


def read_imu(path: Path) -> ImuTable:
    """Return rows of t_ns, gyro xyz (rad/s), accel xyz (m/s^2)."""
    rows = tables.read_table(path, tables.stamp_from_ns, columns=(7,), separator=",")
    values = tables.floats(path, rows, 6)
    return ImuTable(tables.stamps(rows), values[:, :3], values[:, 3:])


def _read_truth(path: Path, T_BI: Float) -> tuple[GroundTruth, ...]:
    """Read t_ns, p_WB, q_WB (w x y z) and, where given, v_W, gyro bias, accelerometer bias."""
    if not path.exists():
        return ()
    rows = tables.read_table(path, tables.stamp_from_ns, columns=(17, 11, 8), separator=",", repeats=True)
    count = min(len(row.cells) for row in rows)
    values = tables.floats(path, rows, count)
    norms = np.linalg.norm(values[:, 3:7], axis=1)
    if np.any(np.abs(norms - 1.0) > 0.05):
        line = rows[int(np.argmax(np.abs(norms - 1.0)))].line
        raise InputError(f"{path}: line {line}", "the quaternion has not length 1")
    Ts_WI = se3.from_rt(so3.matrix_from_quat_wxyz(values[:, 3:7]), values[:, :3]) @ T_BI
    same_origin = bool(np.allclose(T_BI[:3, 3], 0.0))
    return tuple(
        GroundTruth(
            t_ns=row.t_ns,
            T_WI=Ts_WI[k],
            v_W=values[k, 7:10] if count >= 10 and same_origin else None,
            gyro_bias_I=T_BI[:3, :3].T @ values[k, 10:13] if count >= 16 else None,
            accel_bias_I=T_BI[:3, :3].T @ values[k, 13:16] if count >= 16 else None,
        )
        for k, row in enumerate(rows)
    )


def _read_camera_calibration(path: Path, T_BI: Float) -> CameraCalibration:
    sensor = _read_sensor(path)
    model = str(sensor.get("distortion_model", "none"))
    T_CI = se3.inv(_transform(path, sensor)) @ T_BI
    values = {
        "T_cam_imu": [[float(value) for value in row] for row in T_CI],
        "camera_model": sensor.get("camera_model"),
        "intrinsics": sensor.get("intrinsics"),
        "distortion_model": DISTORTION_MODELS.get(model, model),
        "distortion_coeffs": sensor.get("distortion_coefficients", ()),
        "resolution": sensor.get("resolution"),
        "rate_hz": sensor.get("rate_hz"),
        "timeshift_cam_imu": sensor.get("timeshift_cam_imu", 0.0),
    }
    return validated(CameraCalibration, values, path)


def _read_imu_calibration(path: Path) -> tuple[Float, ImuCalibration]:
    """Return T_BI (identity in EuRoC) and the noise."""
    sensor = _read_sensor(path)
    values = {key: sensor.get(key) for key in IMU_KEYS} | {"update_rate": sensor.get("rate_hz")}
    return _transform(path, sensor), validated(ImuCalibration, values, path)


def _read_sensor(path: Path) -> dict[str, Any]:
    """Read OpenCV-flavoured YAML: its first line is no YAML 1.1 directive."""
    text = tables.read_text(path)
    if text.startswith("%YAML"):
        text = text.split("\n", 1)[1] if "\n" in text else ""
    try:
        sensor: Any = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise InputError(str(path), f"is no YAML: {' '.join(str(error).split())}") from error
    if not isinstance(sensor, dict):
        raise InputError(str(path), "has no keys")
    return sensor


def _transform(path: Path, sensor: dict[str, Any]) -> Float:
    """Return T_BS, (4, 4)."""
    entry: Any = sensor.get("T_BS")
    data = entry.get("data") if isinstance(entry, dict) else entry
    try:
        T = np.array(data, dtype=np.float64).reshape(4, 4)
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: T_BS", "is missing or not 16 numbers") from error
    if not np.all(np.isfinite(T)) or not np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-3):
        raise InputError(f"{path}: T_BS", "is not a rigid transform")
    return T
